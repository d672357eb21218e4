"""`scenectl run`."""

from __future__ import annotations

import time
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from scenectl.cli.clock import importing, since_start, told
from scenectl.console.console import bars, doubt, out
from scenectl.console.options import AllowCode, AllowUnmet, TaskFile, allow
from scenectl.console.results import drawn, leave, show_exported, show_samples

if TYPE_CHECKING:
    from scenectl.export.export import Exported
    from scenectl.pipeline.results import Result
    from scenes.motion.motion import Motion

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
    export: Annotated[
        str | None, typer.Option(metavar="ENDINGS", help="Files for other tools, too, such as glb,bvh: motion.glb …")
    ] = None,
    after: Annotated[
        Path | None, typer.Option(metavar="DIR", help="Go on from where the first motion of these results ends.")
    ] = None,
    allow_code: AllowCode = None,
    allow_unmet: AllowUnmet = False,
) -> None:
    """Make motions for a task: motion.npz, report.json and preview.png in DIR.

    Samples that are met and believable come first, then those that are met, then the rest; each by how little
    refinement changed poses. Exits with 3 where none is both.
    """
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
    before = None if after is None else _before(after)
    endings = () if export is None else _endings(export)
    writable_folder(output)
    with bars() as progress:
        result = make(loaded, samples, seed, progress=progress, after=before)
        laps |= {LAPS.get(name, name): seconds for name, seconds in result.report["timing"].items()}
        progress("writing", 0.0)
        begin = time.perf_counter()
        result.save(output, preview=False)
        exported = _exported(result, output, endings)
        laps["writing"], begin = time.perf_counter() - begin, time.perf_counter()
        pictured = preview and drawn(result, output / "preview.png")
        laps["preview"] = time.perf_counter() - begin
    maker = result.report["generator"]
    out.print(f"weights '{maker['weights']}': {maker['licence']}")
    show_samples(result)
    doubt(result.report["scene"]["doubts"])
    out.print(f"wrote motion.npz{', report.json and preview.png' if pictured else ' and report.json'} in {output}")
    for done in exported:
        show_exported(done)
    out.print(told(laps, since_start()))
    leave(result, allow_unmet)


def _before(folder: Path) -> Motion:
    """The first motion of a folder's results."""
    from scenectl.pipeline.results import load_result

    motion, _ = load_result(folder)
    return motion[0] if motion.joints.ndim == 4 else motion


def _endings(text: str) -> Sequence[str]:
    """What `--export` asks for, refused before minutes of work."""
    from scenectl.export.export import endings_of

    return endings_of(text)


def _exported(result: Result, folder: Path, endings: Sequence[str]) -> list[Exported]:
    """Write what `--export` asks for."""
    if not endings:
        return []
    from scenectl.export.export import export_beside

    return export_beside(result.motion, folder, endings)
