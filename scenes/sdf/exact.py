"""Signed distances from the triangles themselves: the oracle that scores motions.

What lies in closed pieces their winding numbers say, exactly and independent of any grid. Before open pieces they
cannot: there sides are what the bake found with all its evidence, carried to a point by where it can be reached from.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeAlias

import numpy as np
import torch

from scenes.mesh.surface import Surface
from scenes.sdf.blocks import SdfBlocks
from scenes.sdf.free_space import Sides
from scenes.sdf.grid import SdfGrid

Baked: TypeAlias = SdfGrid | SdfBlocks

_CELLS = (0.5, 0.2, 0.08)
"""Metres across cells in which one point speaks for others, coarse to fine. Ours."""
REACH = 1.0
"""Voxels from the surface at which the side of a point near it is looked up; in soups and torn rooms grid and scorer
then agree at 99.97 % of the points that are half a voxel off and more (tests/scenes/sdf/test_sides.py)."""


def signed_distance(
    sides: Sides, points: np.ndarray, baked: Callable[[], Baked], thickness: float | int = 0.0
) -> np.ndarray:
    """Exact distance (m) to the triangles, positive in free space.

    Args:
        sides: the triangles, and what is free about them.
        points: ``[n, 3]`` float64 metres, world.
        baked: gives what was baked from them; asked for sides before open pieces, never for distances.
        thickness: metres that walls without one have in what was baked.
    """
    unsigned = sides.surface.unsigned_distance(points)
    asked, whose = np.unique(speakers(points, unsigned), return_inverse=True)
    free = sides.out_of_solids(points[asked])[whose]
    if sides.sheets is not None:
        open_to = np.flatnonzero(free)
        free[open_to] = _before_sheets(sides, sides.sheets, points[open_to], unsigned[open_to], baked(), thickness / 2)
    if sides.seed is not None:  # no surface lies nearer to it than the nearest
        away = np.linalg.norm(points - sides.seed, axis=1)
        free |= away < sides.surface.unsigned_distance(sides.seed[None])[0]
    return np.where(free, unsigned, -unsigned)


def speakers(points: np.ndarray, unsigned: np.ndarray) -> np.ndarray:
    """For each of ``[n, 3]`` points the number of one on the same side of a surface; few are left to be asked.

    In a ball around a point that reaches no surface, all is on that point's side: of the points in a cell the one that
    is farthest from the surface (m, `unsigned`) speaks for those in its ball, in cells of `_CELLS` one after the other.
    """
    found, alone = np.arange(len(points)), np.arange(len(points))
    for size in _CELLS:
        _, cell = np.unique(np.floor(points[alone] / size).astype(np.int64), axis=0, return_inverse=True)
        order = np.lexsort((-unsigned[alone], cell.ravel()))
        first = np.flatnonzero(np.diff(cell.ravel()[order], prepend=-1))
        speaker = np.empty_like(alone)
        speaker[order] = np.repeat(alone[order[first]], np.diff(first, append=len(order)))
        within = np.linalg.norm(points[alone] - points[speaker], axis=1) < (1 - 1e-6) * unsigned[speaker]
        found[alone[within]] = speaker[within]
        alone = alone[~within]
    return found


def _before_sheets(
    sides: Sides, sheets: Surface, points: np.ndarray, unsigned: np.ndarray, field: Baked, skin: float
) -> np.ndarray:
    """Which points are free, out of solids: as the nodes around them, or near a surface as a place farther from it.

    Between a point and that place the winding number changes by whole numbers where surfaces lie between them.
    """
    free = _baked_free(field, points)
    near = np.flatnonzero(unsigned <= skin + np.sqrt(3.0) * field.spacing)
    if len(near) == 0:
        return free
    here, surface = points[near], sides.surface.closest(points[near])
    away = here - surface
    away /= np.maximum(np.linalg.norm(away, axis=1, keepdims=True), 1e-12)
    there = surface + (skin + REACH * field.spacing) * away
    crossed = np.rint(sheets.winding_fast(there) - sheets.winding_fast(here)).astype(int)
    turns = (crossed % 2 == 1) & (sheets.nearly_closed | sides.rule.inward)  # loose sheets have air on both sides
    free[near] = _baked_free(field, there) != turns
    return free


def _baked_free(field: Baked, points: np.ndarray) -> np.ndarray:
    with torch.no_grad():
        return np.asarray(field.distance(torch.from_numpy(np.ascontiguousarray(points))) > 0)
