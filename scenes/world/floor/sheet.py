"""One sheet of the ground, with at most one height at each place: what is clear on it, and ways over it."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from scenes.kernels import ground as kernels
from scenes.world.floor.polyline import resample

OPEN = 5.0
"""Clearance (m) reported where no obstacle is near, and an upper limit for all."""

COMFORT = 0.3
"""Paths keep this much more than their radius (m) from obstacles where there is room and the detour is short."""

SPACING = 0.05
"""Largest distance (m), seen from above, between neighbouring points of a path."""

TOLL = 5.0
"""So many times its length costs a metre within the radius of a step: ways cross steps at right angles, and few."""


@dataclass(frozen=True, eq=False)
class Sheet:
    """A part of the ground over a map of square cells.

    Attributes:
        heights: of the ground, y in metres, ``[X, Z]``, NaN where the sheet has none.
        surface: which of the scene's surfaces in its cell that is, ``[X, Z]``, -1 for none, as in bridged holes.
        columns: smallest distance (m) to an obstacle, step or edge in each cell's column, ``[X, Z]``.
        climbed: the same for who climbs steps, which then are no obstacles, ``[X, Z]``.
        origin: x and z (m) of the centre of cell [0, 0].
        cell: side of the cells, metres.
    """

    heights: np.ndarray
    surface: np.ndarray
    columns: np.ndarray
    climbed: np.ndarray
    origin: tuple[float, float]
    cell: float

    @cached_property
    def level(self) -> np.ndarray:
        """Horizontal distance (m) from each cell's centre to the nearest obstacle, step or edge, ``[X, Z]``."""
        return _within(_spread(self.columns, self.cell), self.cell)

    @cached_property
    def climbing(self) -> np.ndarray:
        """The same for who climbs steps, ``[X, Z]``."""
        return _within(_spread(self.climbed, self.cell), self.cell)

    def at(self, values: np.ndarray, xz: np.ndarray) -> np.ndarray:
        """One of the maps ``[X, Z]`` at points ``[..., 2]`` (x, z in metres), bilinear, NaN outside."""
        grid = (np.asarray(xz, dtype=np.float64) - self.origin) / self.cell
        limit = np.array(values.shape) - 1
        inside = ((grid >= -0.5) & (grid <= limit + 0.5)).all(axis=-1)
        grid = np.clip(grid, 0, limit)
        low = np.minimum(np.floor(grid).astype(int), np.maximum(limit - 1, 0))
        high = np.minimum(low + 1, limit)
        (u, v), c = np.moveaxis(grid - low, -1, 0), values
        x0, z0, x1, z1 = low[..., 0], low[..., 1], high[..., 0], high[..., 1]
        value = (c[x0, z0] * (1 - v) + c[x0, z1] * v) * (1 - u) + (c[x1, z0] * (1 - v) + c[x1, z1] * v) * u
        return np.where(inside, value, np.nan)

    def clear(self, xz: np.ndarray, climb: bool = False) -> np.ndarray:
        """Clearance (m) at points ``[..., 2]`` (x, z in metres); negative outside the map, whose border is an edge."""
        xz = np.asarray(xz, dtype=np.float64)
        value = self.at(self.climbing if climb else self.level, xz)
        low = np.array(self.origin) - self.cell / 2
        high = low + np.array(self.heights.shape) * self.cell
        border = np.minimum(xz - low, high - xz).min(axis=-1)
        return np.where(np.isnan(value), -1.0, np.minimum(value, border))

    def ground(self, xz: np.ndarray) -> np.ndarray:
        """Height (m) of the ground at points ``[n, 2]``: bilinear on slopes, never between steps; NaN where none is."""
        points = np.stack([xz[:, 0], np.full(len(xz), np.nan), xz[:, 1]], axis=1)
        found = np.full(len(xz), np.nan)
        kernels.under(self.heights[..., None], *self.origin, self.cell, points, 0.0, 0.0, found)
        return found

    def cell_of(self, xz: np.ndarray) -> tuple[int, int]:
        """The cell of a point ``[2]``, or the nearest one."""
        grid = np.round((xz - self.origin) / self.cell).astype(int)
        x, z = np.clip(grid, 0, np.array(self.heights.shape) - 1)
        return int(x), int(z)


@dataclass(frozen=True, eq=False)
class Walker:
    """Somebody of some radius on a sheet, who climbs steps or does not.

    Attributes:
        sheet: the ground.
        radius: metres.
        climb: whether steps are climbed.
    """

    sheet: Sheet
    radius: float
    climb: bool

    @property
    def clearance(self) -> np.ndarray:
        """The map ``[X, Z]`` of what is clear to them, metres."""
        return self.sheet.climbing if self.climb else self.sheet.level

    def clear(self, xz: np.ndarray) -> np.ndarray:
        """Clearance (m) at points ``[..., 2]`` (x, z in metres)."""
        return self.sheet.clear(xz, self.climb)

    @cached_property
    def cost(self) -> np.ndarray:
        """Cost of a metre at each cell's centre, ``[X, Z]``."""
        return self._cost(self.clearance, self.sheet.level if self.climb else None)

    def _cost(self, clearance: np.ndarray, level: np.ndarray | None) -> np.ndarray:
        """1 in the open, 3 along the nearest allowed line beside obstacles, infinite beyond; on steps `TOLL` times."""
        lack = np.clip((self.radius + COMFORT - clearance) / COMFORT, 0.0, 1.0)
        cost = np.where(clearance >= self.radius, 1.0 + 2.0 * lack**2, np.inf)
        return cost if level is None else cost * np.where(level < self.radius, TOLL, 1.0)

    def free_cell(self, xz: np.ndarray) -> tuple[int, int]:
        """The cell of a free point, or the free one of its neighbours that is nearest."""
        sheet = self.sheet
        grid, limit = (xz - sheet.origin) / sheet.cell, np.array(self.clearance.shape) - 1
        x, z = sheet.cell_of(xz)
        around = [(i, j) for i in range(x - 1, x + 2) for j in range(z - 1, z + 2)]
        free = [
            (i, j)
            for i, j in around
            if 0 <= i <= limit[0] and 0 <= j <= limit[1] and self.clearance[i, j] >= self.radius
        ]
        return min(free, key=lambda c: float(((np.array(c) - grid) ** 2).sum())) if free else (x, z)

    def cheapest(self, start: np.ndarray, goal: np.ndarray) -> np.ndarray | None:
        """Places ``[n, 2]`` (x, z in m) of the cheapest way over the map's cells; None if there is none."""
        from skimage.graph import MCP_Geometric

        first, last = self.free_cell(start), self.free_cell(goal)
        cost = self.cost.copy()
        for x, z in (first, last):
            cost[x, z] = min(cost[x, z], 3.0)  # the end itself is free even if the centre of its cell is not
        search = MCP_Geometric(cost, fully_connected=True)
        total, _ = search.find_costs([first], [last])
        if not np.isfinite(total[last]):
            return None
        cells = np.array(search.traceback(last), dtype=np.float64)
        return cells * self.sheet.cell + self.sheet.origin

    def smoothed(self, places: np.ndarray) -> np.ndarray:
        """A way ``[P, 3]`` over places ``[n, 2]``: pulled straight where that costs no more, rounded, on the ground."""
        line = resample(self._rounded(resample(self._pulled(places), SPACING)), SPACING)
        return np.stack([line[:, 0], self.sheet.ground(line), line[:, 1]], axis=1)

    def _price(self, a: np.ndarray, b: np.ndarray) -> float:
        """Cost of the straight line between two points: infinite where it is not free."""
        steps = max(2, int(np.ceil(np.linalg.norm(b - a) / (self.sheet.cell / 2))) + 1)
        points = a + np.linspace(0.0, 1.0, steps)[:, None] * (b - a)
        cost = self._cost(self.clear(points), self.sheet.clear(points) if self.climb else None)
        return float((cost[1:] + cost[:-1]).mean() / 2 * np.linalg.norm(b - a))

    def _pulled(self, points: np.ndarray) -> np.ndarray:
        """Corners of the path after straight shortcuts that cost no more than what they replace."""
        prices = [self._price(a, b) for a, b in zip(points[:-1], points[1:], strict=True)]
        along = np.concatenate([[0.0], np.cumsum(np.where(np.isfinite(prices), prices, 3 * self.sheet.cell))])
        corners, at = [points[0]], 0
        while at < len(points) - 1:
            ahead = at + 1
            for candidate in range(len(points) - 1, at + 1, -1):
                if self._price(points[at], points[candidate]) <= along[candidate] - along[at] + 1e-9:
                    ahead = candidate
                    break
            corners.append(points[ahead])
            at = ahead
        return np.array(corners)

    def _rounded(self, line: np.ndarray) -> np.ndarray:
        """The polyline with its corners rounded: each point moves to its neighbours' middle where that is free.

        A quarter of a cell more than the radius is asked for, since the map is flat between its cells.
        """
        for _ in range(60):
            moved = line.copy()
            moved[1:-1] = (line[:-2] + 2 * line[1:-1] + line[2:]) / 4
            kept = self.clear(moved) >= np.minimum(self.radius + self.sheet.cell / 4, self.clear(line))
            line = np.where(kept[:, None], moved, line)
        return line


def reach_of(cell: float) -> float:
    """From a sample to the farthest point of its cube: half the diagonal (m) of one of a cell's side."""
    return float(np.sqrt(3) / 2 * cell)


def _within(clearance: np.ndarray, cell: float) -> np.ndarray:
    """Clearance (m) with the map's border as an edge."""
    rows, columns = (np.minimum(np.arange(n), np.arange(n)[::-1]) for n in clearance.shape)
    border = (np.minimum(rows[:, None], columns[None, :]) + 0.5) * cell
    return np.minimum(clearance, border)


def _spread(nearest: np.ndarray, cell: float) -> np.ndarray:
    """Horizontal clearance (m) from the smallest distance (m) in every cell's column.

    Distances in a column cannot serve as they are, for the floor is near as well. But every obstacle comes within
    `reach_of` a cell of a sample in its own column; such cells are the
    obstacles, each known more exactly than its size by the distance it holds: a point is as far from the obstacle
    as from that cell, and the remaining distance.
    """
    from scipy.spatial import cKDTree

    reach = reach_of(cell)
    blocked = np.argwhere(nearest <= reach)
    if len(blocked) == 0:
        return np.full(nearest.shape, OPEN)
    tree = cKDTree(blocked)
    remaining = nearest[blocked[:, 0], blocked[:, 1]]
    count = min(8, len(blocked))
    clearance = np.empty(nearest.shape)
    columns = np.arange(nearest.shape[1])
    for row in range(nearest.shape[0]):  # row by row, for memory's sake
        away, which = tree.query(np.stack([np.full_like(columns, row), columns], axis=1), k=count)
        away, which = away.reshape(-1, count), which.reshape(-1, count)
        clearance[row] = (away * cell + remaining[which]).min(axis=1)
    return np.minimum(clearance, OPEN)
