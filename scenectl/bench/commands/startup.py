"""`scenectl bench startup`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from scenectl.bench.commands.shared import alone, example, shown
from scenectl.console.options import Json

TASKS = Path("examples/tasks")


def startup(
    check: Annotated[Path, typer.Option(help="The task to check, without a mesh.")] = TASKS / "barrier.toml",
    run: Annotated[Path, typer.Option(help="The task to run.")] = TASKS / "walk_to_target.toml",
    repeats: Annotated[int, typer.Option(min=1, help="Processes of each; the median counts.")] = 7,
    json_file: Json = None,
) -> None:
    """Fresh processes of help, completion, check and run, beside `import torch`."""
    from scenectl.bench.studies.startup import bench_startup

    shown(alone(lambda engine: bench_startup(example(check), example(run), repeats, engine), json_file), json_file)
