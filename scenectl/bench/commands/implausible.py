"""`scenectl bench implausible`."""

from __future__ import annotations

from typing import Annotated

import typer

from scenectl.bench.commands.shared import measured, shown
from scenectl.console.options import DATA, Data, Generators, Json, Seed, Shard, Threads, Weights


def implausible(
    data: Data = DATA,
    clips: Annotated[int, typer.Option(min=1, help="Test clips for each kind of bad target.")] = 8,
    seed: Seed = 0,
    weights: Weights = "default",
    generator: Generators = None,
    threads: Threads = None,
    json_file: Json = None,
    shard: Shard = None,
) -> None:
    """Targets out of reach, or noise: lifted feet, misses, and whether the culprit is named, beside goals alone."""
    from scenectl.bench.control.implausible import bench_implausible

    result = measured(
        lambda maker, engine: bench_implausible(maker, data, clips, seed, engine),
        weights, threads, generator, json_file, shard,
    )  # fmt: skip
    columns = (
        "kind", "way", "frames", "ended", "lift_m", "depth_m", "missed_m", "spoilt_missed_m", "named", "seconds",
        "diagnosis",
    )  # fmt: skip
    shown(result, json_file, columns)
