"""`scenectl bench idle`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from scenectl.bench.commands.shared import criteria_shown, measured, shown, wrote
from scenectl.console.options import DATA, GENERATOR, Data, Generator, Json, Seed, Threads, Weights


def idle(
    data: Data = DATA,
    samples: Annotated[int, typer.Option(min=1, help="Motions of 10 s, in five wordings in turn.")] = 20,
    plot_file: Annotated[Path | None, typer.Option("--plot", help="Draw every motion to this file.")] = None,
    seed: Seed = 0,
    weights: Weights = "default",
    generator: Generator = GENERATOR,
    threads: Threads = None,
    json_file: Json = None,
) -> None:
    """Standing: arms hang, knees are straight, sway is within that of recorded people, and nobody freezes."""
    from scenectl.bench.models.idle import bench_idle

    result = measured(
        lambda maker, engine: bench_idle(maker, data, samples, seed, plot_file, engine),
        weights, threads, generator, json_file,
    )  # fmt: skip
    shown(result, json_file)
    criteria_shown(result)
    wrote(plot_file)
