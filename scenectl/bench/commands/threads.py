"""`scenectl bench threads`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from scenectl.bench.commands.shared import alone, example, shown
from scenectl.console.options import Json

TASK = Path("examples/tasks/walk_to_target.toml")


def threads(
    task: Annotated[Path, typer.Option(help="The task whose motions are generated.")] = TASK,
    samples: Annotated[int | None, typer.Option(min=1, help="Motions; the task's own number by default.")] = None,
    repeats: Annotated[int, typer.Option(min=1, help="Generations of each setting; the median counts.")] = 5,
    limit: Annotated[float, typer.Option(min=1, help="Seconds after which a generation is given up.")] = 60.0,
    json_file: Json = None,
) -> None:
    """One thread or many, spinning or asleep: seconds of a generation, on a quiet machine and a busy one."""
    from scenectl.bench.studies.threads import bench_threads

    example(task)
    shown(alone(lambda engine: bench_threads(task, samples, repeats, limit, engine=engine), json_file), json_file)
