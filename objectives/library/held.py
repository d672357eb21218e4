"""Things in hands: where a thing is that a hand holds, and what it touches there."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from itertools import product
from typing import Any, Literal

import torch
from jaxtyping import Float
from torch import Tensor

from objectives.context import Context, Parted
from objectives.marks import Mark
from objectives.maths import length
from objectives.parameters import Point
from objectives.registry import Masked, goal
from scenes.errors import UserError
from scenes.motion.headings import heading, turned as turned_about_y
from scenes.motion.motion import Motion
from scenes.world.moving import MovingObject

Hand = Literal["left", "right", "both"]
PALM = 0.27
"""Share of the forearm by which the palm's middle is beyond the wrist (`scenes.body.body`)."""
_LOOSE = 0.01
"""Metres by which a palm may be off its side of a thing for nothing."""
_SHOWN = 0.03
"""Radius (m) of the ball that shows where its middle shall be."""
_CORNERS = 3
"""Points along each side of a thing's box at which it is asked whether it touches something."""


@dataclass(frozen=True)
class Grip:
    """How a thing is held: it goes where the palm goes, and turns about the vertical as the pelvis does.

    A cup stays upright whichever way the forearm turns, so a thing is not rigid to the forearm.

    Attributes:
        thing: as it rests before.
        hand: "left", "right", or "both", between whose palms it is.
        offset: from the palm, or the middle of both, to the thing's middle, m: to the left, up and forward.
        facing: the pelvis's heading (rad) at which the thing is turned as it rests.
    """

    thing: MovingObject
    hand: Hand
    offset: tuple[float, float, float]
    facing: float

    @classmethod
    def of(cls, parameters: Mapping[str, Any], context: Context) -> Grip:
        """What a goal `hold` was told; raises UserError for a thing that the scene does not have."""
        name = parameters["object"]
        if not isinstance(context.scene, Parted):
            raise UserError("this scene has no things with names to hold")
        thing = context.scene.part(name)
        if not isinstance(thing, MovingObject) or not thing.loose:
            raise UserError(f"'{name}' is part of a mesh and cannot be taken; state it as a [[scene.objects]] table")
        given = (float(parameters.get(key, 0.0)) for key in ("left", "up", "forward", "facing"))
        left, up, forward, facing = given
        return cls(thing, parameters.get("hand", "right"), (left, up, forward), facing)

    def middle(self, motion: Motion) -> Float[Tensor, "*b T 3"]:
        """Of the thing at every frame, world m."""
        palms = self.palms(motion)
        place = sum(palms.values(), start=torch.zeros_like(motion.joints[..., 0, :])) / len(palms)
        return place + turned_about_y(place.new_tensor(self.offset), heading(motion, ("hip",)))

    def palms(self, motion: Motion) -> dict[str, Float[Tensor, "*b T 3"]]:
        """Middles of the palms that hold it, world m."""
        sides = ("left", "right") if self.hand == "both" else (self.hand,)
        joints = {side: (motion.joint(f"{side}_wrist"), motion.joint(f"{side}_elbow")) for side in sides}
        return {side: wrist + PALM * (wrist - elbow) for side, (wrist, elbow) in joints.items()}

    def points(self, motion: Motion) -> Float[Tensor, "*b T P 3"]:
        """Points of the thing's box at every frame, world m."""
        turn = (heading(motion, ("hip",)) - self.facing)[..., None]
        return self.middle(motion)[..., None, :] + turned_about_y(self._box.to(motion.joints), turn)

    @property
    def rest(self) -> tuple[Float[Tensor, "3"], Float[Tensor, "3 3"], Float[Tensor, "3"]]:
        """Middle of the thing as it rests (m, world), its rotation, and the middle in its own frame."""
        place, rotation = self.thing.trajectory.at(torch.zeros((), dtype=torch.float64))
        own = self._bounds.mean(0)
        return rotation @ own + place, rotation, own

    @property
    def halves(self) -> Float[Tensor, "3"]:
        """Half of the thing's size to the left, up and forward of somebody who faces it, m."""
        size = (self._bounds[1] - self._bounds[0]) / 2
        axes = turned_about_y(torch.eye(3, dtype=torch.float64), torch.tensor(self.facing, dtype=torch.float64))
        return (axes @ self.rest[1]).abs() @ size

    @property
    def _bounds(self) -> Float[Tensor, "2 3"]:
        """Lowest and highest corner in the thing's own frame, m."""
        return torch.tensor(self.thing.solid.bounds, dtype=torch.float64)

    @property
    def _box(self) -> Float[Tensor, "P 3"]:
        """Points of the box about the thing at rest, seen from its middle, world directions, m."""
        low, high = self._bounds
        shares = torch.tensor(list(product(torch.linspace(-1, 1, _CORNERS).tolist(), repeat=3)), dtype=torch.float64)
        surface = shares[shares.abs().amax(-1) == 1]
        return (surface * (high - low) / 2) @ self.rest[1].T


@goal(unit="m", kernel="squared", reduction="sum", scale=200.0, tolerance=0.03, local=True)
def hold(
    motion: Motion,
    context: Context,
    *,
    object: str,
    hand: Hand = "right",
    left: float = 0.0,
    up: float = 0.0,
    forward: float = 0.0,
    facing: float = 0.0,
    position: Point | None = None,
    turned: float | None = None,
) -> Masked:
    """Hold a thing of the scene in a hand, or between both.

    The thing's middle is at c_t = h_t + R(a_t) o, with h_t the palm, or the middle of both palms, a_t the pelvis's
    heading and o = (left, up, forward); it turns about the vertical as the pelvis does. Residuals, m: how deep the
    deepest of 26 points of its box is in the scene, max(0, -min_p phi(p)); with both hands, how far each palm is from
    its side of the box, beyond 1 cm; and |c_t - position|. Ours; no paper states it. The scale is that of
    `joint_target`.

    While some goal of a task holds a thing, it is not where it rested, and after the last one it stays where that
    put it.

    Args:
        object: name of a [[scene.objects]] table that rests.
        hand: "left", "right" or "both".
        left, up, forward: from the palm to the thing's middle as the body faces, m.
        facing: the body's heading (rad) at which the thing is turned as it rests.
        position: where the thing's middle shall be, world m: where it rests when it is taken, and where it is put.
        turned: the body's heading (rad) when it is put, by which it stands turned from then on.

    Raises:
        UserError: a thing that the scene does not have, or that is part of a mesh.
    """
    told = {"object": object, "hand": hand, "left": left, "up": up, "forward": forward, "facing": facing}
    grip = Grip.of(told, context)
    middle, points = grip.middle(motion), grip.points(motion)
    room = context.scene.distance(points, motion.times[:, None]).amin(-1)
    parts, labels = [(-room).clamp_min(0)], ["depth"]
    owner = f"{'right' if hand == 'both' else hand}_wrist"
    if hand == "both":
        aside = turned_about_y(middle.new_tensor([1.0, 0.0, 0.0]), heading(motion, ("hip",))) * float(grip.halves[0])
        palms = grip.palms(motion)
        off = [length(palms[side] - middle - sign * aside) for side, sign in (("left", 1.0), ("right", -1.0))]
        parts += [(each - _LOOSE).clamp_min(0) for each in off]
        labels += ["left grip", "right grip"]
    if position is not None:
        parts.append(length(middle - middle.new_tensor(position)))
        labels.append("place")

    def marks() -> list[Mark]:
        return [] if position is None else [Mark("ball", torch.tensor([list(position)]), _SHOWN)]

    return Masked(
        torch.stack(parts, dim=-1), labels=[f"{object} ({what})" for what in labels], joints=[owner] * len(parts),
        points=middle[..., None, :].expand(*middle.shape[:-1], len(parts), 3), marks=marks,
    )  # fmt: skip
