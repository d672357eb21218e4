"""`scenectl score`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from scenectl.cli.clock import importing
from scenectl.console.console import bars
from scenectl.console.options import AllowCode, AllowUnmet, Fps, MotionFile, TaskFile, Unit, Up, allow, motion_read
from scenectl.console.results import leave, show_samples


def score(
    motion: MotionFile,
    task: TaskFile,
    json_file: Annotated[Path | None, typer.Option("--json", help="Write the report to this file.")] = None,
    allow_code: AllowCode = None,
    allow_unmet: AllowUnmet = False,
    fps: Fps = None,
    unit: Unit = None,
    up: Up = None,
) -> None:
    """Report how well finished motions meet a task, and whether a person would move like that, ranked as by `run`.

    Exits with 3 where none is both met and believable.
    """
    with importing():
        from scenectl.pipeline.run import score as judge
        from scenectl.tasks.task import load_task
        from scenes.files import write_json

    allow(allow_code)
    loaded = load_task(task)
    made = motion_read(motion, fps, unit, up)
    with bars() as progress:
        result = judge(made, loaded, progress)
    show_samples(result, of_file=True)
    if json_file is not None:
        write_json(result.report, json_file, allow_nan=False)
    leave(result, allow_unmet)
