"""`scenectl bench prices`."""

from __future__ import annotations

from typing import Annotated

import typer

from scenectl.bench.commands.shared import measured, shown
from scenectl.console.options import Generators, Json, Seed, Threads, Weights


def prices(
    repeats: Annotated[int, typer.Option(min=1, help="Of each product; medians count.")] = 9,
    samples: Annotated[int, typer.Option(min=1, help="Motions at once.")] = 1,
    seed: Seed = 0,
    weights: Weights = "default",
    generator: Generators = None,
    threads: Threads = None,
    json_file: Json = None,
) -> None:
    """Products of every kind of step, in passes: what solvers are chosen by."""
    from scenectl.bench.control.prices import bench_prices

    result = measured(
        lambda maker, engine: bench_prices(maker, repeats, samples, seed, engine),
        weights, threads, generator, json_file,
    )  # fmt: skip
    shown(result, json_file)
