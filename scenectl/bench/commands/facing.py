"""`scenectl bench facing`."""

from __future__ import annotations

from typing import Annotated

import typer

from scenectl.bench.commands.shared import measured, shown
from scenectl.console.options import DATA, Data, Generators, Json, Seed, Shard, Threads, Weights


def facing(
    data: Data = DATA,
    motions: Annotated[int, typer.Option(min=1, help="Test clips.")] = 30,
    moments: Annotated[int, typer.Option(min=1, help="Random times in each clip.")] = 5,
    seed: Seed = 0,
    weights: Weights = "default",
    generator: Generators = None,
    threads: Threads = None,
    json_file: Json = None,
    shard: Shard = None,
) -> None:
    """Pelvis, chest and head with the headings of test motions at random times, beside no control."""
    from scenectl.bench.control.facing import bench_facing

    result = measured(
        lambda maker, engine: bench_facing(maker, data, motions, moments, seed, engine=engine),
        weights, threads, generator, json_file, shard,
    )  # fmt: skip
    shown(result, json_file, ("part", "frames", "mean_error_deg", "worst_error_deg", "met", "believable", "seconds"))
