"""`scenectl check`."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from scenectl.cli.clock import importing
from scenectl.console.console import complain, doubt, out
from scenectl.console.options import AllowCode, allow
from scenes.errors import UserError

if TYPE_CHECKING:
    from scenectl.tasks.task import Task


def check(
    tasks: Annotated[list[Path], typer.Argument(metavar="TASK...", help="Task files (TOML).")],
    allow_code: AllowCode = None,
) -> None:
    """Validate tasks without a model: keys, scene, start, path, goals, times, places, and that there are weights.

    All are checked, also after one that is wrong; the exit status is 2 where any is.
    """
    with importing():
        from scenectl.tasks.task import load_task

    allow(allow_code)
    wrong = 0
    for path in tasks:
        try:
            line, doubts = _checked(load_task(path))
        except UserError as error:  # names the file; the others may be fine
            complain(str(error))
            wrong += 1
            continue
        out.print(f"{path}: {line}")
        doubt(doubts)
    if wrong:
        raise typer.Exit(2)


def _checked(task: Task) -> tuple[str, tuple[str, ...]]:
    """What a task comes to, and what is in doubt; raises UserError naming the file where it cannot be run."""
    from scenectl.generators.weights import weights_folder
    from scenes.world.floor.polyline import walked

    with task.named():
        family, weights = task.generator.family, task.generator.weights
        if family.weights is not None and weights != "default":
            weights_folder(weights)
    problem = task.build()
    walk = "" if problem.path is None else f", a walk of {walked(problem.path):.1f} m"
    count = len(problem.objective.terms)
    goals = f"{count} goal" + ("" if count == 1 else "s")
    if added := " and ".join(term.name for term in task.avoided):
        goals += f", {added} by default"
    return f"fine ({problem.seconds:g} s in '{problem.scene.name}', {goals}{walk})", problem.doubts
