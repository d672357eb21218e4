"""The last centimetre of targets: a smooth move of joints, without the decoder.

Near its end a search through the decoder pays a pass for each millimetre. What is within `Thresholds.reach` of its
targets is moved the rest of the way in the joints themselves: by the least move that is smooth in time and dies away
along the limbs. Rotations, velocities and contacts are derived from joints (`joints_to_features`), and so agree with
what was moved. A move is kept only where it is as small as that and meets the goals.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cache

import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor

from scenectl.control.settings import SolverSettings
from scenectl.control.thresholds import THRESHOLDS, Thresholds
from scenectl.generators.base import Price
from scenes.motion.motion import Motion
from scenes.motion.skeleton import Skeleton

SMOOTH = Price(product=0.3, row=0.15)
"""Products with a smooth move are two small matrices: 0.13 of its pass a row for 8 rows, and 0.3 for 48.

Measured by `scenectl bench prices --threads 1` (row "smooth").
"""


def polishing(settings: SolverSettings, thresholds: Thresholds = THRESHOLDS) -> SolverSettings:
    """For the search in joints: few steps of the solver that fits, for every sample that is near its targets."""
    fewer = min(settings.iterations, thresholds.polish_steps)
    return settings.model_copy(update={"name": "auto", "step": None, "enough": None, "iterations": fewer})


def kept(before: Motion, after: Motion, thresholds: Thresholds = THRESHOLDS) -> Bool[Tensor, " S"]:
    """Samples that were moved by little."""
    moved = ((after.joints - before.joints).norm(dim=-1) * before.valid[..., None]).amax((-2, -1))
    return moved <= thresholds.furthest * thresholds.reach


@dataclass(frozen=True)
class SmoothStep:
    """A `Step` whose value is spread over time and limbs and added to a finished motion.

    Attributes:
        value: moves before they are spread, m.
        base: the motion.
        price, unit: see `Step`; moves are in metres.
        time, limbs: over which moves spread, s and bones.
    """

    value: Float[Tensor, "S T J 3"]
    base: Motion
    price: Price = SMOOTH
    unit: float = 1.0
    time: float = THRESHOLDS.spread_time
    limbs: float = THRESHOLDS.spread_bones

    @classmethod
    def of(cls, base: Motion, thresholds: Thresholds = THRESHOLDS) -> SmoothStep:
        """No move yet."""
        time, limbs = thresholds.spread_time, thresholds.spread_bones
        return cls(torch.zeros_like(base.joints), base, time=time, limbs=limbs)

    def decode(self, value: Float[Tensor, "S T J 3"]) -> Motion:
        return replace(self.base, joints=self.base.joints + self._spread(value))

    def at(self, value: Float[Tensor, "S T J 3"]) -> SmoothStep:
        return replace(self, value=value)

    def take(self, samples: Int[Tensor, " s"]) -> SmoothStep:
        return replace(self, value=self.value[samples], base=self.base[samples])

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
        over_time = torch.exp(-0.5 * ((times[:, None] - times) / self.time).square())
        between = value.new_tensor(_bones_between(self.base.skeleton))
        joints = torch.exp(-between / self.limbs) @ value  # less with every bone between a joint and another
        return (over_time @ joints.flatten(-2)).unflatten(-1, joints.shape[-2:])


@cache
def _bones_between(skeleton: Skeleton) -> list[list[float]]:
    joints = len(skeleton.names)
    steps = [[0.0 if a == b else float("inf") for a in range(joints)] for b in range(joints)]
    for parent, child in skeleton.bones:  # parents precede children: a way to the parent leads on
        for other in range(child):
            steps[child][other] = steps[other][child] = steps[parent][other] + 1
    return steps
