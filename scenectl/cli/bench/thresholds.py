"""`scenectl bench thresholds`."""

from __future__ import annotations

from typing import Annotated

import typer

from scenectl.cli.bench.shared import measured
from scenectl.cli.console import show
from scenectl.cli.options import Generators, Json, Seed, Threads, Weights


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
        lambda maker, tell: bench_thresholds(maker, entry or (), factor or FACTORS, seed, tell),
        weights, threads, generator,
    )  # fmt: skip
    show(
        result,
        json_file,
        ("name", "value", "unit", "met", "cost", "stretch_m", "lift_m", "moved_m", "passes", "seconds", "source"),
    )
