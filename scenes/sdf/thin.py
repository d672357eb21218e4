"""Walls that are thinner than a voxel, which a grid does not hold: where they are, and what would do.

Where no node lies within a wall, the interpolant stays positive on a way through it. Within a plane wall it exceeds the
distance by half a voxel at most (the mean of |n (x_i - x)| over the corners of a voxel, weighted as the interpolant
weights them, is largest in the middle): a wall thicker than a voxel is negative inside, and from one of thickness t
what is at least (voxel - t) thick is seen to cross.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from scenes.sdf.free_space import Sides

SAMPLES = 2048
"""Points of a surface that are looked at."""

FEW = 4
"""So many of them make a wall: 0.2 % of the area, a board of 0.3 x 0.3 m in a room of 100 m²."""

LOOKED_AT = 1024
"""Of those with air on both sides, so many are looked at closely: what there is beyond costs the most."""


def thin_doubts(sides: Sides, value: Callable[[np.ndarray], np.ndarray], spacing: float, name: str) -> tuple[str, ...]:
    """What a grid of these voxels does not hold of a surface, one sentence for each kind of wall.

    Args:
        sides: the surface, and what of the space around it is free.
        value: of the grid at world points ``[n, 3]`` (m), positive in free space, to a voxel.
        spacing: metres a voxel.
        name: of the mesh, for the sentences.
    """
    points, thickness = _walls(sides, value, spacing)
    text = f"which is thinner than its voxels of {1e3 * spacing:.3g} mm"
    thick, doubts = _rounded(spacing, math.ceil), []
    for sort in (thickness == 0, thickness > 0):
        if sort.sum() < FEW:
            continue
        order = np.flatnonzero(sort)[np.argsort(thickness[sort], kind="stable")]
        thin = float(thickness[order[FEW - 1]])
        x, y, z = (points[order[0]] + sides.surface.centre).round(2) + 0.0
        what = f"a wall {1e3 * thin:.2g} mm thick" if thin else "a wall without thickness"
        setting, metres = ("spacing", _rounded(0.9 * thin, math.floor)) if thin else ("thickness", thick)
        doubts.append(
            f"mesh '{name}' has {what} at ({x:.2f}, {y:.2f}, {z:.2f}), {text}: what is itself thinner than"
            f" {1e3 * (spacing - thin):.2g} mm may cross it unseen; state {setting} = {metres:g}"
        )
    return tuple(doubts)


def _walls(sides: Sides, value: Callable[[np.ndarray], np.ndarray], spacing: float) -> tuple[np.ndarray, np.ndarray]:
    """Points on walls thinner than a voxel, relative to the surface's centre, and how thick they are (m)."""
    surface, rng = sides.surface, np.random.default_rng(0)
    chosen = surface.by_area(SAMPLES, rng)
    points, normals = surface.points_on(chosen, rng), surface.normals(chosen)
    both = np.stack([normals, -normals])
    # Two voxels off, the nearest node is clear of a wall that is thinner than one.
    free = value((surface.centre + points + 2 * spacing * both).reshape(-1, 3)).reshape(2, -1) > 0
    may = np.flatnonzero(free.all(axis=0))[:LOOKED_AT]
    points, both = points[may], both[:, may]
    through = surface.dipoles.opposite(chosen[may], points, spacing).T
    if not surface.closed:  # a triangle of a closed surface has air on one side at most
        through = np.where(np.isinf(through).all(axis=0), 0.0, through)
    met = np.flatnonzero(np.isfinite(through).any(axis=0))
    points, through, way = points[met], through[:, met].min(axis=0), both[through[:, met].argmin(axis=0), met]
    step = 1e-3 * spacing
    ends = np.concatenate([points - step * way, points + (through + step)[:, None] * way])
    between = sides.by_winding(surface.centre + ends).reshape(2, -1).all(axis=0)
    return points[between], np.where(through > step, through, 0.0)[between]


def _rounded(metres: float, way: Callable[[float], int]) -> float:
    """Metres with two digits, downwards or upwards."""
    unit = 10.0 ** (math.floor(math.log10(metres)) - 1)
    return round(way(round(metres / unit, 3)) * unit, 12)
