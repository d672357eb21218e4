"""Motions of one body as another makes them: steps as long as its legs are, bones of its own lengths.

A generator knows one skeleton. What it makes for another body is scaled about the ground where it starts, by the
ratio of the legs, and keeps the directions of its bones. Times stay: a child takes as many steps a second as an adult,
and so is slower in proportion to its legs. (By Froude's number people of other sizes walk alike at speeds in
proportion to the square root of the legs; at 1.25 m that is 17 % faster, with quicker steps.)
"""

from __future__ import annotations

from dataclasses import dataclass, replace

from jaxtyping import Float
from torch import Tensor

from scenectl.generators.base import Guide, Step
from scenectl.generators.steps import MappedStep
from scenes.errors import UserError
from scenes.motion.motion import Motion
from scenes.motion.rigid import rigid
from scenes.motion.skeleton import Skeleton

Ground = tuple[float, float, float]


@dataclass(frozen=True)
class Figure:
    """The way from motions on one skeleton to those on another. It is differentiable; for one size alone it is linear.

    Attributes:
        skeleton: that motions come to be on.
        ratio: of its legs to those of the skeleton they were made on.
        ground: the point (m) that stays, at the height where feet stand.
    """

    skeleton: Skeleton
    ratio: float
    ground: Ground

    @classmethod
    def between(cls, made: Skeleton, body: Skeleton, ground: Ground) -> Figure | None:
        """From motions that are made on a skeleton to a body's; None where they are the same.

        Raises UserError for a body of other joints.
        """
        if made.names != body.names:
            raise UserError(f"the body has {len(body.names)} joints of its own; motions are made for {len(made.names)}")
        return None if made == body else cls(body, body.legs / made.legs, ground)

    def of(self, motion: Motion) -> Motion:
        """The motion as this body makes it."""
        root = motion.joints[..., :1, :]
        moved = replace(motion, joints=motion.joints + (self.place(root) - root))
        return rigid(moved, self.skeleton)

    def place(self, points: Float[Tensor, "*b 3"]) -> Float[Tensor, "*b 3"]:
        """Where points (m) on the way of the one body are on the other's."""
        ground = points.new_tensor(self.ground)
        return ground + self.ratio * (points - ground)

    def back(self, points: Float[Tensor, "*b 3"]) -> Float[Tensor, "*b 3"]:
        """The inverse of `place`."""
        ground = points.new_tensor(self.ground)
        return ground + (points - ground) / self.ratio


@dataclass(frozen=True)
class FigureGuide:
    """A guide that knows a body's motions, asked about steps on the skeleton that they are made on.

    Attributes:
        guide: the guide.
        figure: the body's.
    """

    guide: Guide
    figure: Figure

    def log_prob(self, step: Step) -> Float[Tensor, " S"]:
        return self.guide.log_prob(MappedStep(step, self.figure.of))

    def gradient(self, step: Step) -> Float[Tensor, "S *v"]:
        return self.guide.gradient(MappedStep(step, self.figure.of))
