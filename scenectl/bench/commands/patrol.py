"""`scenectl bench patrol`."""

from __future__ import annotations

from typing import Annotated

import typer

from scenectl.bench.commands.shared import measured, shown
from scenectl.console.options import Generators, Json, Seed, Threads, Weights


def patrol(
    scene: Annotated[str, typer.Option("--scene", help="A scan, or a bundled scene.")] = "living_room",
    minutes: Annotated[float, typer.Option(min=0.1, help="How long the patrol lasts.")] = 5.0,
    samples: Annotated[int, typer.Option(min=1, help="Motions for each leg; the best goes on.")] = 4,
    seed: Seed = 0,
    weights: Weights = "default",
    generator: Generators = None,
    threads: Threads = None,
    json_file: Json = None,
) -> None:
    """Walks that go on from one another for minutes: jumps, touches, missed places, memory."""
    from scenectl.bench.control.patrol import bench_patrol

    result = measured(
        lambda maker, engine: bench_patrol(maker, scene, minutes, seed, samples, engine),
        weights, threads, generator, json_file,
    )  # fmt: skip
    told = ("seconds", "good", "missed_m", "deepest_m", "gap_m", "seam_ratio", "generate_s", "resident_mb", "verdict")
    shown(result, json_file, told)
