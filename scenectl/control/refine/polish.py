"""The last centimetre of targets: a smooth move of joints, without the decoder.

Near its end a search through the decoder pays a pass for each millimetre. What is within `REACH` of its targets is
moved the rest of the way in the joints themselves: by the least move that is smooth in time and dies away along the
limbs. Nothing goes stale by it, as motions are joints: whoever needs rotations, velocities and contacts derives them
from these (`joints_to_features`), and so they agree with what was moved. It is kept only where it is as small as that,
strains no bone, and the goals are the better for it.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cache

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from objectives import Objective
from scenectl.control.refine.natural import bone_errors
from scenectl.control.settings import SolverSettings
from scenectl.generators.base import Price
from scenes.motion.motion import Motion
from scenes.motion.skeleton import Skeleton

REACH = 0.01
"""Metres from their targets at which searches through a decoder end, and polishing begins."""
_FURTHEST, _STRETCH = 3 * REACH, 0.5 * REACH
"""Metres by which a joint may be moved, and by which the bones of a frame may be further from their lengths for it."""
_ITERATIONS = 20
SMOOTH = Price(product=0.1, row=0.05)
"""Moves need no decoder: products are two small matrices."""
_SECONDS, _BONES = 0.15, 3.0
"""Spread of a move over time (standard deviation), and along the limbs (to 1/e)."""


def loosened(objective: Objective) -> Objective:
    """The objective, with targets counting as met as soon as they are in reach of polishing."""
    return Objective(tuple(term.loosened(REACH) for term in objective.terms))


def polishing(settings: SolverSettings) -> SolverSettings:
    """For the search in joints, whose numbers are metres: none of what was set for a decoder's fits."""
    return SolverSettings(iterations=min(settings.iterations, _ITERATIONS))


def bearable(before: Motion, after: Motion) -> Bool[Tensor, " S"]:
    """Samples that were moved by little and keep their bones."""
    moved = ((after.joints - before.joints).norm(dim=-1) * before.valid[..., None]).amax((-2, -1))
    stretched = (bone_errors(after) - bone_errors(before)).amax(-1)
    return (moved <= _FURTHEST) & (stretched <= _STRETCH)


@dataclass(frozen=True)
class SmoothStep:
    """A `Step` whose value is spread over time and limbs and added to a finished motion.

    Attributes:
        value: moves before they are spread, m.
        base: the motion.
    """

    value: Float[Tensor, "S T J 3"]
    base: Motion
    price: Price = SMOOTH
    unit: float = 1.0

    @classmethod
    def of(cls, base: Motion) -> SmoothStep:
        """No move yet."""
        return cls(torch.zeros_like(base.joints), base)

    def decode(self, value: Float[Tensor, "S T J 3"]) -> Motion:
        return replace(self.base, joints=self.base.joints + self._spread(value))

    def at(self, value: Float[Tensor, "S T J 3"]) -> SmoothStep:
        return replace(self, value=value)

    @property
    @torch.no_grad()
    def motion(self) -> Motion:
        return self.decode(self.value)

    def jvp(self, tangent: Float[Tensor, "S T J 3"]) -> Float[Tensor, "S T J 3"]:
        return self._spread(tangent)

    def vjp(self, cotangent: Float[Tensor, "S T J 3"]) -> Float[Tensor, "S T J 3"]:
        return self._spread(cotangent)  # both spreads are symmetric

    def vjps(self, cotangents: Float[Tensor, "R S T J 3"]) -> Float[Tensor, "R S T J 3"]:
        return self._spread(cotangents)

    def _spread(self, value: Float[Tensor, "*r S T J 3"]) -> Float[Tensor, "*r S T J 3"]:
        times = torch.arange(self.base.frames, dtype=value.dtype, device=value.device) / self.base.fps
        over_time = torch.exp(-0.5 * ((times[:, None] - times) / _SECONDS).square())
        joints = _along_limbs(self.base.skeleton).to(value) @ value
        return (over_time @ joints.flatten(-2)).unflatten(-1, joints.shape[-2:])


def _along_limbs(skeleton: Skeleton) -> Float[Tensor, "J J"]:
    """How much of a joint's move each other joint shares: less with every bone between them."""
    return torch.exp(-torch.tensor(_bones_between(skeleton)) / _BONES)


@cache
def _bones_between(skeleton: Skeleton) -> list[list[float]]:
    joints = len(skeleton.names)
    steps = [[0.0 if a == b else float("inf") for a in range(joints)] for b in range(joints)]
    for parent, child in skeleton.bones:  # parents precede children: whatever leads to the parent leads on
        for other in range(child):
            steps[child][other] = steps[other][child] = steps[parent][other] + 1
    return steps
