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

# Over steps, the height of a joint over a slope through them varies by so much (m) while feet are set on them.
_BOB = 0.1

# Parts of a path count as about as near within the first distance (m), and as passed about then within the second along
# it: a quarter of a turn of winding stairs.
_NEAR, _LATE = 0.1, 1.0


@goal(unit="m", kernel="squared", reduction="mean", scale=100.0, tolerance=0.1, pulls=True, local=True)
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
    brake: NotNegative = 0.0,
    joint: str = "pelvis",
    height: float | None = None,
) -> Masked:
    """Stay inside a soft corridor along a path on the floor, and keep to a schedule along it if one is stated.

    The gradient of a distance field alone walks into corners; a planned path does not. Two residuals, m, in the floor
    plane: how far the joint is outside the corridor, max(0, d - half_width), and, if `begin` and `end` are stated, the
    vector from where the schedule has it to where it is, shortened by `lag`. A third one, m, if `height` is stated: how
    far, beyond 0.1, the joint is from being so high over the path where it is nearest to it. Ours; no paper states it.

    Args:
        path: its vertices, [x, z] or [x, y, z] world m (their heights are used where `height` is stated).
        half_width: of the corridor, m.
        begin: when the joint is at the first vertex, s; before it, it may wait there.
        end: when it is at the last vertex, s; afterwards it stays.
        lag: how far from the scheduled place it may be, m.
        pace: "constant" speed, or "ease" that starts and stops smoothly.
        brake: over how long a constant speed falls to 0 at the end, s; the whole schedule at most.
        joint: the joint that follows.
        height: of the joint over the path, m; by default it is left free.

    Raises:
        UserError: a path of fewer than two different points, a schedule with one end or that runs backwards, or a
            `height` over a path without heights.
    """
    place = motion.joint(joint)
    corners = _vertices(path)
    vertices = place.new_tensor(corners)
    flat, along = vertices[:, ::2], None
    nowhere = place.new_full((motion.frames, 3), math.nan)
    parts = [(path_distance(place[..., ::2], flat) - half_width).clamp_min(0)[..., None]]
    labels, targets = [f"{joint} (corridor)"], [nowhere]

    if begin is not None or end is not None:
        if begin is None or end is None or end <= begin:
            raise UserError("a schedule needs 'begin' and a later 'end'")
        along = _passed(motion, begin, end, pace, brake)
        scheduled = path_point(flat, along)
        parts.append(beyond(place[..., ::2] - scheduled, lag))
        labels.append(f"{joint} (schedule)")
        targets.append(torch.stack([scheduled[:, 0], nowhere[:, 1], scheduled[:, 1]], dim=-1))
    if height is not None:
        if vertices.isnan().any():
            raise UserError("'height' needs a path of [x, y, z]")
        over = place[..., 1] - height - path_height(place[..., ::2], vertices, along)
        parts.append((over.sign() * (over.abs() - _BOB).clamp_min(0))[..., None])
        labels.append(f"{joint} (height)")
        targets.append(nowhere)

    def marks() -> list[Mark]:
        return [Mark("line", torch.tensor([(x, math.nan, z) for x, _, z in corners]), role="way")]

    count = len(parts)
    points = place[..., None, :].expand(*place.shape[:-1], count, 3)
    drawn = torch.stack(targets, dim=-2).expand(points.shape) if along is not None else None
    return Masked(
        torch.cat(parts, dim=-1), sizes=tuple(part.shape[-1] for part in parts), labels=labels, joints=[joint] * count,
        points=points, targets=drawn, marks=marks,
    )  # fmt: skip


def risen(
    motion: Motion,
    *,
    path: list[Point],
    begin: float | None = None,
    end: float | None = None,
    pace: str = "constant",
    brake: float = 0.0,
    joint: str = "pelvis",
    **_: object,
) -> Float[Tensor, "*b T"]:
    """How much higher (m) than at its beginning a path lies under a joint; parameters as `follow_path` takes them."""
    vertices = motion.joints.new_tensor(_vertices(path))
    along = None if begin is None or end is None else _passed(motion, begin, end, pace, brake)
    return path_height(motion.joint(joint)[..., ::2], vertices, along) - vertices[0, 1]


def _passed(motion: Motion, begin: float, end: float, pace: str, brake: float) -> Float[Tensor, " T"]:
    """The share of a path's length that a schedule has passed at every frame."""
    along = ((motion.times - begin) / (end - begin)).clamp(0, 1)
    if pace == "ease":
        return along * along * (3 - 2 * along)
    slow = min(brake / (end - begin), 1.0)
    short = (along - (1 - slow)).clamp_min(0).square() / (2 * slow) if slow else 0.0
    return (along - short) / (1 - slow / 2)


def _vertices(path: list[FloorPoint] | list[Point]) -> list[tuple[float, float, float]]:
    """The path's vertices without repetitions, their heights nan where they are not stated."""
    stated = [(p.x, p.y if isinstance(p, Point) else math.nan, p.z) for p in path]
    kept = stated[:1] + [b for a, b in pairwise(stated) if a[::2] != b[::2]]
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


def path_height(
    points: Float[Tensor, "*b T 2"], vertices: Float[Tensor, "P 3"], share: Float[Tensor, " T"] | None
) -> Float[Tensor, "*b T"]:
    """Height (m) of a polyline where it is nearest to points as seen from above, a mean where parts are about as near.

    With the share of its length that is passed by then, those parts count that it is passed at.
    """
    a, along = vertices[:-1], vertices[1:] - vertices[:-1]
    steps = along[:, ::2].norm(dim=-1)
    part = ((points[..., None, :] - a[:, ::2]) * along[:, ::2]).sum(-1) / steps.square()
    nearest = a + part.clamp(0, 1)[..., None] * along
    away = ((points[..., None, :] - nearest[..., ::2]) / _NEAR).square().sum(-1)
    if share is not None:
        middle = steps.cumsum(0) - steps / 2
        away = away + ((middle - share[:, None] * steps.sum()) / _LATE).square()
    return (torch.softmax(-away / 2, dim=-1) * nearest[..., 1]).sum(-1)
