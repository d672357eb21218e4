"""`scenectl bench posterior`."""

from __future__ import annotations

from typing import Annotated

import typer

from scenectl.bench.commands.shared import measured, shown
from scenectl.console.options import Generators, Json, Seed, Shard, Threads, Weights


def posterior(
    generations: Annotated[int, typer.Option(min=1, help="Motions that are looked at.")] = 8,
    seed: Seed = 0,
    weights: Weights = "default",
    generator: Generators = None,
    threads: Threads = None,
    json_file: Json = None,
    shard: Shard = None,
) -> None:
    """The first-order token posterior against the exact one, scale by scale (Tables 12 and 13)."""
    from scenectl.bench.models.posterior import bench_posterior

    result = measured(
        lambda maker, engine: bench_posterior(maker, generations, seed=seed, engine=engine),
        weights, threads, generator, json_file, shard,
    )  # fmt: skip
    shown(result, json_file)
