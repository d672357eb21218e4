"""Following a path on the floor, such as the planner's."""

from __future__ import annotations

import math
from itertools import pairwise
from typing import Literal

import torch
from jaxtyping import Float
from torch import Tensor

from objectives.context import Context
from objectives.library.obstacles import segment_distance
from objectives.marks import Mark
from objectives.maths import beyond, root
from objectives.parameters import FloorPoint, Point, Positive, Time
from objectives.registry import Masked, goal
from scenes.errors import UserError
from scenes.motion.motion import Motion

# Where two segments are equally near, the distance to the nearer one has a ridge. A soft minimum of this width (m)
# rounds it; its gradient stays a mean of the segments' own, and it reads less than 3 cm short at 0.3 m even for a path
# of many short segments.
_SOFT = 0.02


@goal(unit="m", kernel="squared", reduction="mean", scale=100.0, tolerance=0.1, pulls=True)
def follow_path(
    motion: Motion,
    context: Context,
    *,
    path: list[FloorPoint] | list[Point],
    half_width: Positive = 0.3,
    begin: Time | None = None,
    end: Time | None = None,
    lag: Positive = 0.5,
    pace: Literal["constant", "ease"] = "constant",
    joint: str = "pelvis",
) -> Masked:
    """Stay inside a soft corridor along a path on the floor, and keep to a schedule along it if one is stated.

    The gradient of a distance field alone walks into corners; a planned path does not. Two residuals, m, in the floor
    plane: how far the joint is outside the corridor, max(0, d - half_width), and, if `begin` and `end` are stated, the
    vector from where the schedule has it to where it is, shortened by `lag`. Ours; no paper states it.

    Args:
        path: its vertices, [x, z] or [x, y, z] world m (the height is not used).
        half_width: of the corridor, m.
        begin: when the joint is at the first vertex, s; before it, it may wait there.
        end: when it is at the last vertex, s; afterwards it stays.
        lag: how far from the scheduled place it may be, m.
        pace: "constant" speed, or "ease" that starts and stops smoothly.
        joint: the joint that follows.

    Raises:
        UserError: a path of fewer than two different points, or a schedule with one end or that runs backwards.
    """
    place = motion.joint(joint)
    corners = _vertices(path)
    vertices = place.new_tensor(corners)
    corridor = (path_distance(place[..., ::2], vertices) - half_width).clamp_min(0)[..., None]

    def marks() -> list[Mark]:
        return [Mark("line", torch.tensor([(x, math.nan, z) for x, z in corners]), role="way")]

    labels = [f"{joint} (corridor)", f"{joint} (schedule)"]
    if begin is None and end is None:
        return Masked(corridor, labels=labels[:1], joints=[joint], points=place[..., None, :], marks=marks)
    if begin is None or end is None or end <= begin:
        raise UserError("a schedule needs 'begin' and a later 'end'")
    share = ((motion.times - begin) / (end - begin)).clamp(0, 1)
    share = share * share * (3 - 2 * share) if pace == "ease" else share
    scheduled = path_point(vertices, share)
    behind = beyond(place[..., ::2] - scheduled, lag)
    points = place[..., None, :].expand(*place.shape[:-1], 2, 3)
    targets = place.new_full((motion.frames, 2, 3), math.nan)
    targets[:, 1, ::2] = scheduled
    return Masked(
        torch.cat([corridor, behind], dim=-1), sizes=(1, 2), labels=labels, joints=[joint, joint], points=points,
        targets=targets.expand(points.shape), marks=marks,
    )  # fmt: skip


def _vertices(path: list[FloorPoint] | list[Point]) -> list[tuple[float, float]]:
    """x and z of the path's vertices, without repetitions."""
    flat = [(p.x, p.z) for p in path]
    kept = flat[:1] + [b for a, b in pairwise(flat) if a != b]
    if len(kept) < 2:
        raise UserError(f"'path' needs at least two different points, it has {len(kept)}")
    return kept


def path_distance(points: Float[Tensor, "*b T 2"], vertices: Float[Tensor, "P 2"]) -> Float[Tensor, "*b T"]:
    """Distance to a polyline, m, smooth where two of its segments are equally near."""
    each = segment_distance(points[..., None, :], vertices[:-1], vertices[1:])
    square = -2 * _SOFT**2 * torch.logsumexp(-each.square() / (2 * _SOFT**2), dim=-1)
    return root(square.clamp_min(0))


def path_point(vertices: Float[Tensor, "P 2"], share: Float[Tensor, " T"]) -> Float[Tensor, "T 2"]:
    """Points at a share (0 to 1) of a polyline's length."""
    steps = (vertices[1:] - vertices[:-1]).norm(dim=-1)
    marks = torch.cat([steps.new_zeros(1), steps.cumsum(0)])
    run = share * marks[-1]
    segment = (torch.searchsorted(marks, run.contiguous()) - 1).clamp(0, len(steps) - 1)
    part = ((run - marks[segment]) / steps[segment])[:, None]
    return torch.lerp(vertices[segment], vertices[segment + 1], part)
