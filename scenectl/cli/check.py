"""`scenectl check`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from scenectl.cli.clock import importing
from scenectl.console.console import doubt, out
from scenectl.console.options import AllowCode, allow


def check(
    tasks: Annotated[list[Path], typer.Argument(metavar="TASK...", help="Task files (TOML).")],
    allow_code: AllowCode = None,
) -> None:
    """Validate tasks without a model: keys, scene, start, path, goals, times, places, and that there are weights."""
    with importing():
        from scenectl.generators.weights import weights_folder
        from scenectl.tasks.task import load_task
        from scenes.world.floor.polyline import walked

    allow(allow_code)
    for path in tasks:
        task = load_task(path)
        family, weights = task.generator.family, task.generator.weights
        if family.weights is not None and weights != "default":
            weights_folder(weights)
        problem = task.build()
        walk = "" if problem.path is None else f", a walk of {walked(problem.path):.1f} m"
        count = len(problem.objective.terms)
        goals = f"{count} goal" + ("" if count == 1 else "s")
        if added := " and ".join(term.name for term in task.avoided):
            goals += f", {added} by default"
        out.print(f"{path}: fine ({problem.seconds:g} s in '{problem.scene.name}', {goals}{walk})")
        doubt(problem.doubts)
