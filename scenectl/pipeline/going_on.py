"""Motions that go on from the last frames of another, without a jump of place or speed.

The frames before are kept as an editor keeps them, and goals count as in any generation: guidance and refinement are
those of `make`, with a few joints of the last kept frames as further goals. What then remains of a jump dies away over
the first frames made anew.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from objectives import Context, Objective, Term
from scenectl.control import Figure, GuidanceSettings, ObjectiveGuide, SolverSettings, refine
from scenectl.control.refine.polish import SmoothStep
from scenectl.control.rise import Rise
from scenectl.generators.base import EditingGenerator, Progress, silent
from scenectl.generators.prompts import Prompts
from scenectl.generators.steps import MappedStep
from scenectl.pipeline.generation import Made
from scenectl.pipeline.parts import CONTEXT
from scenectl.pipeline.seams import BESIDE, settled
from scenes.motion.motion import Motion
from scenes.motion.rigid import rigid
from scenes.motion.skeleton import FEET

HELD = (("pelvis", "head"), ("left_ankle", "right_ankle"), ("left_wrist", "right_wrist"))
"""Joints of the last kept frames that refinement holds: where a body is, how it is turned, and what it does with its
limbs. In pairs, as goals for three joints at once count as poses (`Thresholds.body_joints`)."""
HOLD, WITHIN = 1.0, 0.03
"""Weight of each of these goals, and metres within which they count as met: what is left of a jump dies away. Ours."""

SOON = 5
"""Frames over which what is left of a jump dies away. It is a centimetre or two, but a difference of speeds carries
feet the further the longer it takes to die: over `SETTLE` frames, centimetres into the floor. Ours."""


@dataclass(frozen=True)
class Lead:
    """The frames before, and the time of those to come.

    Attributes:
        motion: the last frames of what is gone on from, ``[T, J, 3]`` on the task's clock.
        frames: to be made after them.
    """

    motion: Motion
    frames: int

    @classmethod
    def of(cls, motion: Motion, frames: int) -> Lead:
        """The last two seconds of a motion ``[T, J, 3]``, or all of it."""
        first = max(motion.frames - CONTEXT, 0)
        return cls(unpadded(motion, motion.joints[first:], t0=motion.t0 + first / motion.fps), frames)

    @property
    def whole(self) -> Motion:
        """The frames before, and the last of them for as long as those to come."""
        joints = torch.cat([self.motion.joints, self.motion.joints[-1:].expand(self.frames, -1, -1)])
        return unpadded(self.motion, joints)

    @property
    def unknown(self) -> Bool[Tensor, " T"]:
        """Which frames of `whole` are to be made."""
        return torch.arange(self.motion.frames + self.frames) >= self.motion.frames

    @property
    def begin(self) -> float:
        """When the first frame to come is (s)."""
        return self.motion.t0 + self.motion.frames / self.motion.fps

    def held(self) -> tuple[Term, ...]:
        """Goals for the last frames before."""
        last = self.motion.joints[-BESIDE:]
        begin = self.motion.t0 + (self.motion.frames - len(last)) / self.motion.fps
        asked = {"clip": unpadded(self.motion, last), "frame": "world", "begin": begin}
        return tuple(
            Term("like", {**asked, "joints": list(pair)}, HOLD, WITHIN, name=f"goes on: {pair[0]}") for pair in HELD
        )


def go_on(
    generator: EditingGenerator,
    lead: Lead,
    prompts: Prompts,
    objective: Objective,
    context: Context,
    *,
    solver: SolverSettings | None = None,
    guidance: GuidanceSettings | None = None,
    samples: int = 1,
    seed: int = 0,
    progress: Progress = silent,
) -> Made:
    """Frames that go on from a motion towards those goals of an objective that are about them.

    Args:
        generator: one that can edit, of windows as long as the lead and what is made.
        lead: the frames before.
        prompts: sentences of the whole motion, on the task's clock.
        objective, context, solver, guidance, samples, seed, progress: as `make` takes them.

    Returns:
        The new frames alone, ``[samples, frames, J, 3]``.
    """
    before, spec = lead.motion, generator.spec
    goals = about(objective, context, lead.whole, before.frames)
    fall = _flattened(goals)
    x, _, z = before.joint("pelvis")[0].tolist()
    level = fall(before)
    ground = (x, float(level.select(FEET)[..., 1].min()), z)
    there, back = (
        Figure.between(*pair, ground) for pair in ((before.skeleton, spec.skeleton), (spec.skeleton, before.skeleton))
    )
    given = fall(lead.whole) if there is None else there.of(fall(lead.whole))
    guided = Objective((*goals.terms, *lead.held()))
    guide = ObjectiveGuide(guided, context, guidance, figure=back)
    said = prompts.within(max(before.t0, 0.0), before.t0 + len(lead.unknown) / before.fps)
    draft = generator.edit(given, lead.unknown, said, guide=guide, samples=samples, seed=seed, progress=progress)
    step = MappedStep(SmoothStep.of(draft.motion), rigid) if draft.step is None else draft.step
    refined = refine(step, guided, context, solver, None, progress, back)
    return Made(_new(refined.motion, lead), _new(refined.unrefined, lead), refined.solution, draft.trace)


def about(objective: Objective, context: Context, motion: Motion, first: int = 0) -> Objective:
    """Those goals of an objective that are about some frame of a motion ``[T, J, 3]`` from the `first` on."""
    with torch.no_grad():
        return Objective(tuple(t for t in objective.counted if bool(t.evaluate(motion, context).mask[first:].any())))


def unpadded(like: Motion, joints: Float[Tensor, "*b T J 3"], t0: float | None = None) -> Motion:
    """A motion of these joints without padding, otherwise as another."""
    return Motion(joints, fps=like.fps, t0=like.t0 if t0 is None else t0, skeleton=like.skeleton)


def on_clock(motion: Motion, fps: float) -> Motion:
    """One motion without its padding, at a generator's frames a second."""
    real = replace(motion, joints=motion.joints[motion.valid], valid=motion.valid[motion.valid])
    return real if real.fps == fps else real.resampled(fps)


def _flattened(objective: Objective) -> Callable[[Motion], Motion]:
    """Takes off a motion by how much a path's ground lies higher under it, as generators know level ground alone."""
    rise = Rise.of(objective)

    def level(motion: Motion) -> Motion:
        return motion if rise is None else replace(motion, joints=2 * motion.joints - rise.under(motion).joints)

    return level


def _new(made: Motion, lead: Lead) -> Motion:
    """The new frames ``[S, n, J, 3]`` of a made window, after which nothing is left of a jump."""
    # Bones that a cubic carries change their lengths by little; their directions stay.
    smooth = rigid(settled(lead.whole, made, lead.unknown, SOON), lead.motion.skeleton)
    first = lead.motion.frames
    return unpadded(smooth, smooth.joints[..., first:, :, :], t0=lead.begin)
