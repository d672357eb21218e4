"""Following a path on the ground, such as the planner's."""

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
from objectives.parameters import FloorPoint, NotNegative, Point, Positive, Time
from objectives.registry import Masked, goal
from scenes.errors import UserError
from scenes.motion.motion import Motion

# Where two segments are equally near, the distance to the nearer one has a ridge. A soft minimum of this width (m)
# rounds it; its gradient stays a mean of the segments' own, and it reads less than 3 cm short at 0.3 m even for a path
# of many short segments.
_SOFT = 0.02

# Parts of a path count as about as near within this distance (m), and as passed about then within this one along it: a
# quarter of a turn of winding stairs.
_NEAR, _LATE = 0.1, 1.0


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


@goal(unit="m", kernel="squared", reduction="mean", scale=100.0, tolerance=0.15, pulls=True)
def path_height(
    motion: Motion,
    context: Context,
    *,
    path: list[Point],
    height: float,
    slack: NotNegative = 0.05,
    begin: Time | None = None,
    end: Time | None = None,
    joint: str = "pelvis",
) -> Masked:
    """Keep a joint at a height over a path that rises and falls, such as one over steps.

    Residual: how much more than `slack` it is too high or too low, m, over the point of the path that is nearest to it
    as seen from above; over a mean of them where several are about as near. Ours; no paper states it.

    Args:
        path: its vertices, [x, y, z] world m.
        height: of the joint over the path, m.
        slack: what bobs within it is right, m; in recorded walking the pelvis does by 0.02 to 0.03 m.
        begin: when the joint is at the first vertex, s.
        end: when it is at the last one, s. With both, of parts that lie over one another those count that it passes
            about then.
        joint: the joint that is held.
    """
    place, vertices = motion.joint(joint), motion.joints.new_tensor([(p.x, p.y, p.z) for p in path])
    if len(vertices) < 2:
        raise UserError(f"'path' needs at least two different points, it has {len(vertices)}")
    a, along = vertices[:-1], vertices[1:] - vertices[:-1]
    square = along[:, ::2].square().sum(-1)
    share = ((place[..., None, ::2] - a[:, ::2]) * along[:, ::2]).sum(-1) / square.clamp_min(1e-12)
    foot = a + share.clamp(0, 1)[..., None] * along
    away = (place[..., None, ::2] - foot[..., ::2]).square().sum(-1) / (2 * _NEAR**2)
    if begin is not None and end is not None and end > begin:
        at = torch.cumsum(square.sqrt(), 0) - square.sqrt() / 2
        run = ((motion.times - begin) / (end - begin)).clamp(0, 1) * square.sqrt().sum()
        away = away + ((at - run[:, None]) / _LATE).square() / 2
    level = (torch.softmax(-away, dim=-1) * foot[..., 1]).sum(-1) + height
    over = place[..., 1] - level
    residual = over.sign() * (over.abs() - slack).clamp_min(0)
    targets = torch.stack([place.new_full(level.shape, math.nan), level.detach(), level * math.nan], dim=-1)
    return Masked(
        residual[..., None], labels=[joint], points=place[..., None, :], targets=targets[..., None, :], marks=list
    )


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
