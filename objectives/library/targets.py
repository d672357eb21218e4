"""Joints at positions: MSCoT's any-joint-any-time control."""

from __future__ import annotations

import math

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from objectives.context import Context
from objectives.library._joints import Axes, Joints, chosen
from objectives.maths import frame_mask, frames_near, keyed
from objectives.parameters import FloorPoint, Point
from objectives.registry import Masked, goal
from objectives.tracks import Track, TrackBase
from scenes.errors import UserError
from scenes.motion.motion import Motion

Place = Point | FloorPoint


# Eq. 13 divides by 2 sigma; log p = -r^2 / (2 s^2) with s = 0.05 m steers well in practice (0.1 m leaves decimetres,
# 0.2 m barely steers), so the paper's sigma is s^2 = 0.0025 m^2 and the scale 1 / (2 * 0.0025 m^2) = 200 / m^2.
@goal(unit="m", kernel="squared", reduction="sum", scale=200.0, dim=3, tolerance=0.05, pulls=True, local=True)
def joint_target(
    motion: Motion,
    context: Context,
    *,
    joint: Joints = "pelvis",
    position: Place | list[Point] | list[FloorPoint] | None = None,
    track: Track | None = None,
    at: list[float] | None = None,
    axes: Axes | None = None,
) -> Masked:
    """Bring a joint to a point, to several points in turn, or along a track.

    MSCoT Eq. 13 and 41: L = 1/(2 sigma) sum_t sum_j b_tj ||x_tj - target_tj||^2, with sigma = 0.0025 m^2, that is a
    standard deviation of 0.05 m. Its residual is x - target on the constrained axes, m, world; b is `at`, the span and
    mask of the track, and the term's window.

    Args:
        joint: the joint, or several in the order of the columns of an array track.
        position: where it shall be, world m; [x, z] leaves the height free. Several, one for each time of `at`.
        track: where it shall be as a function of time, instead of `position`.
        at: times in seconds; without them `position` holds at every frame.
        axes: the constrained axes, such as "xz" for the place on the floor; by default those that are stated.

    Raises:
        UserError: neither or both of position and track, or numbers of positions and times that do not match.
    """
    if (position is None) == (track is None):
        raise UserError("needs either 'position' or 'track'")
    names = chosen(joint, motion)
    if track is not None:
        target, active = _along(track, len(names), motion)
        if at is not None:
            active = active & _frames(motion, at)[..., None]
    else:
        target, active = _places(position, at, motion)
    flat = isinstance(position, FloorPoint) or (isinstance(position, list) and isinstance(position[0], FloorPoint))
    axes = axes or ("xz" if flat else "xyz")
    if flat and "y" in axes:
        raise UserError(f"axes '{axes}' need a height, but 'position' states only [x, z]")
    points = motion.select(names)
    offset = (points - target)[..., ["xyz".index(axis) for axis in axes]]
    if len(axes) < 3 and not flat:
        target = target + target.new_tensor([0.0 if axis in axes else math.nan for axis in "xyz"])
    targets = target.expand(points.shape)
    return Masked(offset.flatten(-2), active, sizes=len(axes), labels=names, points=points, targets=targets)


def _along(track: TrackBase, joints: int, motion: Motion) -> tuple[Float[Tensor, "T n 3"], Bool[Tensor, "*b T n"]]:
    if track.columns not in (1, joints):
        raise UserError(f"the track has {track.columns} columns for {joints} joints; name one joint for each column")
    target, active = track.position(motion.times), track.active(motion.times)
    return target, active.expand(*motion.valid.shape, -1)


def _frames(motion: Motion, at: list[float]) -> Bool[Tensor, "*b T"]:
    mask = torch.zeros_like(motion.valid)
    for frame in frames_near(motion, at):
        mask |= frame_mask(motion, frame)
    return mask


def _places(
    position: Place | list[Point] | list[FloorPoint] | None, at: list[float] | None, motion: Motion
) -> tuple[Float[Tensor, "T 1 3"], Bool[Tensor, "*b T"]]:
    """Target of every frame and the frames that have one."""
    several = isinstance(position, list)
    places = [_point(p) for p in position] if isinstance(position, list) else [_point(position)]
    if not several:
        target = motion.joints.new_tensor(places).expand(motion.frames, 3)
        return target[:, None], motion.valid if at is None else _frames(motion, at)
    if at is None or len(at) != len(places):
        raise UserError(f"{len(places)} positions need as many times in 'at', not {0 if at is None else len(at)}")
    return keyed(motion.joints.new_tensor(places)[:, None], at, motion)


def _point(place: object) -> tuple[float, float, float]:
    if isinstance(place, Point):
        return (place.x, place.y, place.z)
    if isinstance(place, FloorPoint):
        return (place.x, math.nan, place.z)
    raise UserError("'position' must be [x, y, z], [x, z], or a list of one of them")
