"""`scenectl run`."""

from __future__ import annotations

import time
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from scenectl.cli.clock import importing, since_start, told
from scenectl.cli.score import show_samples
from scenectl.console.console import bars, doubt, err, out
from scenectl.console.options import AllowCode, TaskFile, allow
from scenes.errors import UserError

if TYPE_CHECKING:
    from scenectl.pipeline.results import Result

LAPS = {"plan_s": "planning", "load_s": "loading", "generate_s": "generating", "measure_s": "measuring"}
"""What the laps of a report's `timing` are called."""


def run(
    task: TaskFile,
    output: Annotated[Path, typer.Option("--output", "-o", metavar="DIR", help="Folder for the results.")],
    samples: Annotated[int | None, typer.Option(min=1, help="Motions to make; the best comes first.")] = None,
    seed: Annotated[int | None, typer.Option(help="Instead of the task's own.")] = None,
    generator: Annotated[str | None, typer.Option(help="A registered generator instead of the task's.")] = None,
    weights: Annotated[str | None, typer.Option(help="Weights to use instead of the task's.")] = None,
    preview: Annotated[bool, typer.Option(help="Draw preview.png.")] = True,
    allow_code: AllowCode = None,
) -> None:
    """Make motions for a task: motion.npz, report.json and preview.png in DIR."""
    with importing():
        from scenectl.generators.weights import bundled_weights
        from scenectl.pipeline.run import run as make
        from scenectl.tasks.task import load_task
        from scenes.files import writable_folder

    laps = {"imports": since_start()}
    allow(allow_code)
    loaded = load_task(task)
    if weights is not None and weights not in ("default", *bundled_weights()) and Path(weights).is_dir():
        weights = str(Path(weights).resolve())
    loaded = loaded.with_generator(generator, weights)
    writable_folder(output)
    with bars() as progress:
        result = make(loaded, samples, seed, progress=progress)
        laps |= {LAPS.get(name, name): seconds for name, seconds in result.report["timing"].items()}
        progress("writing", 0.0)
        begin = time.perf_counter()
        result.save(output, preview=False)
        laps["writing"], begin = time.perf_counter() - begin, time.perf_counter()
        drawn = preview and _drawn(result, output / "preview.png")
        laps["preview"] = time.perf_counter() - begin
    maker = result.report["generator"]
    out.print(f"weights '{maker['weights']}': {maker['licence']}")
    show_samples(result)
    doubt(result.report["scene"]["doubts"])
    out.print(f"wrote motion.npz, report.json{' and preview.png' if drawn else ''} in {output}")
    out.print(told(laps, since_start()))


def _drawn(result: Result, png: Path) -> bool:
    """Draw the preview; where nothing can draw, or the disk is full, the motion is still worth having."""
    from scenectl.view import draw_result

    try:
        draw_result(result, png)
    except UserError as error:
        err.print(f"scenectl: no preview.png, because {error}")
        return False
    return True
