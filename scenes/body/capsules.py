"""The smallest capsule around points, and how tightly it fits.

A capsule is convex, so it holds a part when it holds the vertices of the part's convex hull. The smallest one is found
by minimising its volume under one constraint a vertex, from the best of many directions: the problem is not convex,
and a blocky part has several local minima.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

import numpy as np

from scenes.errors import UserError
from scenes.mesh.surface import Faults, clean
from scenes.numbers import MOST

SAMPLES = 2000
"""Points on a surface that stand for it where a share of it may stick out."""

_DIRECTIONS = 96
_STARTS = 4


@dataclass(frozen=True)
class FittedCapsule:
    """A capsule around something, and how tightly it fits.

    Attributes:
        a, b: ends of the segment, metres, in the frame of what was fitted; equal for a ball.
        radius: metres.
        inside: volume (m3) of what was fitted: enclosed by the "mesh" where it is closed, else that of its "hull".
        reference: which of the two.
        uncovered: the farthest (m) that the surface sticks out, 0 where nothing does.
    """

    a: tuple[float, float, float]
    b: tuple[float, float, float]
    radius: float
    inside: float
    reference: Literal["mesh", "hull"]
    uncovered: float

    @property
    def length(self) -> float:
        """Of the segment between the centres of the caps, metres."""
        return math.dist(self.a, self.b)

    @property
    def volume(self) -> float:
        """Cubic metres."""
        return _volume(self.length, self.radius)

    @property
    def volume_ratio(self) -> float:
        """Its volume over that of what was fitted; infinite for what is flat."""
        return self.volume / self.inside if self.inside > 0 else math.inf

    def distance(self, points: np.ndarray) -> np.ndarray:
        """How far ``[n, 3]`` points (m) lie outside, negative inside, ``[n]`` metres."""
        return _away(points, np.array(self.a), np.array(self.b))[0] - self.radius


def fit_capsule(
    points: np.ndarray,
    coverage: float | int = 1.0,
    *,
    faces: np.ndarray | None = None,
) -> FittedCapsule:
    """The smallest capsule that holds points, or a share of them.

    Args:
        points: ``[n, 3]`` metres in any frame: samples of a part or its vertices.
        coverage: share of the points that the capsule must hold, over 0.5; with `faces`, share of the surface. Which
            ones stick out is a local optimum: the farthest are left out, little by little.
        faces: triangles between the points, ``[F, 3]``. They make `coverage` a share of area and, where they are
            closed, `volume_ratio` that of the mesh.

    Points on one line get a capsule without thickness, a single point one without length either.

    Raises:
        UserError: points that are not ``[n, 3]`` or not finite; a coverage outside (0.5, 1].
    """
    points = _checked(points, coverage)
    if (line := _on_one_line(points)) is not None:
        return _judged(points, faces, *line)
    centre = points.mean(axis=0)
    turn = _own_axes(points - centre)
    unit = (points - centre) @ turn
    scale = float(np.ptp(unit, axis=0).max())
    unit /= scale
    if coverage < 1:
        a, b, radius = _trimmed(unit if faces is None else sample_surface(unit, faces, SAMPLES), coverage)
    else:
        a, b, _ = _smallest(_hull(unit)[0])
        radius = float(_away(unit, a, b)[0].max())
    a, b, radius = scale * turn @ a + centre, scale * turn @ b + centre, radius * scale
    return _judged(points, faces, a, b, radius)


def away_from_segment(points: np.ndarray, a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Distance ``[n]`` of points ``[n, 3]`` from the segment between two others."""
    return _away(points, a, b)[0]


# ---- the smallest capsule ---------------------------------------------------------------------------------------


def _volume(length: float, radius: float) -> float:
    return math.pi * radius**2 * (length + 4.0 / 3.0 * radius)


def _away(points: np.ndarray, a: np.ndarray, b: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Distance of points to a segment ``[n]``, the share along it ``[n]``, and the unit vectors away from it."""
    axis = b - a
    share = ((points - a) @ axis / max(float(axis @ axis), 1e-300)).clip(0.0, 1.0)
    offset = points - a - share[:, None] * axis
    distance = np.sqrt(np.einsum("nd,nd->n", offset, offset))
    return distance, share, offset / np.maximum(distance, 1e-300)[:, None]


def _hull(points: np.ndarray) -> tuple[np.ndarray, float]:
    """Vertices of the convex hull and its volume; of what is flat, all points and 0."""
    from scipy.spatial import ConvexHull, QhullError

    try:
        hull = ConvexHull(points)
    except QhullError:
        return np.unique(points, axis=0), 0.0
    return points[hull.vertices], float(hull.volume)


def _smallest(points: np.ndarray) -> tuple[np.ndarray, np.ndarray, float]:
    """Ends and radius of the smallest capsule of points that are about 1 across."""
    ball = points.mean(axis=0)
    found = [_minimise(points, ball, ball, ball=True), *(_minimise(points, a, b) for a, b in _starts(points))]
    return min(found, key=lambda c: _volume(float(np.linalg.norm(c[1] - c[0])), c[2]))


def _starts(points: np.ndarray) -> list[tuple[np.ndarray, np.ndarray]]:
    """Segments along the directions whose capsules come out smallest, at least 15 degrees apart.

    The points are expected along their principal axes.
    """
    k = np.arange(_DIRECTIONS) + 0.5
    height, turn = k / _DIRECTIONS, math.pi * (1 + math.sqrt(5)) * k  # a spiral over half a sphere
    flat = np.sqrt(1 - height**2)
    directions = np.concatenate([np.eye(3), np.stack([flat * np.cos(turn), flat * np.sin(turn), height], axis=1)])
    a, b, volumes = _along(points, directions)
    chosen: list[int] = []
    for i in np.argsort(volumes):
        if len(chosen) < _STARTS and all(abs(directions[i] @ directions[j]) < 0.966 for j in chosen):
            chosen.append(int(i))
    return [(a[i], b[i]) for i in chosen]


def _along(points: np.ndarray, directions: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Ends ``[k, 3]`` and volumes ``[k]`` of tight capsules along directions ``[k, 3]``.

    Each lies on the middle of the points as seen along its direction, and its caps reach no farther than they must.
    """
    helper = np.eye(3)[np.abs(directions).argmin(axis=1)]
    e = np.cross(directions, helper)
    e /= np.linalg.norm(e, axis=1, keepdims=True)
    side = np.stack([e, np.cross(directions, e)], axis=1)  # [k, 2, 3]
    seen, along = np.einsum("kij,nj->kin", side, points), directions @ points.T
    middle = (seen.min(axis=2) + seen.max(axis=2)) / 2
    squared = np.square(seen - middle[:, :, None]).sum(axis=1)
    cap = np.sqrt(squared.max(axis=1, keepdims=True) - squared)  # how far a cap's centre may stay behind each point
    low, high = (along + cap).min(axis=1), (along - cap).max(axis=1)
    low, high = np.where(low < high, low, (low + high) / 2), np.where(low < high, high, (low + high) / 2)
    beyond = np.maximum(np.maximum(low[:, None] - along, along - high[:, None]), 0.0)
    radius = np.sqrt((squared + beyond**2).max(axis=1))
    centre = np.einsum("ki,kij->kj", middle, side)
    a, b = centre + low[:, None] * directions, centre + high[:, None] * directions
    return a, b, math.pi * radius**2 * (high - low + 4.0 / 3.0 * radius)


def _minimise(
    points: np.ndarray, a: np.ndarray, b: np.ndarray, ball: bool = False
) -> tuple[np.ndarray, np.ndarray, float]:
    """A capsule (or ball) that no small change makes smaller, from a start.

    Only the points that are farthest out take part, and more join until none sticks out.
    """
    from scipy.optimize import minimize

    spread = np.eye(7) if not ball else np.eye(7)[:, [3, 4, 5, 6]] + np.eye(7, 4)[:, [0, 1, 2, 3]] * [1, 1, 1, 0]
    taken = np.zeros(len(points), dtype=bool)
    for _ in range(12):
        distance = _away(points, a, b)[0]
        taken[np.argsort(distance)[-32:]] = True
        near = points[taken]

        def room(x: np.ndarray, near: np.ndarray = near) -> np.ndarray:
            y = spread @ x
            slack: np.ndarray = y[6] - _away(near, y[:3], y[3:6])[0]
            return slack

        def room_gradient(x: np.ndarray, near: np.ndarray = near) -> np.ndarray:
            y = spread @ x
            _, share, out = _away(near, y[:3], y[3:6])
            full = np.column_stack([out * (1 - share)[:, None], out * share[:, None], np.ones(len(near))])
            return full @ spread

        begin = np.concatenate([b, [distance.max()]] if ball else [a, b, [distance.max()]])
        done = minimize(
            lambda x: _volume_and_gradient(spread @ x)[0],
            begin,
            jac=lambda x: _volume_and_gradient(spread @ x)[1] @ spread,
            constraints={"type": "ineq", "fun": room, "jac": room_gradient},
            method="SLSQP",
            options={"maxiter": 200, "ftol": 1e-13},
        )
        y = spread @ done.x
        a, b = y[:3], y[3:6]
        radius = float(_away(points, a, b)[0].max())
        if radius <= y[6] + 1e-9:
            break
    return a, b, radius


def _volume_and_gradient(y: np.ndarray) -> tuple[float, np.ndarray]:
    """Volume of the capsule (a, b, radius) ``[7]`` and its gradient."""
    axis, radius = y[3:6] - y[:3], float(y[6])
    length = math.sqrt(float(axis @ axis) + 1e-20)
    along = math.pi * radius**2 * axis / length
    return _volume(length, radius), np.concatenate([-along, along, [2 * math.pi * radius * (length + 2 * radius)]])


def _trimmed(points: np.ndarray, coverage: float) -> tuple[np.ndarray, np.ndarray, float]:
    """The smallest capsule of a share of the points that was found from several starts.

    Fitting the points kept, then keeping those nearest to the new segment, never makes the capsule larger; the share
    shrinks in steps, because points that stick out draw the first axis towards them.
    """
    found: list[tuple[float, int, np.ndarray, np.ndarray, float]] = []
    for a, b in _starts(_hull(points)[0]):
        volume = math.inf
        for share in np.linspace(1.0, coverage, 5)[1:]:
            count = math.ceil(share * len(points) - 1e-9)
            for _ in range(6):
                away = _away(points, a, b)[0].round(5)  # points that touch are equally far; rounding must not choose
                kept = points[np.argsort(away, kind="stable")[:count]]
                a, b, radius = _minimise(kept, a, b)
                before, volume = volume, _volume(float(np.linalg.norm(b - a)), radius)
                if volume > 0.999 * before:
                    break
        found.append((volume, len(found), a, b, radius))
    _, _, a, b, radius = min(found, key=lambda one: one[:2])
    return a, b, radius


def _own_axes(points: np.ndarray) -> np.ndarray:
    """Columns: principal axes of centred points, towards their longer tails, so that fits turn with the points."""
    _, _, axes = np.linalg.svd(points, full_matrices=False)
    axes *= np.where(((points @ axes.T) ** 3).sum(axis=0) < 0, -1.0, 1.0)[:, None]
    turn: np.ndarray = axes.T
    return turn


def _checked(points: np.ndarray, coverage: float) -> np.ndarray:
    points = np.asarray(points, dtype=np.float64)
    if points.ndim != 2 or points.shape[1] != 3 or len(points) == 0:
        raise UserError(f"points to fit have shape {list(points.shape)}; give [n, 3] with at least three points")
    if not (np.abs(points) <= MOST).all():
        raise UserError(
            f"points to fit hold coordinates that are NaN, infinite or over {MOST:.0e} m; repair the mesh first"
        )
    if not 0.5 < coverage <= 1:
        raise UserError(f"coverage is {coverage:g}; give a share above 0.5 and at most 1")
    return points


def _on_one_line(points: np.ndarray) -> tuple[np.ndarray, np.ndarray, float] | None:
    """The capsule of points that lie on one line, but for rounding; None where they do not."""
    _, spread, axes = np.linalg.svd(points - points.mean(axis=0), full_matrices=False)
    if len(spread) > 1 and spread[1] > 1e-9 * max(spread[0], float(np.abs(points).max())):
        return None
    along = points @ axes[0]
    a, b = points[along.argmin()], points[along.argmax()]
    return a, b, float(_away(points, a, b)[0].max())


def _judged(points: np.ndarray, faces: np.ndarray | None, a: np.ndarray, b: np.ndarray, radius: float) -> FittedCapsule:
    """A capsule with its tightness. Distance to a convex shape is convex: on a triangle it is largest at a corner."""
    volume, reference = inner_volume(points, faces)
    sticks_out = max(0.0, float(_away(points, a, b)[0].max()) - radius)
    ends = [(float(p[0]), float(p[1]), float(p[2])) for p in (a, b)]
    return FittedCapsule(ends[0], ends[1], radius, volume, reference, sticks_out)


def quick_volume(points: np.ndarray) -> float:
    """Volume of a capsule along the best principal axis, without refining it."""
    centred = points - points.mean(axis=0)
    return float(_along(centred, _own_axes(centred).T)[2].min())


# ---- what is inside -----------------------------------------------------------------------------------------------


def inner_volume(points: np.ndarray, faces: np.ndarray | None = None) -> tuple[float, Literal["mesh", "hull"]]:
    """Volume inside closed triangles ("mesh"), else that of the points' convex hull ("hull", 0 where they are flat)."""
    enclosed, hull = None if faces is None else enclosed_volume(points, faces), _hull(points)[1]
    # shells that overlap enclose some places twice: what exceeds the hull is no volume of the part
    return (hull, "hull") if enclosed is None or enclosed > 1.001 * hull else (enclosed, "mesh")


def enclosed_volume(vertices: np.ndarray, faces: np.ndarray) -> float | None:
    """Volume inside a mesh, in the unit of its vertices cubed; None where it is not closed or encloses nothing."""
    vertices, faces, slivers = clean(vertices, np.ascontiguousarray(faces, dtype=np.int64))
    if len(faces) == 0 or len(Faults.of(np.concatenate([faces, slivers]), len(vertices)).unmatched):
        return None
    a, b, c = np.moveaxis(vertices[faces] - vertices.mean(axis=0), 1, 0)
    volume = abs(float((a * np.cross(b, c)).sum())) / 6
    size = float(np.ptp(vertices, axis=0).max())
    return volume if volume > 1e-9 * size**3 else None


def sample_surface(vertices: np.ndarray, faces: np.ndarray, count: int) -> np.ndarray:
    """Points spread evenly over triangles, ``[count, 3]``; the same ones whenever it is called.

    Triangles without any area are spread over as if all were of one size.
    """
    corners = vertices[faces]
    areas = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1)
    shares = np.cumsum(areas if areas.sum() > 0 else np.ones(len(faces)))
    which = np.searchsorted(shares, (np.arange(count) + 0.5) / count * shares[-1]).clip(0, len(faces) - 1)
    u, v = np.random.default_rng(0).random((2, count))
    over = u + v > 1
    u, v = np.where(over, 1 - u, u), np.where(over, 1 - v, v)
    a, b, c = np.moveaxis(corners[which], 1, 0)
    points: np.ndarray = a + u[:, None] * (b - a) + v[:, None] * (c - a)
    return points
