"""`scenectl bench edit`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from scenectl.bench.commands.shared import alone, shown
from scenectl.console.options import Json, Seed


def edit(
    mesh: Annotated[
        Path | None, typer.Option(help="A file of named objects. Default: the bundled living room.")
    ] = None,
    resolution: Annotated[int, typer.Option(help="Nodes along the longest side.")] = 256,
    rounds: Annotated[int, typer.Option(min=1, help="Moves, removals and additions, as many of each.")] = 5,
    seed: Seed = 0,
    json_file: Json = None,
) -> None:
    """Objects of a scene moved, removed and added, against baking it anew: seconds, every bit equal."""
    from scenectl.bench.scenes.assembly import bench_assembly

    shown(alone(lambda engine: bench_assembly(mesh, resolution, rounds, seed, engine), json_file), json_file)
