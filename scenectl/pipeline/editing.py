"""Edits of finished motions by any generator that is an `Editor`: what is kept comes back exactly, seams are smooth.

The editor keeps what it can (for MSCoT: tokens, as in MoSa, section IV-D), refinement draws the kept frames beside
each seam onto the original, and what then remains of a jump is spread over the frames made anew.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from scenectl.control.problem import Problem
from scenectl.control.settings import SolverSettings
from scenectl.control.solvers import minimise
from scenectl.generators.base import Editor, Generation, Generator, Guide, Progress, Step
from scenectl.generators.mscot.schedule import MAX_FRAMES, MIN_FRAMES
from scenectl.pipeline.run import Result, score
from scenectl.tasks.schema import SceneSpec, Task
from scenes.body.body import DEFAULT_BODY
from scenes.errors import UserError
from scenes.motion.motion import Motion
from scenes.motion.skeleton import HUMANML3D

BESIDE = 12
"""Kept frames beside each seam that refinement fits: those further off are put back as they were anyway."""
SIGMA = 0.03
"""Distance (m) from the original, root mean square of the joints, that counts half a nat a frame."""
SETTLE = 20
"""Frames made anew over which a seam's remaining jump dies away, where there are as many."""


def edit(
    generator: Generator,
    motion: Motion,
    regenerate: Bool[Tensor, " T"],
    prompt: str,
    guide: Guide | None = None,
    samples: int = 1,
    seed: int = 0,
    progress: Progress | None = None,
    iterations: int = 40,
) -> Generation:
    """Make parts of one motion anew.

    Args:
        generator: one that can edit.
        motion: ``[T, 22, 3]`` metres, world, 36 to 196 frames at 20 fps, on the uniform skeleton.
        regenerate: the frames to make anew; what the motion holds there is of no account.
        prompt: what the whole motion shall be.
        guide: further goals.
        samples, seed, progress: as for `Generator.generate`.
        iterations: refinement steps.

    Returns:
        Motions ``[samples, T, 22, 3]``, equal to the one given in every frame kept.

    Raises:
        UserError: a generator that cannot edit, or a motion or mask that is not as described.
    """
    if not isinstance(generator, Editor):
        raise UserError(f"generator '{generator.name}' cannot edit motions; 'mscot' can")
    check(motion, regenerate)
    keeping = Keeping(motion, ~regenerate, guide, SolverSettings(iterations=iterations))
    made = generator.edit(motion, regenerate, prompt, keeping, samples, seed, progress)
    return replace(made, motion=settled(motion, made.motion, regenerate))


def mask_of(motion: Motion, spans: Sequence[tuple[float, float]]) -> Bool[Tensor, " T"]:
    """The frames of spans of seconds, each from its start to before its end; raises UserError for one past the end."""
    mask = torch.zeros(motion.frames, dtype=torch.bool)
    for start, end in spans:
        if start >= motion.seconds:
            raise UserError(f"{start:g}-{end:g} begins after the motion, which lasts {motion.seconds:g} s")
        mask[round(start * motion.fps) : round(end * motion.fps)] = True
    return mask


def edited(
    generator: Generator,
    motion: Motion,
    regenerate: Bool[Tensor, " T"],
    prompt: str,
    samples: int = 1,
    seed: int = 0,
    progress: Progress | None = None,
) -> Result:
    """The edits that `edit` makes, measured on the floor that the kept frames stand on; arguments as it takes them."""
    check(motion, regenerate)
    made = edit(generator, motion, regenerate, prompt, samples=samples, seed=seed, progress=progress)
    floor = float(motion.joints[~regenerate][..., 1].min()) - DEFAULT_BODY.sole_offset
    task = Task(prompt=prompt, seconds=motion.seconds, scene=SceneSpec(floor=floor))
    result = score(made.motion, task, progress)
    result.report["seed"] = seed
    result.report["generator"] = {"name": generator.name, "licence": generator.licence, "trace": {}}
    result.report["edit"] = {"regenerated_frames": regenerate.nonzero().flatten().tolist()}
    return result


def check(motion: Motion, regenerate: Bool[Tensor, " T"]) -> None:
    """Raises UserError for a motion or mask that cannot be edited."""
    if motion.joints.ndim != 3:
        raise UserError(f"the motion has shape {tuple(motion.joints.shape)}; an edit takes one motion, [T, 22, 3]")
    if motion.skeleton.names != HUMANML3D.names:
        raise UserError("the motion has another skeleton; an edit takes HumanML3D's 22 joints")
    if motion.fps != 20.0:
        raise UserError(f"the motion has {motion.fps:g} frames a second; an edit takes 20: resample it first")
    if not MIN_FRAMES <= motion.frames <= MAX_FRAMES:
        raise UserError(f"the motion has {motion.frames} frames; an edit takes {MIN_FRAMES} to {MAX_FRAMES}")
    if not motion.valid.all() or not torch.isfinite(motion.joints).all():
        raise UserError("the motion holds padding or positions that are not finite; cut it to its real frames first")
    if regenerate.shape != (motion.frames,):
        raise UserError(f"the mask has shape {tuple(regenerate.shape)}; the motion has {motion.frames} frames")
    if not regenerate.any():
        raise UserError("the edit makes no frame anew; name a part of the motion to regenerate")
    if regenerate.all():
        raise UserError("the edit keeps no frame; leave some, or generate a motion from the prompt alone")
    parents, children = zip(*HUMANML3D.bones, strict=True)
    kept = motion.joints[~regenerate]
    lengths = (kept[:, list(children)] - kept[:, list(parents)]).norm(dim=-1).mean(0)
    ratio = float(lengths.sum()) / float(HUMANML3D.bone_lengths[list(children)].sum())
    if not 0.85 < ratio < 1.15:
        raise UserError(
            f"the motion's bones are {ratio:.2f} times as long as the uniform skeleton's; bring it to that size first "
            "(scenectl.data.features.to_uniform_skeleton)"
        )


class Keeping:
    """A guide towards the kept frames beside the seams, in the world, and towards another guide's goals."""

    def __init__(
        self,
        motion: Motion,
        kept: Bool[Tensor, " T"],
        others: Guide | None = None,
        solver: SolverSettings | None = None,
    ) -> None:
        self.others, self.solver = others, solver or SolverSettings()
        self.frames = torch.nonzero(kept & near(~kept, BESIDE)).flatten()
        self.goal = motion.joints[self.frames]

    def cost(self, motion: Motion) -> Float[Tensor, " S"]:
        """Squared distance from the original, over the variance that `SIGMA` says, mean over joints."""
        away = (motion.joints[:, self.frames] - self.goal).square().sum(-1).mean(-1)
        return away.sum(-1) / (2 * SIGMA**2)

    def log_prob(self, step: Step) -> Float[Tensor, " S"]:
        kept = -self.cost(step.decode(step.value))
        return kept if self.others is None else kept + self.others.log_prob(step)

    def gradient(self, step: Step) -> Float[Tensor, "S *v"]:
        value = step.value.detach().requires_grad_(True)
        with torch.enable_grad():
            (gradient,) = torch.autograd.grad(-self.cost(step.decode(value)).sum(), value)
        gradient = torch.nan_to_num(gradient, 0.0, 0.0, 0.0)
        return gradient if self.others is None else gradient + self.others.gradient(step)

    def refine(self, step: Step) -> Float[Tensor, "S *v"]:
        if self.solver.iterations == 0:
            return step.value.detach()
        shape, start = step.value.shape, step.value.detach().flatten(1)

        def cost(x: Tensor) -> Tensor:
            wanted = -self.log_prob(step.at(x.unflatten(1, shape[1:])))
            return wanted + self.solver.prior * (x - start).square().sum(1)

        def done(x: Tensor) -> Tensor:
            return torch.zeros(len(x), dtype=torch.bool)

        return minimise(Problem(cost, start, done), self.solver).value.unflatten(1, shape[1:])

    def finish(self, made: Generation) -> Generation:
        """As it is: what is kept is put back by `settled`."""
        return made


def near(mask: Bool[Tensor, " T"], frames: int) -> Bool[Tensor, " T"]:
    """Where the mask is true at most so many frames away."""
    wide: Tensor = torch.nn.functional.max_pool1d(mask.float()[None], 2 * frames + 1, stride=1, padding=frames)[0]
    return wide > 0


def settled(original: Motion, made: Motion, regenerate: Bool[Tensor, " T"]) -> Motion:
    """The original where it is kept, and what was made elsewhere, without a jump of position or velocity between.

    At each seam, the difference of position and velocity on the kept side decays along a cubic over the frames made
    anew, to nothing before the next seam (inertialisation, as in games).

    Args:
        original: ``[T, J, 3]``.
        made: ``[S, T, J, 3]``.
        regenerate: which frames of `made` count.
    """
    offset = original.joints - made.joints
    total = torch.where(regenerate[:, None, None], 0.0, offset)
    for seam, toward, room in _seams(regenerate):
        length = min(SETTLE, room)
        past = seam - toward  # the kept frame before last, where there is one
        inside = 0 <= past < len(regenerate) and not regenerate[past]
        jump = offset[:, seam]
        speed = jump - offset[:, past] if inside else torch.zeros_like(jump)
        for i in range(1, length + 1):
            u = i / (length + 1)
            value = 2 * u**3 - 3 * u**2 + 1
            slope = (u**3 - 2 * u**2 + u) * (length + 1)
            total[:, seam + toward * i] += value * jump + slope * speed
    return replace(made, joints=made.joints + total)


def _seams(regenerate: Bool[Tensor, " T"]) -> list[tuple[int, int, int]]:
    """Of every seam: its last kept frame, the direction of the frames made anew (1 or -1), and how many they are."""
    mask, out = regenerate.tolist(), []
    for t in range(len(mask) - 1):
        if mask[t] != mask[t + 1]:
            toward = 1 if mask[t + 1] else -1
            seam, room = (t if toward == 1 else t + 1), 0
            while 0 <= seam + toward * (room + 1) < len(mask) and mask[seam + toward * (room + 1)]:
                room += 1
            out.append((seam, toward, room))
    return out
