"""Staying natural while goals pull: feet that don't slide or shuffle, no jerks, limbs that don't snap."""

from __future__ import annotations

import torch
from jaxtyping import Float
from torch import Tensor

from objectives.context import Context
from objectives.library._joints import Axes, Joints, placed
from objectives.library.scene import foot_heights
from objectives.maths import beyond, length
from objectives.parameters import NotNegative, Positive
from objectives.registry import Masked, goal
from scenes.motion.motion import Motion


@goal(unit="m/s", kernel="squared", reduction="mean", tolerance=0.5, dim=2, local=True)
def foot_skating(
    motion: Motion,
    context: Context,
    *,
    height: Positive = 0.05,
    allowed: NotNegative = 0.1,
    feet: list[str] = ["left_foot", "right_foot"],  # noqa: B006  (read only)
    each: bool = True,
) -> Masked:
    """Keep feet that are near the ground from sliding over it: each of them, or the one that is most at rest.

    Residual: horizontal velocity of the foot from one frame to the next, m/s, beyond `allowed`, where the foot is
    within `height` of the ground at both. After GMD's skating ratio (height 0.05 m, skating from 0.5 m/s, which is the
    tolerance here); the gate is hard, so the gradient never lifts a foot to escape it.

    Args:
        height: a foot lower over the ground than this stands on it, m (measured at the sole).
        allowed: speed that a standing foot may have while it rolls, m/s.
        feet: the foot joints.
        each: every one of them; otherwise the slowest, so that another may swing low.
    """
    points = motion.select(feet)
    grounded = foot_heights(points, motion, context).detach() < height
    speed = beyond(points[..., ::2].diff(dim=-3) * motion.fps, allowed)
    down = grounded[..., 1:, :] & grounded[..., :-1, :]
    if not each:
        slow = torch.where(down, speed.detach().norm(dim=-1), torch.inf)
        down = down & (slow == slow.amin(-1, keepdim=True))
    speed = torch.where(down[..., None], speed, 0.0)
    return _by_step(speed.flatten(-2), motion, feet, points)


@goal(unit="m", kernel="squared", reduction="mean", scale=1e4, tolerance=0.03, local=True)
def foot_clearance(
    motion: Motion,
    context: Context,
    *,
    height: Positive = 0.05,
    speed: NotNegative = 0.5,
    feet: list[str] = ["left_foot", "right_foot"],  # noqa: B006  (read only)
) -> Masked:
    """Keep feet that swing off the ground: a generator that is made to take shorter steps takes lower ones, too.

    Residual: how much closer to the scene than `height` a foot stays, m, in a step from one frame to the next, at the
    end that is further off, so that feet may land and leave; times how much faster than `speed` it is, up to 1 at 1 m/s
    more. With `foot_skating`, which slows feet that are so low, this answers both halves of GMD's skating ratio, in
    which a low swing counts (height 0.05 m, from 0.5 m/s). Without a hard gate, as solvers stall where feet pass it.

    Args:
        height: of a swinging foot over the scene, walls and steps included, m (measured at the sole).
        speed: in the plane, beyond which a foot swings, m/s; a slower one should rather stand.
        feet: the foot joints.
    """
    points = motion.select(feet)
    moved = length(points[..., ::2].diff(dim=-3))
    share = (moved * motion.fps - speed).clamp(0.0, 1.0)
    over = context.scene.distance(points, motion.times[:, None]) - context.body.sole_offset
    low = (height - torch.maximum(over[..., 1:, :], over[..., :-1, :])).clamp_min(0.0) * share
    return _by_step(low, motion, feet, points)


def _by_step(
    residual: Float[Tensor, "*b steps r"],
    motion: Motion,
    names: list[str],
    points: Float[Tensor, "*b T n 3"],
    size: int | None = None,
) -> Masked:
    """Residuals of the steps between frames: frame t stands for that from t to t + 1, so the last one has none."""
    active = motion.valid[..., 1:] & motion.valid[..., :-1]
    pad = torch.nn.functional.pad
    return Masked(pad(residual, (0, 0, 0, 1)), pad(active, (0, 1)), sizes=size, labels=names, points=points)


@goal(unit="m/s", kernel="squared", reduction="sum", tolerance=0.1, local=True)
def speed_limit(
    motion: Motion,
    context: Context,
    *,
    limit: NotNegative = 0.1,
    joints: Joints | None = None,
    axes: Axes = "xyz",
) -> Masked:
    """Keep joints from moving faster than a limit; a person stands in the window of such a goal.

    Residual: velocity from one frame to the next, m/s, beyond `limit`.

    Args:
        limit: speed that is free, m/s; people who stand sway at a few cm/s.
        joints: which joints, by default all.
        axes: along which, such as "xz" for speed over the floor.
    """
    names, points = placed(joints, motion)
    moved = points[..., ["xyz".index(axis) for axis in axes]].diff(dim=-3)
    return _by_step(beyond(moved * motion.fps, limit).flatten(-2), motion, names, points, len(axes))


@goal(unit="m/s^2", kernel="squared", reduction="mean", scale=1e-4, tolerance=60.0, dim=3, local=True)
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


@goal(unit="rad", kernel="squared", reduction="mean", scale=10.0, tolerance=0.1, local=True)
def joint_limits(
    motion: Motion,
    context: Context,
    *,
    knee: Positive = 2.7,
    elbow: Positive = 2.88,
    backwards: NotNegative = 0.26,
) -> Masked:
    """Keep knees and elbows from bending further than joints go, and knees from bending backwards.

    Residual: flexion beyond the limit, rad; 0 is a straight limb. The limits are the American Academy of Orthopaedic
    Surgeons' (135 degrees for knees, 150 for elbows), widened by the 15 to 20 degrees that recorded people need.

    Args:
        knee: its largest flexion, rad.
        elbow: its largest flexion, rad.
        backwards: how far a knee may point backwards, rad.
    """
    left = motion.joint("left_hip") - motion.joint("right_hip")
    labels = [f"{side}_{name}" for name in ("knee", "elbow") for side in ("left", "right")]
    excess = []
    for side in ("left", "right"):
        angle, hinge = _flexion(motion, (f"{side}_hip", f"{side}_knee", f"{side}_ankle"))
        along = (hinge * left).sum(-1)
        # A knee bends about an axis that points to the left, however the trunk leans. Legs turned outwards point a
        # little backwards at times; only what is about the hips' own axis counts.
        wrong = (along < 0) & (along.abs() > 0.7 * length(hinge) * length(left))
        excess.append((angle - torch.where(wrong, backwards, knee)).clamp_min(0.0))
    for side in ("left", "right"):
        angle, _ = _flexion(motion, (f"{side}_shoulder", f"{side}_elbow", f"{side}_wrist"))
        excess.append((angle - elbow).clamp_min(0.0))
    return Masked(torch.stack(excess, dim=-1), labels=labels, points=motion.select(labels))


def _flexion(motion: Motion, names: tuple[str, str, str]) -> tuple[Float[Tensor, "*b T"], Float[Tensor, "*b T 3"]]:
    """Angle (rad) between the two bones at the middle joint, and the axis that the second is turned about."""
    a, b, c = (motion.joint(name) for name in names)
    upper, lower = b - a, c - b
    hinge = torch.linalg.cross(upper, lower)
    return torch.atan2(length(hinge), (upper * lower).sum(-1)), hinge
