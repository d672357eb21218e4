"""`scenectl bench`: a file for each benchmark."""

from __future__ import annotations

import typer

from scenectl.console.lazy import group

BENCHES = (
    "rooms", "actions", "patrol", "keyframes", "facing", "pose_goals", "control", "implausible", "progmogen",
    "tokenizer", "bake", "edit", "query", "building", "posterior", "generator", "sentences", "idle", "ablations",
    "gallery", "startup", "threads", "prices", "thresholds", "limits", "verdict", "memory", "skeletons", "rotations",
    "characters", "plants", "robots", "data",
)  # fmt: skip

app = typer.Typer(
    cls=group("scenectl.bench.commands", *BENCHES),
    name="bench",
    no_args_is_help=True,
    rich_markup_mode=None,
    callback=lambda: None,
    help="Measure: each prints a table, --json keeps it.",
)
