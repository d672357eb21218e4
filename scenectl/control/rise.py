"""Ground that rises and falls under a motion: generators make motions on level ground, and a path tells how it lies.

Without it, a generator's body stays at the height of its start: going up, the scene pushes it; going down, nothing
does, and a search stretches or folds legs instead. Like moves of a free start, generators know nothing of this.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property

import torch
from jaxtyping import Float, Int
from torch import Tensor

from objectives import Objective
from objectives.library.paths import risen
from scenectl.generators.base import Step
from scenectl.generators.steps import AroundStep, pullback
from scenes.motion.motion import Motion
from scenes.motion.skeleton import FEET

_SOFT = 0.05
"""Metres over which the higher ground passes from foot to foot, so that bodies don't jerk; none on level ground."""


@dataclass(frozen=True)
class Rise:
    """How much higher or lower than at its beginning a path lies under a body.

    Attributes:
        path: what `follow_path` was told, its `height` included.
    """

    path: dict[str, object]

    @classmethod
    def of(cls, objective: Objective) -> Rise | None:
        """Of the first goal that keeps a height over a path; None where none does."""
        found = (t.parameters for t in objective.counted if t.spec.name == "follow_path")
        return next((cls(dict(given)) for given in found if given.get("height") is not None), None)

    def under(self, motion: Motion) -> Motion:
        """The motion with whole bodies, whose limbs stay as they are, on the higher of the grounds under their feet.

        Steps are walls to a foot that is too low, and out of walls no search leads; one that is too high is let down.
        """
        feet = torch.stack([risen(motion, **{**self.path, "joint": foot}) for foot in FEET])  # type: ignore[arg-type]
        higher = _SOFT * (torch.logsumexp(feet / _SOFT, dim=0) - math.log(len(FEET)))
        lift = higher[..., None, None] * motion.joints.new_tensor([0.0, 1.0, 0.0])
        return replace(motion, joints=motion.joints + lift)


@dataclass(frozen=True)
class RisenStep(AroundStep):
    """A step over ground that rises and falls.

    Attributes:
        inner: the step as its generator made it, on level ground.
        rise: of the ground.
    """

    inner: Step
    rise: Rise

    @property
    def value(self) -> Float[Tensor, "S *v"]:
        return self.inner.value

    def decode(self, value: Float[Tensor, "S *v"]) -> Motion:
        return self.rise.under(self.inner.decode(value))

    def at(self, value: Float[Tensor, "S *v"]) -> RisenStep:
        return RisenStep(self.inner.at(value), self.rise)

    def take(self, samples: Int[Tensor, " s"]) -> RisenStep:
        return RisenStep(self.inner.take(samples), self.rise)

    @cached_property
    def motion(self) -> Motion:
        with torch.no_grad():
            return self.rise.under(self.inner.motion)

    def jvp(self, tangent: Float[Tensor, "S *v"]) -> Float[Tensor, "S T J 3"]:
        dummy, pulled = self._pullback
        (joints,) = torch.autograd.grad(pulled, dummy, self.inner.jvp(tangent), retain_graph=True)
        return joints

    def vjp(self, cotangent: Float[Tensor, "S T J 3"]) -> Float[Tensor, "S *v"]:
        return self.inner.vjp(self._level(cotangent[None])[0])

    def vjps(self, cotangents: Float[Tensor, "R S T J 3"]) -> Float[Tensor, "R S *v"]:
        return self.inner.vjps(self._level(cotangents))

    def _risen(self, joints: Float[Tensor, "*b T J 3"]) -> Float[Tensor, "*b T J 3"]:
        level = self.inner.motion
        return self.rise.under(Motion(joints, fps=level.fps, t0=level.t0, skeleton=level.skeleton)).joints

    def _level(self, cotangents: Float[Tensor, "R S T J 3"]) -> Float[Tensor, "R S T J 3"]:
        """Gradients in the joints on level ground."""
        joints = self.inner.motion.joints.expand(cotangents.shape).detach().requires_grad_(True)
        with torch.enable_grad():
            risen = self._risen(joints)
        return torch.autograd.grad(risen, joints, cotangents)[0]

    @cached_property
    def _pullback(self) -> tuple[Tensor, Tensor]:
        return pullback(self._risen, self.inner.motion.joints)
