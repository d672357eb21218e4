"""Staying inside a part of the floor."""

from __future__ import annotations

from functools import partial

import torch

from objectives.context import Context
from objectives.library._joints import Joints, placed
from objectives.marks import rectangle
from objectives.parameters import FloorPoint, Positive
from objectives.registry import Masked, goal
from scenes.motion.motion import Motion


@goal(unit="m", kernel="linear", reduction="mean", tolerance=0.05)
def square_region(
    motion: Motion,
    context: Context,
    *,
    half: Positive = 1.0,
    center: FloorPoint = FloorPoint(0.0, 0.0),
    joints: Joints | None = None,
    include_padding: bool = False,
) -> Masked:
    """Stay inside a square on the floor.

    ProgMoGen HSI-3: (1/4) [mean max(0, x - 1) + mean max(0, -1 - x) + mean max(0, z - 1) + mean max(0, -1 - z)] over
    all joints and frames. Cropped to the valid frames by default; ProgMoGen averages over its padded frames too, which
    gives other numbers: compare with its tables under `include_padding`.

    Args:
        half: half of the square's side, m.
        center: of the square, world m. HSI-3's is where the person starts.
        joints: which joints, by default all.
        include_padding: count padded frames as if they were motion, as ProgMoGen does.
    """
    names, points = placed(joints, motion)
    x, z = points[..., 0] - center.x, points[..., 2] - center.z
    out = torch.stack([x - half, -half - x, z - half, -half - z], dim=-1).clamp_min(0)
    sides = [f"{name} ({side})" for name in names for side in ("+x", "-x", "+z", "-z")]
    each = points.detach()[..., None, :].expand(*points.shape[:-1], 4, 3).flatten(-3, -2)
    owners = [name for name in names for _ in range(4)]
    marks = partial(rectangle, (center.x - half, center.x + half), (center.z - half, center.z + half))
    return Masked(out.flatten(-2), labels=sides, joints=owners, points=each, marks=marks)
