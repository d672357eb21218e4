"""`scenectl bench characters`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from scenectl.bench.commands.shared import alone, shown
from scenectl.console.options import Json


def characters(
    files: Annotated[list[Path], typer.Argument(metavar="CHARACTER...", help="Skinned glTF or VRM files.")],
    motions: Annotated[list[Path], typer.Option("--motion", help="A result's folder or a motion file; repeatable.")],
    json_file: Json = None,
) -> None:
    """Characters that play motions: slides and sinks of feet that stand, lengths, knees and arms."""
    from scenectl.bench.studies.characters import bench_characters

    columns = (
        "character", "motion", "frames", "stands", "ratio", "slide_max_m", "sink_max_m", "float_max_m",
        "stretch_max_m", "lowered_m", "knee_min_deg", "arm_max_deg", "turn_max_deg", "seconds",
    )  # fmt: skip
    shown(alone(lambda engine: bench_characters(files, motions, engine), json_file), json_file, columns)
