"""`scenectl bench rooms`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from scenectl.bench.commands.shared import measured, shown
from scenectl.console.options import Generators, Json, Seed, Shard, Threads, Weights


def rooms(
    mesh: Annotated[
        list[Path] | None, typer.Option("--mesh", help="A scan; repeatable. Default: bundled scenes.")
    ] = None,
    tasks: Annotated[int, typer.Option(min=1, help="Walks in each room.")] = 50,
    samples: Annotated[int, typer.Option(min=1, help="Motions for each task; the best is scored.")] = 4,
    facing: Annotated[
        list[str] | None, typer.Option(help="as-is, reversed, wall or no-ceiling: how meshes are wound; repeatable.")
    ] = None,
    stop: Annotated[bool, typer.Option(help="End walks standing, as tasks do by default.")] = True,
    seed: Seed = 0,
    weights: Weights = "default",
    generator: Generators = None,
    threads: Threads = None,
    json_file: Json = None,
    shard: Shard = None,
) -> None:
    """Random walks through rooms, with what tasks have by default: target reached, nothing touched, stopped there."""
    from scenectl.bench.control.rooms import bench_rooms

    result = measured(
        lambda maker, engine: bench_rooms(
            maker, mesh or (), tasks, seed, samples, facings=facing or (), stop=stop, engine=engine
        ),
        weights, threads, generator, json_file, shard,
    )  # fmt: skip
    columns = (
        "mesh", "task", "reached", "clean", "stopped", "believable", "missed_m", "deepest_penetration_m",
        "deepest_floor_penetration_m", "skating_ratio", "seconds",
    )  # fmt: skip
    shown(result, json_file, columns)
