"""`scenectl bench building`."""

from __future__ import annotations

from typing import Annotated

import typer

from scenectl.bench.commands.shared import alone, shown
from scenectl.console.options import Json, Seed


def building(
    spacing: Annotated[float, typer.Option(help="Metres between the finest nodes.")] = 0.02,
    width: Annotated[float, typer.Option(min=10.0, help="Of the building, metres.")] = 50.0,
    seed: Seed = 0,
    json_file: Json = None,
) -> None:
    """A furnished building of five storeys as a sparse grid: memory, time, errors against the oracle, queries."""
    from scenectl.bench.scenes.building import bench_building

    shown(alone(lambda engine: bench_building(spacing, width, seed, engine), json_file), json_file)
