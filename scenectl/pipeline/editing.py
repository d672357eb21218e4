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

from scenectl.control.settings import SolverSettings
from scenectl.control.solvers.choice import minimise
from scenectl.control.solvers.problem import Problem
from scenectl.generators import registry
from scenectl.generators.base import Draft, Editor, Generator, Guide, Progress, Step
from scenectl.generators.spec import Spec
from scenectl.pipeline.results import Result
from scenectl.pipeline.run import score
from scenectl.tasks.schema import SceneSpec
from scenectl.tasks.task import Task
from scenectl.threads import threads
from scenes.body.body import DEFAULT_BODY
from scenes.errors import UserError
from scenes.motion.frames import origin_near
from scenes.motion.motion import Motion

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
) -> Draft:
    """Make parts of one motion anew.

    Args:
        generator: one that can edit.
        motion: ``[T, J, 3]`` metres, world, on the generator's clock and skeleton, no longer than it makes at once.
        regenerate: the frames to make anew; what the motion holds there is of no account.
        prompt: what the whole motion shall be.
        guide: further goals, for the motion as it is seen from the whole hundreds of metres near it
            (`scenes.motion.frames.origin_near` its first pelvis), where that is far from the origin.
        samples, seed, progress: as for `Generator.generate`.
        iterations: refinement steps.

    Returns:
        Motions ``[samples, T, J, 3]``, equal to the one given in every frame kept; without a step to refine further.

    Raises:
        UserError: a generator that cannot edit, or a motion or mask that is not as described.
    """
    if not isinstance(generator, Editor):
        able = [name for name in registry.names() if "edit" in registry.find(name).spec.abilities]
        raise UserError(f"generator '{generator.name}' cannot edit motions; {' and '.join(able)} can")
    check(motion, regenerate, generator.spec)
    origin = origin_near(motion.joint("pelvis")[0].tolist())
    motion = motion.seen_from(origin)
    keeping, solver = SeamGuide(motion, ~regenerate, guide), SolverSettings(iterations=iterations)
    with threads():
        draft = generator.edit(motion, regenerate, prompt, guide=keeping, samples=samples, seed=seed, progress=progress)
        made = draft.motion if draft.step is None else refined(draft.step, keeping, solver)
    return Draft(settled(motion, made, regenerate).moved(origin), None, draft.trace)


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
    made = edit(generator, motion, regenerate, prompt, samples=samples, seed=seed, progress=progress)
    floor = float(motion.joints[~regenerate][..., 1].min()) - DEFAULT_BODY.sole_offset
    task = Task(prompt=prompt, seconds=motion.seconds, scene=SceneSpec(floor=floor))
    result = score(made.motion, task, progress)
    result.report["seed"] = seed
    result.report["generator"] = {"name": generator.name, "licence": generator.licence, "trace": {}}
    result.report["edit"] = {"regenerated_frames": regenerate.nonzero().flatten().tolist()}
    return result


def check(motion: Motion, regenerate: Bool[Tensor, " T"], spec: Spec) -> None:
    """Raises UserError for a motion or mask that cannot be edited."""
    if motion.joints.ndim != 3:
        raise UserError(f"the motion has shape {tuple(motion.joints.shape)}; an edit takes one motion, [T, J, 3]")
    if motion.skeleton.names != spec.skeleton.names:
        raise UserError(
            f"the motion has another skeleton; an edit takes the generator's {len(spec.skeleton.names)} joints"
        )
    if motion.fps != spec.fps:
        raise UserError(f"the motion has {motion.fps:g} frames a second; an edit takes {spec.fps:g}: resample it first")
    low, high = spec.shortest_frames, spec.window_frames
    if not low <= motion.frames <= high:
        raise UserError(f"the motion has {motion.frames} frames; an edit takes {low} to {high}")
    if not motion.valid.all() or not torch.isfinite(motion.joints).all():
        raise UserError("the motion holds padding or positions that are not finite; cut it to its real frames first")
    if regenerate.shape != (motion.frames,):
        raise UserError(f"the mask has shape {tuple(regenerate.shape)}; the motion has {motion.frames} frames")
    if not regenerate.any():
        raise UserError("the edit makes no frame anew; name a part of the motion to regenerate")
    if regenerate.all():
        raise UserError("the edit keeps no frame; leave some, or generate a motion from the prompt alone")
    parents, children = zip(*spec.skeleton.bones, strict=True)
    kept = motion.joints[~regenerate]
    lengths = (kept[:, list(children)] - kept[:, list(parents)]).norm(dim=-1).mean(0)
    ratio = float(lengths.sum()) / float(spec.skeleton.bone_lengths[list(children)].sum())
    if not 0.85 < ratio < 1.15:
        raise UserError(
            f"the motion's bones are {ratio:.2f} times as long as the uniform skeleton's; bring it to that size first "
            "(scenectl.data.features.to_uniform_skeleton)"
        )


class SeamGuide:
    """A guide towards the kept frames beside the seams, in the world, and towards another guide's goals."""

    def __init__(self, motion: Motion, kept: Bool[Tensor, " T"], others: Guide | None = None) -> None:
        self.others = others
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


def refined(step: Step, guide: Guide, solver: SolverSettings) -> Motion:
    """The motion that a guide finds likeliest near a step's own value."""
    if solver.iterations == 0:
        return step.motion
    shape, start = step.value.shape, step.value.detach().flatten(1)
    problem = Problem(lambda x: -guide.log_prob(step.at(x.unflatten(1, shape[1:]))), start, unit=step.unit)
    return step.at(minimise(problem, solver).value.unflatten(1, shape[1:])).motion


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
