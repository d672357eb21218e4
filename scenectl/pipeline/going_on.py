"""Motions that go on from the last frames of others, without a jump of place or speed.

The frames before are kept as an editor keeps them, and goals count as in any generation: guidance and refinement are
those of `make`. Refinement sees motions as they will be: with the frames before as they are, and what is left of a jump
dying away over the first frames made anew.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial

import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor

from objectives import Context, Objective, Term
from scenectl.control import Figure, GuidanceSettings, ObjectiveGuide, SolverSettings, refine
from scenectl.control.refine.polish import SmoothStep
from scenectl.control.rise import Rise
from scenectl.generators.base import EditingGenerator, Progress, Step, silent
from scenectl.generators.prompts import Prompts
from scenectl.generators.steps import MappedStep
from scenectl.pipeline.generation import Made
from scenectl.pipeline.parts import CONTEXT
from scenectl.pipeline.seams import settled
from scenes.motion.motion import Motion
from scenes.motion.rigid import rigid
from scenes.motion.skeleton import FEET

SOON = 5
"""Frames over which what is left of a jump dies away. It is a centimetre or two, but a difference of speeds carries
feet the further the longer it takes to die: over `SETTLE` frames, centimetres into the floor. Ours."""
CALM, WEIGHT = 15.0, 10.0
"""Acceleration (m/s²) at the seam from which on it costs, and the weight of that goal: a jump is then searched away and
not only smoothed. Half of what 99 % of the joints of recorded people stay below (`smoothness`). Ours."""


@dataclass(frozen=True)
class Lead:
    """The frames before, and the time of those to come.

    Attributes:
        motion: the last frames of what is gone on from, a motion for each sample, ``[S, T, J, 3]`` on the task's clock.
        frames: to be made after them.
    """

    motion: Motion
    frames: int

    @classmethod
    def of(cls, motion: Motion, frames: int) -> Lead:
        """The last two seconds of motions ``[S, T, J, 3]``, or all of them."""
        first = max(motion.frames - CONTEXT, 0)
        return cls(unpadded(motion, motion.joints[:, first:], t0=motion.t0 + first / motion.fps), frames)

    @property
    def whole(self) -> Motion:
        """The frames before, and the last of them for as long as those to come."""
        last = self.motion.joints[:, -1:].expand(-1, self.frames, -1, -1)
        return unpadded(self.motion, torch.cat([self.motion.joints, last], dim=1))

    @property
    def unknown(self) -> Bool[Tensor, " T"]:
        """Which frames of `whole` are to be made."""
        return torch.arange(self.motion.frames + self.frames) >= self.motion.frames

    @property
    def begin(self) -> float:
        """When the first frame to come is (s)."""
        return self.motion.t0 + self.motion.frames / self.motion.fps

    @property
    def calm(self) -> Term:
        """The goal that leaves no jump."""
        window = (self.begin - 1.5 / self.motion.fps, self.begin + (SOON + 0.5) / self.motion.fps)
        return Term("smoothness", {"limit": CALM}, WEIGHT, window=window, name="goes on")


@dataclass(frozen=True)
class SeamStep(MappedStep):
    """A step whose motions are seen after the frames that they go on from.

    Attributes:
        before: those frames and as many more, of every sample, ``[S, T, J, 3]``.
        unknown: which of them the step makes.
    """

    before: Motion
    unknown: Bool[Tensor, " T"]

    @classmethod
    def of(cls, step: Step, before: Motion, unknown: Bool[Tensor, " T"]) -> SeamStep:
        """The step of all samples."""
        return cls(step, partial(_after, before, unknown), before, unknown)

    def take(self, samples: Int[Tensor, " s"]) -> SeamStep:
        before = replace(self.before, joints=self.before.joints[samples], valid=self.before.valid[samples])
        return SeamStep.of(self.inner.take(samples), before, self.unknown)


def _after(before: Motion, unknown: Bool[Tensor, " T"], made: Motion) -> Motion:
    # A cubic carries joints and not bones, whose lengths a search must know: they decide how deep a foot is.
    return rigid(settled(before, made, unknown, SOON), before.skeleton)


def go_on(
    generator: EditingGenerator,
    lead: Lead,
    prompts: Prompts,
    objective: Objective,
    context: Context,
    *,
    solver: SolverSettings | None = None,
    guidance: GuidanceSettings | None = None,
    seed: int = 0,
    progress: Progress = silent,
) -> Made:
    """Frames that go on from motions towards those goals of an objective that are about them.

    Args:
        generator: one that can edit, of windows as long as the lead and what is made.
        lead: the frames before, of every sample.
        prompts: sentences of the whole motion, on the task's clock.
        objective, context, solver, guidance, seed, progress: as `make` takes them.

    Returns:
        The new frames alone, ``[S, frames, J, 3]``.
    """
    before, spec = lead.motion, generator.spec
    goals = about(objective, context, lead.whole, before.frames)
    level = _levelled(goals)(lead.whole)
    x, _, z = level.joint("pelvis")[0, 0].tolist()
    ground = (x, float(level.select(FEET)[..., 1].min()), z)
    there = Figure.between(before.skeleton, spec.skeleton, ground)
    back = Figure.between(spec.skeleton, before.skeleton, ground)
    given = level if there is None else there.of(level)
    goals = Objective((*goals.terms, lead.calm))
    guide = ObjectiveGuide(goals, context, guidance, figure=back)
    said = prompts.within(before.t0, lead.begin + lead.frames / before.fps)
    samples = len(before.joints)
    draft = generator.edit(given, lead.unknown, said, guide=guide, samples=samples, seed=seed, progress=progress)
    made = MappedStep(SmoothStep.of(draft.motion), rigid) if draft.step is None else draft.step
    step = SeamStep.of(made, given, lead.unknown)
    refined = refine(step, goals, context, solver, None, progress, back)
    return Made(_new(refined.motion, lead), _new(refined.unrefined, lead), refined.solution, draft.trace)


def about(objective: Objective, context: Context, motion: Motion, first: int = 0) -> Objective:
    """Those goals of an objective that are about some frame of motions ``[*b, T, J, 3]`` from the `first` on."""
    begin, end = motion.t0 + first / motion.fps, motion.t0 + (motion.frames - 0.5) / motion.fps

    def counts(term: Term) -> bool:
        if term.sometime is not None:  # where it ends: until then its moment may be yet to come
            return begin <= term.sometime[1] <= end
        with torch.no_grad():
            return bool(term.evaluate(motion, context).mask[..., first:, :].any())

    return Objective(tuple(term for term in objective.counted if counts(term)))


def ending(motion: Motion, fps: float) -> Motion:
    """One motion without its padding, at so many frames a second, of which the last is its last."""
    turned = replace(motion, joints=motion.joints.flip(0), valid=motion.valid.flip(0))
    back = on_clock(turned, fps)
    return unpadded(back, back.joints.flip(0))


def on_clock(motion: Motion, fps: float) -> Motion:
    """One motion without its padding, at a generator's frames a second."""
    real = replace(motion, joints=motion.joints[motion.valid], valid=motion.valid[motion.valid])
    return real if real.fps == fps else real.resampled(fps)


def unpadded(like: Motion, joints: Float[Tensor, "*b T J 3"], t0: float | None = None) -> Motion:
    """A motion of these joints without padding, otherwise as another."""
    return Motion(joints, fps=like.fps, t0=like.t0 if t0 is None else t0, skeleton=like.skeleton)


def _levelled(objective: Objective) -> Callable[[Motion], Motion]:
    """Takes off a motion by how much a path's ground lies higher under it, as generators know level ground alone."""
    rise = Rise.of(objective)

    def level(motion: Motion) -> Motion:
        return motion if rise is None else replace(motion, joints=2 * motion.joints - rise.under(motion).joints)

    return level


def _new(made: Motion, lead: Lead) -> Motion:
    """The new frames ``[S, n, J, 3]`` of a made window."""
    return unpadded(made, made.joints[:, lead.motion.frames :], t0=lead.begin)
