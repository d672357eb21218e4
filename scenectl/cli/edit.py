"""`scenectl edit`."""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from scenectl.cli.clock import importing
from scenectl.console.console import bars, err, out
from scenectl.console.options import GENERATOR, Generator, MotionFile
from scenes.errors import UserError

if TYPE_CHECKING:
    from jaxtyping import Bool
    from torch import Tensor

    from scenes.motion.motion import Motion

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
    weights: Annotated[str, typer.Option(help="Bundled weights, or a folder.")] = "default",
    generator: Generator = GENERATOR,
) -> None:
    """Make parts of a motion anew: motion.npz and report.json in DIR, as `scenectl run` writes them."""
    with importing():
        from scenectl.generators import load_generator
        from scenectl.generators.registry import find
        from scenectl.pipeline.editing import check, edited
        from scenectl.pipeline.results import load_sample
        from scenes.files import writable_folder

    original = load_sample(motion, sample)
    mask = _mask(original, regenerate or [], keep or [])
    check(original, mask, find(generator).spec)
    if not prompt.strip():
        raise UserError("--prompt is empty; describe the motion in a sentence, such as 'a person walks'")
    writable_folder(output)
    with bars() as progress:
        maker = load_generator(generator, weights)
        result = edited(maker, original, mask, prompt, samples, seed, progress)
    result.report["edit"]["motion"] = str(motion)
    result.save(output, preview=False)
    err.print(f"weights: {maker.licence}")
    out.print(f"made {int(mask.sum())} of {len(mask)} frames anew; wrote motion.npz and report.json in {output}")


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
