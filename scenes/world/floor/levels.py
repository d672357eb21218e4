"""All that can be stood on in a scene: surfaces with free space above them, storey over storey."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import torch

from scenes.kernels import ground as kernels
from scenes.mesh.mesh import Mesh
from scenes.mesh.primitives import Plane
from scenes.motion.frames import fine_enough

CELL = 0.05
"""Side of the cells (m) of a scene's map, where it does not grow too large."""

STEP = 0.1
"""What is lower than this above the ground (m) is no obstacle: noise of scans, rugs, sills."""

SLOPE = float(np.tan(np.radians(20.5)))
"""Rise over run up to which ground is walked on: 20 degrees, and half a degree for the rounding of coordinates."""

FLAT = float(np.cos(np.radians(45.0)))
"""Share of a triangle's normal along y from which it may be ground: noise of a centimetre tilts the triangles of a
scan, which are some centimetres long, by more than `SLOPE` allows; slopes are measured on the map."""

ROOM = 1.5
"""Free height (m) over a place to stand, as `scenectl check` asks for at a start."""

_CELLS = 1_000_000  # largest map: 50 x 50 m in cells of 5 cm; of larger scenes the cells are larger


@dataclass(frozen=True, eq=False)
class Levels:
    """Surfaces with free space above them, over a map of square cells.

    A vertical line through each cell's centre is crossed with all triangles, exactly. Of what it meets, a surface is
    kept that is not steep for a triangle, whichever way it faces, if half-way to what hangs above it space is free; of
    several within `STEP` the highest.

    Attributes:
        heights: of the K surfaces in each cell, y in metres, ascending, ``[X, Z, K]``, NaN where a cell has fewer.
        headroom: metres from each to the next crossing that is more than `STEP` above it, ``[X, Z, K]``.
        origin: x and z (m) of the centre of cell [0, 0].
        cell: side of the cells, metres.
        beyond: height (m) of the ground outside the map, NaN where there is none.
    """

    heights: np.ndarray
    headroom: np.ndarray
    origin: tuple[float, float]
    cell: float
    beyond: float

    @classmethod
    def of(
        cls,
        meshes: Sequence[Mesh],
        planes: Sequence[Plane],
        distance: Callable[[torch.Tensor], torch.Tensor],
        bounds: np.ndarray,
        cell: float,
        lift: float = 0.0,
    ) -> Levels:
        """Find them.

        Args:
            meshes: what may be stood on.
            planes: that may be stood on.
            distance: of the scene, m, positive in free space: ``[n, 3] -> [n]``.
            bounds: lowest and highest corner of the map, ``[2, 3]``, m.
            cell: side of the cells, m.
            lift: by how much surfaces are thickened, m.
        """
        origin, counts = lattice(bounds, cell)
        level = [plane for plane in planes if abs(plane.normal[1]) >= np.cos(np.arctan(SLOPE))]
        cells, heights, flat = _crossed(meshes, level, origin, counts, cell)
        order = np.lexsort((heights, cells))
        cells, heights, flat = cells[order], heights[order], flat[order]
        which, room = _topmost(cells, heights, flat)
        cells, heights = cells[which], heights[which]
        x, z = (origin[k] + cell * index for k, index in enumerate(np.divmod(cells, counts[1])))
        middle = heights + np.maximum(np.minimum(room, ROOM) / 2, lift + STEP / 2)
        with torch.no_grad():
            free = distance(torch.from_numpy(fine_enough(np.stack([x, middle, z], axis=1)))).numpy() > 0
        cells, heights, room = cells[free], heights[free], room[free]
        first = np.searchsorted(cells, cells)
        rank = np.arange(len(cells)) - first
        shape = (int(np.prod(counts)), int(rank.max(initial=0)) + 1)
        maps = np.full((2, *shape), np.nan)
        maps[0][cells, rank], maps[1][cells, rank] = heights, room
        maps = maps.reshape(2, *counts, shape[1])
        stated = [plane.point[1] for plane in level if plane.normal[1] == 1.0]
        return cls(maps[0], maps[1], origin, cell, max(stated, default=np.nan))

    @cached_property
    def walkable(self) -> np.ndarray:
        """`heights` without what is steeper than `SLOPE`, ``[X, Z, K]``: NaN there."""
        return np.where(kernels.steep(self.heights, self.cell, STEP, SLOPE), np.nan, self.heights)

    def under(self, points: np.ndarray, main: float) -> np.ndarray:
        """Height (m) of the ground under points ``[n, 3]``: nearest below each, or where y is NaN nearest to `main`.

        What is up to `STEP` above a point counts as below it. NaN where there is no ground, or none below.
        """
        found = np.full(len(points), np.nan)
        points = np.ascontiguousarray(points, dtype=np.float64)
        kernels.under(self.heights, *self.origin, self.cell, points, main, STEP, found)
        if not np.isnan(self.beyond):
            place = (points[:, [0, 2]] - self.origin) / self.cell
            outside = (place < -0.5) | (place > np.array(self.heights.shape[:2]) - 0.5)
            found[outside.any(axis=1)] = self.beyond
        return found


def lattice(bounds: np.ndarray, cell: float) -> tuple[tuple[float, float], np.ndarray]:
    """Centre of the first cell (x, z in m) and numbers of cells ``[2]`` that cover bounds ``[2, 3]``."""
    low, high = bounds[:, [0, 2]]
    counts = np.maximum(np.ceil((high - low) / cell - 1e-6).astype(int), 1)
    origin = (low + high) / 2 - (counts - 1) / 2 * cell
    return (float(origin[0]), float(origin[1])), counts


def fitting(bounds: np.ndarray) -> float:
    """Side (m) of a scene's own cells: `CELL`, or what keeps their number within a million."""
    low, high = bounds[:, [0, 2]]
    return max(CELL, float(np.sqrt(np.prod(high - low) / _CELLS)))


def _crossed(
    meshes: Sequence[Mesh], planes: Sequence[Plane], origin: tuple[float, float], counts: np.ndarray, cell: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Numbers of cells, heights (m) and flatness of all that their vertical lines meet, in any order."""
    found = []
    for mesh in meshes:
        vertices, faces = np.asarray(mesh.vertices, np.float64), np.asarray(mesh.faces, np.int64)
        found.append(kernels.crossings(vertices, faces, FLAT, *origin, cell, *counts.tolist()))
    x, z = np.divmod(np.arange(int(np.prod(counts))), counts[1])
    for plane in planes:
        (px, py, pz), (nx, ny, nz) = plane.point, plane.normal
        heights = py - (nx * (origin[0] + cell * x - px) + nz * (origin[1] + cell * z - pz)) / ny
        found.append((x * counts[1] + z, heights, np.ones(len(x), dtype=bool)))
    if not found:
        return np.zeros(0, np.int64), np.zeros(0), np.zeros(0, dtype=bool)
    cells, heights, flat = (np.concatenate(column) for column in zip(*found, strict=True))
    return cells, heights, flat


def _topmost(cells: np.ndarray, heights: np.ndarray, flat: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Of sorted crossings, which are flat and the highest within `STEP`; and the free height (m) over each of them."""
    which = np.flatnonzero(flat)
    covered = (np.diff(cells[which]) == 0) & (np.diff(heights[which]) <= STEP + 1e-6)
    which = which[~np.append(covered, False)] if len(which) else which
    if not len(which):
        return which, np.zeros(0)
    span = float(np.ptp(heights)) + 2 * STEP
    keys = cells * span + (heights - heights.min())  # ascending, a cell's within `span`
    above = np.searchsorted(keys, keys[which] + STEP, side="right")
    same = (above < len(cells)) & (cells[np.minimum(above, len(cells) - 1)] == cells[which])
    return which, np.where(same, heights[np.minimum(above, len(cells) - 1)] - heights[which], np.inf)
