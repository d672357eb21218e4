"""`scenectl bench thresholds`."""

from __future__ import annotations

from typing import Annotated

import typer

from scenectl.bench.commands.shared import measured, shown
from scenectl.console.options import Generators, Json, Seed, Threads, Weights


def thresholds(
    entry: Annotated[list[str] | None, typer.Option(help="A threshold; repeatable. Default: all.")] = None,
    factor: Annotated[list[float] | None, typer.Option(help="On its value; repeatable. Default: 0.5 and 2.")] = None,
    seed: Seed = 0,
    weights: Weights = "default",
    generator: Generators = None,
    threads: Threads = None,
    json_file: Json = None,
) -> None:
    """Refinement with one threshold of control changed at a time: goals met, bodies, passes, and its source."""
    from scenectl.bench.control.thresholds import FACTORS, bench_thresholds

    result = measured(
        lambda maker, engine: bench_thresholds(maker, entry or (), factor or FACTORS, seed, engine),
        weights, threads, generator, json_file,
    )  # fmt: skip
    shown(
        result,
        json_file,
        ("name", "value", "unit", "met", "cost", "lift_m", "moved_m", "passes", "seconds", "source"),
    )
