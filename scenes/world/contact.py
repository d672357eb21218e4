"""Where bodies meet surfaces: nearest points, rays, and how much room capsules have at a moment or on their way.

All of it is computed from a distance field and one number: how fast the field can change. A field may state it as
`lipschitz`; one that holds `fields` changes as fast as they do; any other is taken to be a distance, which changes by
1 m/m.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import reduce
from typing import Any, NamedTuple

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from scenes.errors import UserError
from scenes.mesh.primitives import Plane
from scenes.numbers import positive
from scenes.sdf.field import DistanceField
from scenes.sdf.grid import Interpolated, SdfGrid
from scenes.sdf.lattice import padded
from scenes.world.moving import MovingObject
from scenes.world.reach import Reach

Times = tuple[Tensor, Tensor]

FINEST = 1e-12
"""The smallest tolerance (m) that may be asked for; double precision holds no finer place within 10 km."""
BLUR = 0.75
"""Voxels by which a point of a grid's surface may be farther than the grid says, and still be nearest.

The interpolant rounds off what is finer than its voxels. In two scans, at 128 and 256 nodes, 99.3 % of free points find
such a point, and of 240,000 none is more than a voxel farther than the nearest triangle; at 1 voxel 99.8 % and 2 in
10,000. Up to a fifth of it the first point is taken; beyond, nearer ones are sought.
"""

DIRECTIONS, TRIES, HALVINGS = 64, 4, 6
"""How many ways are looked at where Newton's method fails, from how many of them it is tried again, and how often."""


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
    """The nearest point of the surface: Newton's method on the distance, and where that strays a search all around.

    What has converged is nearest: it is no farther than the field says by more than `tolerance`, on a grid by more than
    `BLUR` voxels (coarse ones, of `SdfBlocks`) and outside it by more than one; what the grid's distance itself errs by
    comes on top. It holds of several fields together, and of objects that move. A field that is only a bound of a
    distance need not converge, nor need points within two solids at once, or over a thousand voxels outside a grid.
    Not differentiable.

    Args:
        field: signed distance, m.
        points: metres, world.
        time: seconds, broadcastable to ``points[..., 0]``, for fields that move.
        tolerance: a point counts as converged once the field there is this close to zero, m.
        steps: at most so many.

    Returns:
        Points and normals; of several that are nearest, one. What has not converged is where the search ended.

    Raises:
        UserError: points that are not ``[*b, 3]``, a tolerance that is not positive, or no steps.
    """
    _check_vectors(points=points)
    positive(tolerance, "tolerance", FINEST)
    if steps < 1:
        raise UserError(f"closest_point was given {steps} steps; give 1 or more")
    shape, flat = points.shape[:-1], points.detach().reshape(-1, 3)
    when = None if time is None else time.expand(shape).reshape(-1)
    found, _ = _closest(field, flat, when, tolerance, steps)
    return Closest(
        found.points.reshape(points.shape), found.normals.reshape(points.shape), found.converged.reshape(shape)
    )


def _closest(
    field: DistanceField, points: Float[Tensor, "n 3"], time: Tensor | None, tolerance: float | int, steps: int
) -> tuple[Closest, Float[Tensor, " n"]]:
    """`closest_point`, and how far away (m) the field says that the nearest point is."""
    if isinstance(field, MovingObject):
        found, away = _closest(field.field, field.local(points, time), None, tolerance, steps)
        return Closest(field.world(found.points, time), field.turned(found.normals, time), found.converged), away
    if (fields := getattr(field, "fields", None)) is not None:
        return _closest_of(fields, points, time, tolerance, steps)
    start, error, slack = points, torch.zeros_like(points[:, 0]), 0.0
    low, high = points.new_tensor([[-math.inf], [math.inf]])
    if isinstance(field, Interpolated):
        (start, error), slack = field.entered(points), BLUR * field.widest
        low, high = torch.from_numpy(padded(field.bounds, tolerance)).to(points)
    away = _value(field, start, time).abs()
    most = away + tolerance - error

    def farther(found: Closest, which: Tensor) -> Tensor:
        held = ((found.points >= low) & (found.points <= high)).all(-1)  # no surface is outside a grid
        return ((found.points - start[which]).norm(dim=-1) - most[which]).where(found.converged & held, math.inf)

    found = _settled(field, start, time, tolerance, steps)
    excess = farther(found, torch.ones_like(away, dtype=torch.bool))
    lost = away.isfinite() & ~(excess <= slack / 5 + error)
    if bool(lost.any()):
        again = _searched(field, start[lost], away[lost], None if time is None else time[lost], tolerance, steps)
        for kept, new in zip((*found[:2], excess), (*again[:2], farther(again, lost)), strict=True):
            kept[lost] = new
    return found._replace(converged=excess <= slack), away + (start - points).norm(dim=-1)


def _closest_of(
    fields: Sequence[DistanceField],
    points: Float[Tensor, "n 3"],
    time: Tensor | None,
    tolerance: float | int,
    steps: int,
) -> tuple[Closest, Float[Tensor, " n"]]:
    """The nearest of the points that several fields have, in solids that of the one that is deepest.

    A field that has none counts as near as it says, and where it is the nearest nothing is found. Nor is anything where
    the deepest surface is within another solid.
    """
    each = [_closest(field, points, time, tolerance, steps) for field in fields]
    away = torch.stack([away for _, away in each])
    found = Closest(*(torch.stack(parts) for parts in zip(*(found for found, _ in each), strict=True)))
    length = (found.points - points).norm(dim=-1).where(found.converged, away)
    value = torch.stack([_value(field, points, time) for field in fields])
    place = (value.sign() * length).argmin(0), torch.arange(len(points), device=points.device)
    nearest = Closest(*(part[place] for part in found))
    least = torch.stack([_value(field, nearest.points, time) for field in fields]).amin(0)
    slack = max((BLUR * field.widest for field in fields if isinstance(field, Interpolated)), default=0.0)
    return nearest._replace(converged=nearest.converged & (least >= -slack - tolerance)), away[place]


def _settled(
    field: DistanceField, start: Float[Tensor, "n 3"], time: Tensor | None, tolerance: float | int, steps: int
) -> Closest:
    """Where Newton's method on the field ends from each point, near or far."""
    here = start
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


def _searched(
    field: DistanceField,
    points: Float[Tensor, "n 3"],
    away: Float[Tensor, " n"],
    time: Tensor | None,
    tolerance: float | int,
    steps: int,
) -> Closest:
    """The nearest point of the surface, sought all around on the sphere of radius `away` that touches it.

    The field is least there where the sphere touches. From the lowest of some directions Newton's method leads to the
    surface; then from half the way there, a quarter, and so on: points between a point and its nearest have that
    nearest too, and are farther from ridges.
    """
    count, ways = len(points), _directions(DIRECTIONS).to(points)
    around = points[:, None] + away[:, None, None] * ways
    when = None if time is None else time[:, None].expand(count, DIRECTIONS)
    lowest = _value(field, around, when).abs().topk(TRIES, largest=False).indices
    centre = points.repeat_interleave(TRIES, 0)
    when = None if time is None else time.repeat_interleave(TRIES)
    best = _settled(field, around.gather(1, lowest[..., None].expand(-1, -1, 3)).reshape(-1, 3), when, tolerance, steps)
    gone = (best.points - centre).norm(dim=-1).where(best.converged, math.inf)
    for halving in range(1, HALVINGS + 1):
        start = torch.lerp(centre, best.points, 0.5**halving)
        found = _settled(field, start, when, tolerance, steps)
        length = (found.points - centre).norm(dim=-1).where(found.converged, math.inf)
        nearer = length < gone
        gone = torch.minimum(gone, length)
        best = Closest(
            found.points.where(nearer[:, None], best.points),
            found.normals.where(nearer[:, None], best.normals),
            found.converged | best.converged,
        )
    chosen = gone.reshape(count, TRIES).argmin(1) + TRIES * torch.arange(count, device=points.device)
    return Closest(best.points[chosen], best.normals[chosen], best.converged[chosen])


def _directions(count: int) -> Float[Tensor, "count 3"]:
    """Unit vectors spread evenly over the sphere, along a golden spiral."""
    at = torch.arange(count, dtype=torch.float64) + 0.5
    height, turn = 1 - 2 * at / count, math.pi * (1 + math.sqrt(5)) * at
    across = (1 - height.square()).sqrt()
    return torch.stack([across * turn.cos(), across * turn.sin(), height], dim=-1)


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
    positive(tolerance, "tolerance", FINEST)
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
    `lipschitz` proves that none holds a value lower than the best by more than `tolerance`. It sees what is in the
    field: a grid does not hold walls thinner than its voxels, of which its bake's `doubts` speak (`scenes.sdf.thin`).

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
    positive(tolerance, "tolerance", FINEST)
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
    if isinstance(field, SdfGrid | Reach):
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
