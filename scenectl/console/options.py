"""Arguments and options that several commands share."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

TaskFile = Annotated[Path, typer.Argument(metavar="TASK", help="A task file (TOML).")]
MotionFile = Annotated[Path, typer.Argument(metavar="MOTION", help="motion.npz, or a folder that holds one.")]
AllowCode = Annotated[
    Path | None, typer.Option("--allow-code", metavar="FILE.py", help="Run this file for its @goal functions.")
]
GENERATOR = "mscot"
"""The default, as in `scenectl.generators.registry`, which help does not import."""
Data = Annotated[Path, typer.Option("--data", help="Folder of the motion collection.")]
Json = Annotated[Path | None, typer.Option("--json", help='Write {"summary": ..., "rows": [...]} to this file.')]
Weights = Annotated[str, typer.Option(help="Weights: 'default', 'permissive' or a folder.")]
Generator = Annotated[str, typer.Option(help="A registered generator.")]
Generators = Annotated[
    list[str] | None, typer.Option("--generator", help=f"A registered generator; repeatable. Default: {GENERATOR}.")
]
Shard = Annotated[
    str | None,
    typer.Option(metavar="I/N", help="Measure every N-th case, from the I-th on (from 0); N processes share --json."),
]
Seed = Annotated[int, typer.Option(help="Of everything random.")]
Threads = Annotated[int | None, typer.Option(min=1, max=256, help="CPU threads; one by default.")]
DATA = Path("../shared/data/motions")


def allow(path: Path | None) -> None:
    """Run what `--allow-code` names."""
    if path is not None:
        from scenectl.tasks.code import allow_code

        allow_code(path)
