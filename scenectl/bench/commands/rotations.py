"""`scenectl bench rotations`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from scenectl.bench.commands.shared import alone, loaded, shown
from scenectl.console.options import DATA, GENERATOR, Data, Json, Seed, Weights


def rotations(
    data: Data = DATA,
    split: Annotated[str, typer.Option(help="Of the recorded motions: train, val or test.")] = "test",
    animated: Annotated[int, typer.Option(min=0, help="Bodies moved by random rotations, 20 s each.")] = 30,
    prompts: Annotated[bool, typer.Option("--prompts", help="And the gallery's prompts, and a minute.")] = False,
    files: Annotated[list[Path] | None, typer.Option("--motion", help="A motion file, as it is; repeatable.")] = None,
    seed: Seed = 0,
    weights: Weights = "default",
    json_file: Json = None,
) -> None:
    """Rotations of joints: turns while nothing moves, forward kinematics, and errors where the truth is known."""
    from scenectl.bench.studies.rotations import bench_rotations

    maker = loaded(GENERATOR, weights) if prompts else None
    result = alone(lambda engine: bench_rotations(data, split, animated, seed, files or (), maker, engine), json_file)
    columns = (
        "set", "name", "motions", "frames", "bones_m", "fk_m", "turn_deg", "joint", "flips", "flipped", "median_deg",
        "q95_deg",
    )  # fmt: skip
    shown(result, json_file, columns)
