"""Staying natural while goals pull: feet that do not slide, joints that do not jerk."""

from __future__ import annotations

import torch

from objectives.context import Context
from objectives.library._joints import Joints, placed
from objectives.library.scene import foot_heights
from objectives.maths import beyond
from objectives.parameters import NotNegative, Positive
from objectives.registry import Masked, goal
from scenes.motion import Motion


@goal(unit="m/s", kernel="squared", reduction="mean", tolerance=0.5, dim=2)
def foot_skating(
    motion: Motion,
    context: Context,
    *,
    height: Positive = 0.05,
    allowed: NotNegative = 0.1,
    feet: list[str] = ["left_foot", "right_foot"],  # noqa: B006  (read only)
) -> Masked:
    """Keep feet that are near the ground from sliding over it.

    Residual: horizontal velocity of the foot from one frame to the next, m/s, beyond `allowed`, where the foot is
    within `height` of the scene at both. After GMD's skating ratio (height 0.05 m, skating from 0.5 m/s, which is the
    tolerance here); the gate is hard, so the gradient never lifts a foot to escape it.

    Args:
        height: a foot closer to the scene than this is on the ground, m (measured at the sole).
        allowed: speed that a standing foot may have while it rolls, m/s.
        feet: the foot joints.
    """
    points = motion.select(feet)
    grounded = foot_heights(points, motion, context).detach() < height
    speed = beyond((points[..., 1:, :, ::2] - points[..., :-1, :, ::2]) * motion.fps, allowed)
    down = grounded[..., 1:, :] & grounded[..., :-1, :]
    speed = torch.where(down[..., None], speed, 0.0)
    # Frame t stands for the step from t to t + 1, so the last frame of a motion has none.
    step = motion.valid[..., 1:] & motion.valid[..., :-1]
    speed = torch.cat([speed, torch.zeros_like(points[..., :1, :, ::2])], dim=-3)
    step = torch.cat([step, torch.zeros_like(motion.valid[..., :1])], dim=-1)
    return Masked(speed.flatten(-2), step, labels=feet, points=points)


@goal(unit="m/s^2", kernel="squared", reduction="mean", scale=1e-4, tolerance=60.0, dim=3)
def smoothness(
    motion: Motion,
    context: Context,
    *,
    limit: NotNegative = 30.0,
    joints: Joints | None = None,
) -> Masked:
    """Keep accelerations in the range of recorded people.

    Residual: second difference of the position times fps^2, m/s^2, beyond `limit`. In recorded motion at 20 fps 99 % of
    joint accelerations are below 31 m/s^2 and 99.9 % below 62 m/s^2.

    Args:
        limit: acceleration that is free, m/s^2.
        joints: which joints, by default all.
    """
    names, points = placed(joints, motion)
    rate = motion.fps**2
    inner = (points[..., 2:, :, :] - 2 * points[..., 1:-1, :, :] + points[..., :-2, :, :]) * rate
    edge = torch.zeros_like(points[..., :1, :, :])
    excess = torch.cat([edge, beyond(inner, limit), edge], dim=-3)[..., : motion.frames, :, :]
    known = motion.valid[..., 2:] & motion.valid[..., 1:-1] & motion.valid[..., :-2]
    none = torch.zeros_like(motion.valid[..., :1])
    active = torch.cat([none, known, none], dim=-1)[..., : motion.frames]
    return Masked(excess.flatten(-2), active, labels=names, points=points)
