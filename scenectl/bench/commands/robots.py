"""`scenectl bench robots`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from scenectl.bench.commands.shared import alone, shown
from scenectl.console.options import DATA, Data, Json


def robots(
    robot: Annotated[Path, typer.Option(metavar="FILE", help="A humanoid robot: MJCF (.xml) or URDF.")],
    data: Data = DATA,
    split: Annotated[str, typer.Option(help="Of the recorded motions: train, val or test.")] = "test",
    motions: Annotated[int, typer.Option(min=0, help="Recorded motions, evenly over the split.")] = 20,
    files: Annotated[list[Path] | None, typer.Option("--motion", help="A result or motion file; repeatable.")] = None,
    fps: Annotated[float, typer.Option(help="Frames a second of the trajectories.")] = 50.0,
    json_file: Json = None,
) -> None:
    """Robots that follow motions: how far from them, within which limits, and how fast."""
    from scenectl.bench.studies.robots import bench_robots
    from scenectl.retarget.robots.robot import Robot

    machine = Robot(robot)
    result = alone(
        lambda engine: bench_robots(machine, data, split, motions, files or (), fps, engine),
        json_file,
    )
    columns = (
        "name", "frames", "ankle_m", "wrist_m", "knee_m", "elbow_m", "slide_m", "speed", "beyond", "seconds",
    )  # fmt: skip
    shown(result, json_file, columns)
