"""`scenectl bench rooms`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from scenectl.cli.bench.shared import measured
from scenectl.cli.console import show
from scenectl.cli.options import Generators, Json, Seed, Threads, Weights


def rooms(
    mesh: Annotated[
        list[Path] | None, typer.Option("--mesh", help="A scan; repeatable. Default: bundled scenes.")
    ] = None,
    tasks: Annotated[int, typer.Option(min=1, help="Walks in each room.")] = 50,
    samples: Annotated[int, typer.Option(min=1, help="Motions for each task; the best is scored.")] = 4,
    seed: Seed = 0,
    weights: Weights = "default",
    generator: Generators = None,
    threads: Threads = None,
    json_file: Json = None,
) -> None:
    """Random walks through rooms: target reached, nothing touched."""
    from scenectl.bench.control.rooms import bench_rooms

    result = measured(
        lambda maker, tell: bench_rooms(maker, mesh or (), tasks, seed, samples, progress=tell),
        weights, threads, generator,
    )  # fmt: skip
    columns = (
        "mesh", "task", "reached", "clean", "missed_m", "deepest_penetration_m", "deepest_floor_penetration_m",
        "skating_ratio", "seconds",
    )  # fmt: skip
    show(result, json_file, columns)
