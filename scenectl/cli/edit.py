"""`scenectl edit`: parts of a finished motion made anew from a sentence."""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from scenectl.cli.console import bars, err, literal, out
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
    motion: Annotated[Path, typer.Argument(metavar="MOTION", help="motion.npz, or a folder that holds one.")],
    prompt: Annotated[str, typer.Option(help="What the whole motion shall be.")],
    output: Annotated[Path, typer.Option("--output", "-o", metavar="DIR", help="Folder for the results.")],
    regenerate: Spans = None,
    keep: KeptSpans = None,
    sample: Annotated[int, typer.Option(min=0, help="Which motion of a result, 0 is the best.")] = 0,
    samples: Annotated[int, typer.Option(min=1, max=256, help="Motions to make.")] = 1,
    seed: Annotated[int, typer.Option(min=0, help="Of what is drawn.")] = 0,
    weights: Annotated[str, typer.Option(help="Bundled weights, or a folder.")] = "default",
) -> None:
    """Make parts of a motion anew: motion.npz and report.json in DIR, as `scenectl run` writes them."""
    from scenectl.generators import load_generator
    from scenectl.pipeline.editing import check
    from scenectl.pipeline.editing import edit as make
    from scenectl.pipeline.run import score
    from scenectl.tasks.schema import SceneSpec, Task
    from scenes.body.body import DEFAULT_BODY

    original = _one(motion, sample)
    mask = mask_of(original, regenerate or [], keep or [])
    check(original, mask)
    if not prompt.strip():
        raise UserError("--prompt is empty; describe the motion in a sentence, such as 'a person walks'")
    if output.exists() and not output.is_dir():
        raise UserError(f"'{output}' is a file; give -o a folder")
    floor = float(original.joints[~mask][..., 1].min()) - DEFAULT_BODY.sole_offset
    with bars() as progress:
        generator = load_generator(weights=weights)
        made = make(generator, original, mask, prompt, samples=samples, seed=seed, progress=progress)
        task = Task(prompt=prompt, seconds=original.seconds, scene=SceneSpec(floor=floor))
        result = score(made.motion, task, progress)
    result.report["seed"] = seed
    result.report["generator"] = {"name": generator.name, "licence": generator.licence, "trace": {}}
    result.report["edit"] = {"motion": str(motion), "regenerated_frames": mask.nonzero().flatten().tolist()}
    result.save(output, preview=False)
    err.print(literal(f"weights: {generator.licence}"))
    out.print(f"made {int(mask.sum())} of {len(mask)} frames anew; wrote motion.npz and report.json in {output}")


def _one(path: Path, sample: int) -> Motion:
    """One motion of a file or of a result's folder."""
    from scenes.motion.motion import Motion

    motion = Motion.load(path / "motion.npz" if path.is_dir() else path)
    if motion.joints.ndim == 3:
        return motion
    if motion.joints.ndim > 4 or sample >= len(motion.joints):
        raise UserError(
            f"'{path}' holds {len(motion.joints)} motions; --sample goes from 0 to {len(motion.joints) - 1}"
        )
    return motion[sample]


def mask_of(motion: Motion, regenerate: list[str], keep: list[str]) -> Bool[Tensor, " T"]:
    """Frames to make anew from spans of seconds; raises UserError for spans that are none, or both kinds at once."""
    import torch

    if bool(regenerate) == bool(keep):
        raise UserError("say either --regenerate START-END or --keep START-END, in seconds")
    option, spans = ("--regenerate", regenerate) if regenerate else ("--keep", keep)
    mask = torch.zeros(motion.frames, dtype=torch.bool)
    for span in spans:
        start, end = _span(option, span)
        if start >= motion.seconds:
            raise UserError(f"{option} {span} begins after the motion, which lasts {motion.seconds:g} s")
        mask[round(start * motion.fps) : round(end * motion.fps)] = True
    return mask if regenerate else ~mask


def _span(option: str, text: str) -> tuple[float, float]:
    try:
        start, end = (float(part) for part in text.split("-"))
    except ValueError as error:
        raise UserError(f"{option} is '{text}'; give START-END in seconds, such as 1.5-3") from error
    if not (math.isfinite(end) and 0 <= start < end):
        raise UserError(f"{option} is '{text}'; START must come before END, both in seconds")
    return start, end
