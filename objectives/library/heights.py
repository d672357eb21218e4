"""Heights of joints: ProgMoGen's head height (HSI-1), ceilings and floors, and its barrier (HSI-2)."""

from __future__ import annotations

import math
from functools import partial
from typing import Literal

import torch
from jaxtyping import Float
from torch import Tensor

from objectives.context import Context
from objectives.library._joints import Joints, placed
from objectives.marks import rectangle
from objectives.maths import first_middle_last, frame_mask, frames_near
from objectives.parameters import NotNegative, Region, WorldY
from objectives.registry import Masked, goal
from scenes.errors import UserError
from scenes.motion.motion import Motion

Side = Literal["below", "above"]


def _past(height: Tensor, limit: Tensor | float, mode: str) -> Tensor:
    """How far a height is from (`equal`, signed) or on the wrong side of (`below`, `above`) a limit, m."""
    if mode == "equal":
        return height - limit
    return (height - limit if mode == "below" else limit - height).clamp_min(0)


@goal(unit="m", kernel="squared", reduction="sum", tolerance=0.05, pulls=True)
def head_height(
    motion: Motion,
    context: Context,
    *,
    height: WorldY | list[WorldY],
    at: list[float] | None = None,
    weights: list[NotNegative] | None = None,
    mode: Literal["equal", "below", "above"] = "equal",
    joint: str = "head",
) -> Masked:
    """Hold the head at a height: exactly at stated moments, or below a ceiling or above a floor throughout.

    ProgMoGen HSI-1: 2 (y_mid - h_mid)^2 + (y_first - h_first)^2 + (y_last - h_last)^2 with frames 0, L // 2 and L - 1.
    Heights are world y, m; the joint stands for the head's middle and not for its top.

    Args:
        height: world y, m; one for all moments or one for each.
        at: moments in seconds. Without them first, middle and last frame for "equal", every frame otherwise.
        weights: factor on the cost of each moment, by default 1, 2, 1 for first, middle, last and 1 otherwise.
        mode: "equal", or "below" or "above" the height.
        joint: the joint that is held.
    """
    heights = height if isinstance(height, list) else [height]
    world = motion.joint(joint)
    if at is None and mode != "equal":
        if len(heights) != 1 or weights is not None:
            raise UserError("several heights or weights need times in 'at'")
        return Masked(_past(world[..., 1:2], heights[0], mode), labels=[joint], points=world[..., None, :])
    if at is None:
        active, usual = first_middle_last(motion), [1.0, 2.0, 1.0]
    else:
        active = torch.stack([frame_mask(motion, frame) for frame in frames_near(motion, at)], dim=-1)
        usual = [1.0] * len(at)
    keys = len(usual)
    heights, factors = heights * keys if len(heights) == 1 else heights, weights or usual
    if len(heights) != keys or len(factors) != keys:
        raise UserError(f"{keys} moments need {keys} heights and weights, not {len(heights)} and {len(factors)}")
    residual = _past(world[..., 1:2], world.new_tensor(heights), mode)
    points = world[..., None, :].expand(*residual.shape, 3)
    targets = None
    if mode == "equal":
        places = [(math.nan, moment, math.nan) for moment in heights]
        targets = world.new_tensor(places).expand(points.shape)
    each = world.new_tensor(factors).expand(residual.shape)
    return Masked(residual, active, each, labels=[joint] * keys, points=points, targets=targets)


@goal(unit="m", kernel="squared", reduction="mean", tolerance=0.02, local=True)
def height_limit(
    motion: Motion,
    context: Context,
    *,
    limit: WorldY,
    mode: Side = "below",
    joints: Joints | None = None,
    region: Region | None = None,
) -> Masked:
    """Keep joints below a ceiling or above a floor, everywhere or only over a part of the ground.

    Residual max(0, y - limit) or max(0, limit - y), m. A joint outside the region is free, so an overhead beam is its
    rectangle and the height of its underside. Averaged over all frames and joints.

    Args:
        limit: world y, m.
        mode: "below" or "above" the limit.
        joints: which joints, by default all.
        region: rectangle of the floor over which the limit holds, m; by default everywhere.
    """
    names, points = placed(joints, motion)
    past = _past(points[..., 1], limit, mode)
    if region is not None:
        x, z = points[..., 0], points[..., 2]
        inside = (x >= region.x[0]) & (x <= region.x[1]) & (z >= region.z[0]) & (z <= region.z[1])
        past = torch.where(inside, past, 0.0)
    marks = None if region is None else partial(rectangle, region.x, region.z, limit, "obstacle")
    return Masked(past, labels=names, points=points, marks=marks)


@goal(unit="m", kernel="linear", reduction="sum", tolerance=0.05)
def barrier(
    motion: Motion,
    context: Context,
    *,
    stand: WorldY = 1.5,
    duck: WorldY = 0.5,
    feet: WorldY = 0.0,
) -> Masked:
    """Duck under a barrier in the middle and stand upright at the start and the end (ProgMoGen HSI-2, evaluation).

    [max(0, stand - y_head,0) + max(0, stand - y_head,end) + max(0, y_head,mid - duck)] / 3
    + [max(0, y_left_foot,mid - feet) + max(0, y_right_foot,mid - feet)] / 2, with frames 0, L // 2 and L - 1. The
    evaluation version has no barrier in space, and asks for foot joints at or below y = 0 although their mean height is
    0.048 m: zero error can hide feet under the floor, so report the lowest foot beside it. For a barrier in space use
    `height_limit` with a region.

    Args:
        stand: least height of the head at the first and the last frame, world y, m.
        duck: greatest height of the head at the middle frame, m.
        feet: greatest height of both foot joints at the middle frame, m.
    """
    names = ["head", "head", "head", "left_foot", "right_foot"]
    points = motion.select(names)
    y = points[..., 1]
    signs, limits = y.new_tensor([-1, 1, -1, 1, 1]), y.new_tensor([stand, duck, stand, feet, feet])
    residual = ((y - limits) * signs).clamp_min(0)
    first, middle, last = first_middle_last(motion).unbind(-1)
    active = torch.stack([first, middle, last, middle, middle], dim=-1)
    share: Float[Tensor, " 5"] = y.new_tensor([1 / 3, 1 / 3, 1 / 3, 1 / 2, 1 / 2])
    return Masked(residual, active, share.expand(residual.shape), labels=names, points=points)
