"""Where bodies meet surfaces: nearest points, rays, and how much room capsules have at a moment or on their way.

All of it is computed from a distance field and one number: how fast the field can change. A field may state it as
`lipschitz`; one that holds `fields` changes as fast as they do; any other is taken to be a distance, which changes by
1 m/m.
"""

from __future__ import annotations

import math
from functools import reduce
from typing import Any, NamedTuple

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from scenes.errors import UserError
from scenes.mesh.primitives import Plane
from scenes.numbers import positive
from scenes.sdf.field import DistanceField
from scenes.sdf.grid import SdfGrid

Times = tuple[Tensor, Tensor]


class Closest(NamedTuple):
    """Points of a surface: `points` (m), unit `normals` towards free space, and which `converged`."""

    points: Float[Tensor, "*b 3"]
    normals: Float[Tensor, "*b 3"]
    converged: Bool[Tensor, "*b"]


def lipschitz(field: DistanceField) -> float:
    """The most by which a field changes over a metre, m/m, as the field or its parts state it; 1 where none does."""
    stated = getattr(field, "lipschitz", None)
    if stated is None:
        stated = max(map(lipschitz, getattr(field, "fields", ())), default=1.0)
    return float(stated)


def closest_point(
    field: DistanceField,
    points: Float[Tensor, "*b 3"],
    time: Tensor | None = None,
    tolerance: float | int = 1e-4,
    steps: int = 20,
) -> Closest:
    """Project points onto the surface along the field's gradient: Newton's method on the distance.

    Where the field is a distance one step ends at the nearest point; on an interpolant a few more settle on its zero.
    Not differentiable.

    Args:
        field: signed distance, m.
        points: metres, world.
        time: seconds, broadcastable to ``points[..., 0]``, for fields that move.
        tolerance: a point counts as converged once the field there is this close to zero, m.
        steps: at most so many.

    Returns:
        Points and normals; where the gradient vanishes (in the middle between two walls) a point stays, with a zero
        normal, and has not converged.

    Raises:
        UserError: points that are not ``[*b, 3]``, a tolerance that is not positive, or no steps.
    """
    _check_vectors(points=points)
    positive(tolerance, "tolerance")
    if steps < 1:
        raise UserError(f"closest_point was given {steps} steps; give 1 or more")
    here = points.detach()
    for _ in range(steps):
        value, slope = _value_and_gradient(field, here, time)
        if bool((value.abs() <= tolerance).all()):
            break
        square = slope.square().sum(-1)
        # Near ridges an interpolant is flatter than a distance: no step is longer than twice what the field says.
        stride = (value / square.clamp_min(0.25)).where(square > 1e-12, 0.0).where(value.abs() > tolerance, 0.0)
        here = here - stride[..., None] * slope
    value, slope = _value_and_gradient(field, here, time)
    length = slope.norm(dim=-1, keepdim=True)
    normals = torch.where(length > 1e-6, slope / length.clamp_min(1e-6), 0.0)
    return Closest(here, normals, (value.abs() <= tolerance) & (length[..., 0] > 1e-6))


def march(
    field: DistanceField,
    origins: Float[Tensor, "*b 3"],
    directions: Float[Tensor, "*b 3"],
    farthest: float | int,
    time: Tensor | None = None,
    tolerance: float | int = 1e-4,
) -> Float[Tensor, "*b"]:
    """Distance along rays (m) to the first surface, infinite where there is none up to `farthest`.

    Sphere tracing (J. C. Hart, Sphere tracing, The Visual Computer 12, 1996): each step is the field's value over its
    `lipschitz`, so that no wall is stepped through, however thin, as long as it is in the field. Not differentiable.

    Args:
        field: signed distance, m.
        origins: metres, world; a ray that begins in a solid has gone 0 m.
        directions: of any length but 0.
        farthest: metres.
        time: seconds, broadcastable to ``origins[..., 0]``, for fields that move; rays take no time.
        tolerance: a ray has arrived where the field is below this, m.

    Raises:
        UserError: shapes that differ, a direction without length, or metres that are not positive and finite.
    """
    _check_vectors(origins=origins, directions=directions)
    positive(farthest, "farthest")
    positive(tolerance, "tolerance")
    length = directions.detach().norm(dim=-1, keepdim=True)
    if bool((length == 0).any()):
        raise UserError("march was given a direction (0, 0, 0); give directions that point somewhere")
    starts, ways = origins.detach().reshape(-1, 3), (directions.detach() / length).reshape(-1, 3)
    moments = None if time is None else time.expand(origins.shape[:-1]).reshape(-1)
    gone = starts.new_zeros(len(starts))
    hit = torch.full_like(gone, math.inf)
    steepest = lipschitz(field)
    going = torch.arange(len(starts), device=starts.device)
    while len(going) > 0:
        at = starts[going] + gone[going, None] * ways[going]
        value = _value(field, at, None if moments is None else moments[going])
        arrived = value < tolerance
        hit[going[arrived]] = gone[going[arrived]]
        gone[going] += value / steepest
        going = going[~arrived & (gone[going] <= farthest)]  # what is not a number goes nowhere
    return hit.reshape(origins.shape[:-1])


def capsule_clearance(
    field: DistanceField,
    a: Float[Tensor, "*b 3"],
    b: Float[Tensor, "*b 3"],
    radius: Tensor | float | int,
    time: Tensor | None = None,
    tolerance: float | int = 1e-3,
    enough: float | int = math.inf,
) -> Float[Tensor, "*b"]:
    """Room (m) between a capsule and all surfaces: the field's least value on the segment a b, less the radius.

    As `swept_clearance` for a capsule at rest; `time` (s) broadcasts to ``a[..., 0]``.
    """
    times = None if time is None else (time, time)
    return swept_clearance(field, a, b, a, b, radius, times, tolerance=tolerance, enough=enough)


def swept_clearance(
    field: DistanceField,
    a0: Float[Tensor, "*b 3"],
    b0: Float[Tensor, "*b 3"],
    a1: Float[Tensor, "*b 3"],
    b1: Float[Tensor, "*b 3"],
    radius: Tensor | float | int,
    times: Times | None = None,
    speed: float | int = 0.0,
    tolerance: float | int = 1e-3,
    enough: float | int = math.inf,
) -> Float[Tensor, "*b"]:
    """Least room (m) that a capsule has on its way from a0 b0 to a1 b1, both ends on straight lines at even speed.

    A hand that is before a thin wall in one frame and behind it in the next has gone through, and this sees it. The
    least value of the field over segment and way is found by branch and bound: patches of both are halved until
    `lipschitz` proves that none holds a value lower than the best by more than `tolerance`.

    Differentiable with respect to all ends and the radius, once where the field is a grid: by the envelope theorem the
    gradient of a minimum is that of the field at the point where it is attained.

    Args:
        field: signed distance, m.
        a0, b0: ends of the segment at the beginning, metres, world.
        a1, b1: at the end.
        radius: metres, broadcastable to ``[*b]``.
        times: seconds at beginning and end, each broadcastable to ``[*b]``, for fields that move.
        speed: the fastest that anything in the field moves, m/s; what it does meanwhile is bounded with it.
        tolerance: what is returned exceeds the least by this at most, m. Halving it can cost twice as much for a
            capsule that slides along a wall, and hardly anything otherwise.
        enough: room that needs no exact figure, m: a result above it says only that there is more than that.

    Raises:
        UserError: ends whose shapes differ or are not ``[*b, 3]``, or a tolerance that is not positive and finite.
    """
    _check_vectors(a0=a0, b0=b0, a1=a1, b1=b1)
    positive(tolerance, "tolerance")
    batch = a0.shape[:-1]
    ends = torch.stack([a0, b0, a1, b1], dim=-2).reshape(-1, 4, 3)
    size = torch.as_tensor(radius).to(a0).expand(batch)
    moments = None
    if times is not None:
        moments = torch.stack([torch.as_tensor(t).to(a0).expand(batch) for t in times], dim=-1).reshape(-1, 2)
    least = []
    for part in getattr(field, "fields", (field,)):  # the least of several is the least of their leasts
        with torch.no_grad():
            share = _least(part, ends, moments, speed, tolerance, enough + size.reshape(-1))
        when = None if moments is None else torch.lerp(moments[:, 0], moments[:, 1], share[:, 1])
        least.append(part.distance(_place(ends, share), when))
    return reduce(torch.minimum, least).reshape(batch) - size


def _least(
    field: DistanceField,
    ends: Float[Tensor, "n 4 3"],
    times: Float[Tensor, "n 2"] | None,
    speed: float | int,
    tolerance: float | int,
    enough: Float[Tensor, " n"],
) -> Float[Tensor, "n 2"]:
    """Shares of segment and way at which the field is least, to `tolerance` where that is below `enough`."""
    if isinstance(field, SdfGrid):
        return field.lowest_on_way(ends, enough, tolerance)
    if isinstance(field, Plane):  # least at one of the ends
        first = field.distance(ends).argmin(dim=1)
        return torch.stack([first % 2, first // 2], dim=-1).to(ends)
    # The field changes by so much at most over all of the segment and over all of the way.
    a0, b0, a1, b1 = ends.unbind(1)
    along = torch.maximum((b0 - a0).norm(dim=-1), (b1 - a1).norm(dim=-1))
    way = torch.maximum((a1 - a0).norm(dim=-1), (b1 - b0).norm(dim=-1))
    change = lipschitz(field) * torch.stack([along, way], dim=-1)
    if times is not None:
        change[:, 1] += speed * (times[:, 1] - times[:, 0]).abs()
    best, where = ends.new_full((len(ends),), math.inf), ends.new_full((len(ends), 2), 0.5)
    item = torch.arange(len(ends), device=ends.device)
    centre, half = torch.full_like(where, 0.5), torch.full_like(where, 0.5)
    while len(item) > 0:
        when = None if times is None else torch.lerp(times[item, 0], times[item, 1], centre[:, 1])
        value = _value(field, _place(ends[item], centre), when)
        before = best[item]
        best = best.scatter_reduce(0, item, value, "amin")
        better = (value == best[item]) & (value < before)
        where[item[better]] = centre[better]
        spread = half * change[item]
        lowest = value - spread.sum(-1)
        open_ = (lowest < best[item] - tolerance) & (lowest < enough[item])  # False for what is not a number
        item, centre, half, spread = item[open_], centre[open_], half[open_], spread[open_]
        longer = torch.nn.functional.one_hot(spread.argmax(-1), 2).to(half)
        step = half * longer / 2
        item, half = item.repeat(2), (half - step).repeat(2, 1)
        centre = torch.cat([centre - step, centre + step])
    return where


def _place(ends: Float[Tensor, "*b 4 3"], share: Float[Tensor, "*b 2"]) -> Float[Tensor, "*b 3"]:
    """The point at a share of the segment and a share of the way."""
    along, way = share[..., :1], share[..., 1:]
    a0, b0, a1, b1 = ends.unbind(-2)
    return torch.lerp(torch.lerp(a0, b0, along), torch.lerp(a1, b1, along), way)


def _value(field: DistanceField, points: Tensor, time: Tensor | None) -> Tensor:
    with torch.no_grad():
        return field.distance(points, time)


def _value_and_gradient(field: DistanceField, points: Tensor, time: Tensor | None) -> tuple[Tensor, Tensor]:
    one_pass: Any = getattr(field, "value_and_gradient", None)
    if one_pass is not None:
        value, slope = one_pass(points)
        return value, slope
    with torch.enable_grad():
        at = points.detach().requires_grad_()
        value = field.distance(at, time)
        (slope,) = torch.autograd.grad(value.sum(), at)
    return value.detach(), slope


def _check_vectors(**given: Tensor) -> None:
    shape = next(iter(given.values())).shape
    for name, vectors in given.items():
        if vectors.ndim == 0 or vectors.shape[-1] != 3 or vectors.shape != shape:
            raise UserError(f"{name} has shape {tuple(vectors.shape)}; give {' and '.join(given)} as [*b, 3] alike")
