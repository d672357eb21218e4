"""`scenectl bench control`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from scenectl.bench.commands.shared import measured, shown, wrote
from scenectl.console.options import DATA, Data, Generators, Json, Seed, Shard, Threads, Weights


def control(
    data: Data = DATA,
    clips: Annotated[int, typer.Option(min=1, help="Test clips for each joint and density.")] = 2,
    method: Annotated[list[str] | None, typer.Option(help="A method; repeatable. Default: all possible.")] = None,
    joint: Annotated[list[str] | None, typer.Option(help="A joint; repeatable. Default: six of them.")] = None,
    density: Annotated[list[str] | None, typer.Option(help="1, 2, 5, 25% or 100%; repeatable. Default: all.")] = None,
    scene: Annotated[
        list[str] | None, typer.Option(help="empty, or pillars close to the way; repeatable. Default: empty.")
    ] = None,
    shortest: Annotated[int, typer.Option(min=64, max=196, help="Frames that clips have at least.")] = 64,
    seed: Seed = 0,
    weights: Weights = "default",
    generator: Generators = None,
    threads: Threads = None,
    json_file: Json = None,
    shard: Shard = None,
    plot_file: Annotated[Path | None, typer.Option("--plot", help="Draw error against seconds to this file.")] = None,
) -> None:
    """Ways of reaching keyframes on the same motions: the paper's, ControlMM's, Adam, L-BFGS and ours."""
    from scenectl.bench.control.control import bench_control, plot
    from scenectl.bench.control.keyframes import DENSITIES, JOINTS

    chosen = (method or (), joint or JOINTS, density or tuple(DENSITIES), scene or ("empty",))
    result = measured(
        lambda maker, engine: bench_control(maker, data, clips, *chosen, shortest, seed, engine),
        weights, threads, generator, json_file, shard,
    )  # fmt: skip
    columns = (
        "method", "scene", "joint", "density", "frames", "seconds", "refine_seconds", "passes", "average_error_m",
        "deepest_penetration_m", "moved_m", "max_acceleration_m_per_frame2", "skating_ratio",
    )  # fmt: skip
    shown(result, json_file, columns)
    if plot_file is not None:
        plot(result, plot_file)
        wrote(plot_file)
