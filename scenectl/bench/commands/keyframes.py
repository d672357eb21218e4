"""`scenectl bench keyframes`."""

from __future__ import annotations

from typing import Annotated

import typer

from scenectl.bench.commands.shared import measured, shown
from scenectl.console.options import DATA, Data, Generators, Json, Seed, Shard, Threads, Weights


def keyframes(
    data: Data = DATA,
    clips: Annotated[int, typer.Option(min=1, help="Test clips.")] = 36,
    number: Annotated[int, typer.Option("--keyframes", min=1, help="Targets in each clip.")] = 5,
    seed: Seed = 0,
    weights: Weights = "default",
    generator: Generators = None,
    threads: Threads = None,
    json_file: Json = None,
    shard: Shard = None,
) -> None:
    """One joint at random keyframes of test motions, beside the same prompts without control."""
    from scenectl.bench.control.keyframes import bench_keyframes

    result = measured(
        lambda maker, engine: bench_keyframes(maker, data, clips, number, seed, engine=engine),
        weights, threads, generator, json_file, shard,
    )  # fmt: skip
    shown(result, json_file)
