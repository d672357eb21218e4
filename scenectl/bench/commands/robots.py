"""`scenectl bench robots`."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from scenectl.bench.commands.shared import alone, measured, shown
from scenectl.console.options import DATA, GENERATOR, Data, Generator, Json, Seed, Threads, Weights

if TYPE_CHECKING:
    from scenectl.bench.engine import Engine, Result


def robots(
    robot: Annotated[Path, typer.Option(metavar="FILE", help="A humanoid robot: MJCF (.xml) or URDF.")],
    data: Data = DATA,
    split: Annotated[str, typer.Option(help="Of the recorded motions: train, val or test.")] = "test",
    motions: Annotated[int, typer.Option(min=0, help="Recorded motions, evenly over the split.")] = 20,
    files: Annotated[list[Path] | None, typer.Option("--motion", help="A result or motion file; repeatable.")] = None,
    scans: Annotated[
        list[Path] | None, typer.Option("--scan", metavar="FILE", help="Make walks in this scan, too; repeatable.")
    ] = None,
    walks: Annotated[int, typer.Option(min=1, help="Walks in all scans.")] = 10,
    samples: Annotated[int, typer.Option(min=1, help="Motions for each walk; the best is followed.")] = 1,
    fps: Annotated[float, typer.Option(help="Frames a second of the trajectories.")] = 50.0,
    pictures: Annotated[
        Path | None, typer.Option(metavar="DIR", help="Draw each motion into this folder; takes seconds each.")
    ] = None,
    seed: Seed = 0,
    weights: Weights = "default",
    generator: Generator = GENERATOR,
    threads: Threads = None,
    json_file: Json = None,
) -> None:
    """Robots that follow motions: how far from them, within which limits, and how fast."""
    from scenectl.bench.studies.robots import Walks, bench_robots
    from scenectl.retarget.robots.robot import Robot
    from scenes.files import writable_folder

    machine = Robot(robot)
    if pictures is not None:
        writable_folder(pictures)

    def bench(made: Walks | None, engine: Engine) -> Result:
        return bench_robots(machine, data, split, motions, files or (), fps, engine, made, pictures)

    if scans:
        chosen: Any = scans

        def with_walks(maker: Any, engine: Engine) -> Result:
            return bench(Walks(maker, chosen, walks, seed, samples), engine)

        result = measured(with_walks, weights, threads, generator, json_file)
    else:
        result = alone(lambda engine: bench(None, engine), json_file)
    columns = (
        "name", "frames", "ankle_m", "wrist_m", "slide_m", "sole_m", "speed", "within", "itself_m", "scene_m",
        "generate_s", "seconds", "cpu_s",
    )  # fmt: skip
    shown(result, json_file, columns)
