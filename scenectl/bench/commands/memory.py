"""`scenectl bench memory`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from scenectl.bench.commands.shared import alone, shown
from scenectl.console.options import Json

TASK = Path("examples/tasks/wave_on_stairs.toml")


def memory(
    task: Annotated[Path, typer.Option(help="The task that is run again and again, at many lengths.")] = TASK,
    generations: Annotated[int, typer.Option(min=10, help="Runs of one sample each.")] = 1000,
    json_file: Json = None,
) -> None:
    """Runs in one process: the memory that it holds after a tenth of them and after all."""
    from scenectl.bench.studies.memory import bench_memory

    shown(alone(lambda engine: bench_memory(task, generations, engine), json_file), json_file)
