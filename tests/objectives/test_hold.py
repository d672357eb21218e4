"""Things in hands, and what carries a body: against what it says in their docstrings, written out for each frame."""

from __future__ import annotations

import math

import numpy as np
import pytest
import torch
from torch import Tensor

from objectives import Context, Objective, Term
from objectives.library.held import PALM
from scenes.body.body import DEFAULT_BODY
from scenes.errors import UserError
from scenes.mesh.primitives import Box
from scenes.motion.headings import heading, rotation_about_y
from scenes.motion.motion import Motion
from scenes.world.moving import MovingObject, Trajectory
from scenes.world.scene import Scene
from tests.objectives.cases import standing, wandering

AT = (0.5, 1.0, 1.0)


def room(*shapes: Box) -> Context:
    box = MovingObject(Box((0.0, 0.0, 0.0), (0.3, 0.2, 0.1)), Trajectory((0.0,), (AT,)), "parcel")
    return Context(Scene(primitives=shapes, objects=[box]), DEFAULT_BODY)


def residual(parameters: dict[str, object], motion: Motion, where: Context) -> Tensor:
    return Term("hold", {"object": "parcel", **parameters}).residual(motion, where)


def palm(motion: Motion, side: str) -> Tensor:
    wrist, elbow = motion.joint(f"{side}_wrist"), motion.joint(f"{side}_elbow")
    return wrist + PALM * (wrist - elbow)


def test_a_thing_is_where_the_palm_and_the_heading_put_it() -> None:
    motion, offset = wandering(), (0.05, -0.1, 0.2)
    told = {"left": 0.05, "up": -0.1, "forward": 0.2, "position": list(AT)}
    turn = rotation_about_y(heading(motion, ("hip",)))
    middle = palm(motion, "right") + (turn @ motion.joints.new_tensor(offset))
    expected = (middle - motion.joints.new_tensor(AT)).norm(dim=-1)
    torch.testing.assert_close(residual(told, motion, room())[..., 1], expected)


def test_it_collides_with_the_scene_while_it_is_held() -> None:
    motion = Motion(standing(4))
    hand = palm(motion, "right")[0]
    wall = Box(tuple((hand + hand.new_tensor([0.0, 0.0, 0.28])).tolist()), (1.0, 1.0, 0.2))  # its face 18 cm ahead
    where = room(wall)
    for forward, depth in ((0.10, 0.0), (0.15, 0.02), (0.20, 0.07)):  # the parcel is 10 cm thick
        told = residual({"forward": forward}, motion, where)[..., 0]
        torch.testing.assert_close(told, torch.full_like(told, depth), atol=1e-6, rtol=0)


def test_both_palms_are_at_its_sides() -> None:
    motion = Motion(standing(3))
    apart = float((palm(motion, "left") - palm(motion, "right")).norm(dim=-1)[0])
    grips = residual({"hand": "both"}, motion, room())[..., 1:]
    torch.testing.assert_close(grips, torch.full_like(grips, apart / 2 - 0.15 - 0.01), atol=1e-6, rtol=0)
    turned = residual({"hand": "both", "facing": math.pi / 2}, motion, room())[..., 1:]  # from there it is 10 cm wide
    torch.testing.assert_close(turned, torch.full_like(turned, apart / 2 - 0.05 - 0.01), atol=1e-6, rtol=0)


def test_what_is_elsewhere_is_not_in_the_way() -> None:
    thing = MovingObject(Box(AT, (0.2, 0.2, 0.2)), Trajectory((0.0,), ((0.0, 0.0, 0.0),)), "parcel", gone=((1.0, 2.0),))
    points = torch.tensor([AT], dtype=torch.float64).expand(3, 3)
    times = torch.tensor([0.5, 1.5, 2.5])
    near = thing.distance(points, times)
    assert near[0] == near[2] == pytest.approx(-0.1) and near[1] > 1.0
    np.testing.assert_allclose(thing.distance_exact(points.numpy(), times.numpy()), near.numpy())


def test_things_that_cannot_be_held_are_named() -> None:
    motion = wandering()
    with pytest.raises(UserError, match="no part 'parcle'; did you mean 'parcel'"):
        Term("hold", {"object": "parcle"}).residual(motion, room())


@pytest.mark.parametrize("lift", [0.0, 0.05, 0.3])
def test_somebody_is_carried_by_what_is_nearest(lift: float) -> None:
    """A body whose lowest sole is so far over the floor is carried by nothing, unless a table is under its hand."""
    joints = standing(3) + torch.tensor([0.0, DEFAULT_BODY.sole_offset + lift, 0.0], dtype=torch.float64)
    motion, empty = Motion(joints), Context(Scene.empty(), DEFAULT_BODY)
    term = Term("support")
    assert term.report(motion, empty)[0].worst == pytest.approx(lift, abs=0.004)
    points, radius = DEFAULT_BODY.points(motion)
    hand = next(i for i, owner in enumerate(DEFAULT_BODY.owners) if owner == "right_wrist")
    x, y, z = points[0, hand].tolist()
    table = Box((x, y - float(radius[hand]) - 0.05, z), (0.1, 0.1, 0.1))
    assert term.report(motion, Context(Scene(primitives=[table]), DEFAULT_BODY))[0].worst == pytest.approx(0, abs=1e-3)


def test_soft_parts_give() -> None:
    cushion = Box((0.0, 0.25, 0.0), (0.5, 0.5, 0.5)).mesh()
    hard, soft = (Scene([cushion], floor=0.0, cache=None, resolution=64, soft=give) for give in ({}, {"box": 0.05}))
    part = hard.meshes[0].name
    soft.soft = {part: 0.05}
    points = torch.tensor([[0.0, 0.5 - depth, 0.0] for depth in (-0.2, 0.02, 0.04, 0.08)])
    near = soft.distance(points)
    torch.testing.assert_close(near[1:], hard.distance(points)[1:] + 0.05, atol=2e-3, rtol=0)
    assert near[1] > 0 and near[2] > 0 > near[3]
    exact = soft.distance_exact(points.double().numpy())
    np.testing.assert_allclose(exact, np.array([0.2, -0.02, -0.04, -0.08]) + 0.05, atol=1e-3)
    assert soft.digest != hard.digest
    motion = Motion(standing(3))
    told = Term("contact", {"part": "seat", "surface": part})
    depths = [Objective((told,)).report(motion, Context(s, DEFAULT_BODY))[0][0].series for s in (hard, soft)]
    assert depths[0] is not None and depths[1] is not None
