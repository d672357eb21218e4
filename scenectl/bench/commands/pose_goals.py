"""`scenectl bench pose_goals`."""

from __future__ import annotations

from typing import Annotated, Literal

import typer

from scenectl.bench.commands.shared import measured, shown
from scenectl.console.options import DATA, Data, Generators, Json, Seed, Shard, Threads, Weights


def pose_goals(
    data: Data = DATA,
    motions: Annotated[int, typer.Option(min=0, help="Test clips whose poses are asked for.")] = 30,
    clips: Annotated[int, typer.Option(min=0, help="Test clips that are followed past a pillar.")] = 10,
    times: Annotated[int, typer.Option(min=1, help="Poses of each motion.")] = 5,
    frame: Annotated[Literal["pelvis", "world"], typer.Option(help="What poses are relative to.")] = "pelvis",
    samples: Annotated[int, typer.Option(min=1, help="Made of each; the first that is met and believable counts.")] = 1,
    seed: Seed = 0,
    weights: Weights = "default",
    generator: Generators = None,
    threads: Threads = None,
    json_file: Json = None,
    shard: Shard = None,
) -> None:
    """Poses at random times of motions, and test clips that are followed past a pillar in their way."""
    from scenectl.bench.control.pose_goals import bench_pose_goals

    result = measured(
        lambda maker, engine: bench_pose_goals(maker, data, motions, clips, times, frame, samples, seed, engine=engine),
        weights, threads, generator, json_file, shard,
    )  # fmt: skip
    shown(result, json_file, ("goal", "clip", "frames", "met", "believable", "verdict", "seconds"))
