"""`scenectl edit`."""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from scenectl.cli.clock import importing
from scenectl.console.console import bars, doubt, err, note, out
from scenectl.console.options import (
    GENERATOR,
    AllowCode,
    AllowUnmet,
    Fps,
    Generator,
    MotionFile,
    Unit,
    Up,
    allow,
    is_result,
    motion_read,
)
from scenectl.console.results import drawn, leave, show_samples
from scenes.errors import UserError

if TYPE_CHECKING:
    from jaxtyping import Bool
    from torch import Tensor

    from scenectl.tasks.task import Task
    from scenes.motion.motion import Motion

SEEN = 0.001
"""Metres by which kept frames may move without a word."""

Spans = Annotated[
    list[str] | None, typer.Option(metavar="START-END", help="Seconds to make anew, such as 1.5-3; repeatable.")
]
KeptSpans = Annotated[
    list[str] | None, typer.Option(metavar="START-END", help="Seconds to keep instead, all else made anew; repeatable.")
]


def edit(
    motion: MotionFile,
    prompt: Annotated[str, typer.Option(help="What the whole motion shall be.")],
    output: Annotated[Path, typer.Option("--output", "-o", metavar="DIR", help="Folder for the results.")],
    regenerate: Spans = None,
    keep: KeptSpans = None,
    sample: Annotated[int, typer.Option(min=0, help="Which motion of a result, 0 is the best.")] = 0,
    samples: Annotated[int, typer.Option(min=1, max=256, help="Motions to make.")] = 1,
    seed: Annotated[int, typer.Option(min=0, help="Of what is drawn.")] = 0,
    task: Annotated[
        Path | None, typer.Option(help="Its scene and goals count; by default those of the result's own task.")
    ] = None,
    weights: Annotated[str, typer.Option(help="Bundled weights, or a folder.")] = "default",
    generator: Generator = GENERATOR,
    preview: Annotated[bool, typer.Option(help="Draw preview.png.")] = True,
    allow_code: AllowCode = None,
    allow_unmet: AllowUnmet = False,
    fps: Fps = None,
    unit: Unit = None,
    up: Up = None,
) -> None:
    """Make parts of a motion anew: motion.npz, report.json and preview.png in DIR, as `scenectl run` writes them.

    Exits with 3 where no edit is both met and believable, what was kept included.
    """
    with importing():
        from scenectl.generators import load_generator
        from scenectl.generators.registry import find
        from scenectl.pipeline.editing import check, edited
        from scenes.files import writable_folder

    allow(allow_code)
    spec = find(generator).spec
    original = _original(motion_read(motion, fps, unit, up), sample, motion, spec.fps)
    mask = _mask(original, regenerate or [], keep or [])
    check(original, mask, spec)
    if not prompt.strip():
        raise UserError("--prompt is empty; describe the motion in a sentence, such as 'a person walks'")
    kept = _task(motion, task)
    writable_folder(output)
    with bars() as progress:
        maker = load_generator(generator, weights)
        result = edited(maker, original, mask, prompt, samples, seed, progress, kept)
    result.report["edit"]["motion"] = str(motion)
    result.save(output, preview=False)
    pictured = preview and drawn(result, output / "preview.png")
    err.print(f"weights: {maker.licence}")
    show_samples(result)
    moved = result.report["edit"]["kept_moved_m"]
    doubt((*result.report["scene"]["doubts"], *_moved(moved)))
    files = f"motion.npz, report.json{' and preview.png' if pictured else ''}"
    out.print(f"made {int(mask.sum())} of {len(mask)} frames anew; wrote {files} in {output}")
    out.print(f"kept frames moved by {1000 * moved:.1f} mm at most, so that bones keep their lengths")
    leave(result, allow_unmet)


def _moved(most: float) -> tuple[str, ...]:
    """A sentence where kept frames moved by more than `SEEN` (m)."""
    if most <= SEEN:
        return ()
    return (f"bones of the motion change their lengths: kept frames moved by up to {1000 * most:.0f} mm to be rigid",)


def _original(motion: Motion, sample: int, path: Path, fps: float) -> Motion:
    """The motion to edit, on the generator's clock; says so where it had another."""
    from scenectl.data.formats.motions import one_of
    from scenectl.pipeline.going_on import on_clock
    from scenes.motion.rates import told

    one = one_of(motion, sample, path)
    if one.fps != fps:
        note((f"the motion is edited at the generator's rate: {told(one.fps, fps)}",))
    return on_clock(one, fps)


def _task(motion: Path, file: Path | None) -> Task | None:
    """The task in a file; that of the result where none is stated, and None where the motion is not a result."""
    from scenectl.pipeline.results import load_result, task_of
    from scenectl.tasks.task import load_task

    if file is not None:
        return load_task(file)
    return task_of(load_result(motion)[1]) if is_result(motion) else None


def _mask(motion: Motion, regenerate: list[str], keep: list[str]) -> Bool[Tensor, " T"]:
    """Frames to make anew; raises UserError for spans that are none, or both kinds at once."""
    from scenectl.pipeline.editing import mask_of

    if bool(regenerate) == bool(keep):
        raise UserError("say either --regenerate START-END or --keep START-END, in seconds")
    option, texts = ("--regenerate", regenerate) if regenerate else ("--keep", keep)
    spans = [_span(option, text) for text in texts]
    try:
        mask = mask_of(motion, spans)
    except UserError as error:
        raise UserError(f"{option} {error}") from error
    return mask if regenerate else ~mask


def _span(option: str, text: str) -> tuple[float, float]:
    try:
        start, end = (float(part) for part in text.split("-"))
    except ValueError as error:
        raise UserError(f"{option} is '{text}'; give START-END in seconds, such as 1.5-3") from error
    if not (math.isfinite(end) and 0 <= start < end):
        raise UserError(f"{option} is '{text}'; START must come before END, both in seconds")
    return start, end
