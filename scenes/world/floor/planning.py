"""Where on the floor a person can stand, and the way from one place to another."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TypeAlias

import numpy as np
import torch

from scenes.errors import UserError
from scenes.motion.frames import fine_enough
from scenes.world.floor.polyline import resample
from scenes.world.scene import Scene

Place: TypeAlias = Sequence[float] | Sequence[int] | np.ndarray
"""A point of the floor: x and z, metres, world."""

STEP = 0.1
"""What is lower than this above the floor (m) is no obstacle: noise of scans, rugs, sills."""

FLOOR_BELOW = 0.15
"""A cell has floor below it when a surface lies within this distance (m) of the floor's height there."""

OPEN = 5.0
"""Clearance (m) reported where no obstacle is near, and an upper limit for all."""

COMFORT = 0.3
"""Paths keep this much more than their radius (m) from obstacles where there is room and the detour is short."""

SPACING = 0.05
"""Largest distance (m) between neighbouring points of a path."""

_CELLS = 16_000_000  # largest map: 200 x 200 m in cells of 5 cm


@dataclass(frozen=True, eq=False)
class FreeArea:
    """Where on the floor a person can be.

    Attributes:
        clearance: horizontal distance (m) from each cell's centre to the nearest obstacle or to the edge of the
            floor, ``[X, Z]``, at most 5; 0 or less where no person can stand.
        origin: x and z (m) of the centre of cell [0, 0].
        cell: side of the square cells, metres.
        floor: height of the floor, metres.
        radius: of the person, metres: the default of every method.
        height: of the person, metres: what hangs higher is no obstacle.
    """

    clearance: np.ndarray
    origin: tuple[float, float]
    cell: float
    floor: float
    radius: float
    height: float

    def clearance_at(self, xz: np.ndarray) -> np.ndarray:
        """Clearance (m) at points ``[..., 2]`` (x, z in metres), bilinear; negative outside the map."""
        grid = (np.asarray(xz, dtype=np.float64) - self.origin) / self.cell
        limit = np.array(self.clearance.shape) - 1
        inside = ((grid >= -0.5) & (grid <= limit + 0.5)).all(axis=-1)
        grid = np.clip(grid, 0, limit)
        low = np.minimum(np.floor(grid).astype(int), np.maximum(limit - 1, 0))
        high = np.minimum(low + 1, limit)
        (u, v), c = np.moveaxis(grid - low, -1, 0), self.clearance
        x0, z0, x1, z1 = low[..., 0], low[..., 1], high[..., 0], high[..., 1]
        value = (c[x0, z0] * (1 - v) + c[x0, z1] * v) * (1 - u) + (c[x1, z0] * (1 - v) + c[x1, z1] * v) * u
        return np.where(inside, value, -1.0)

    def contains(self, xz: np.ndarray, radius: float | None = None) -> np.ndarray:
        """True where a person of `radius` (m) can stand, for points ``[..., 2]`` (x, z in metres)."""
        return np.asarray(self.clearance_at(xz) >= (self.radius if radius is None else radius))

    @property
    def square_metres(self) -> float:
        """Area (m²) of the cells where a person of the default radius can stand."""
        return float((self.clearance >= self.radius).sum()) * self.cell**2

    def sample(self, n: int, rng: np.random.Generator, radius: float | None = None) -> np.ndarray:
        """`n` places ``[n, 2]`` (x, z in metres), uniform over where a person of `radius` (m) can stand.

        Raises:
            UserError: there is no such place.
        """
        radius = self.radius if radius is None else radius
        cells = np.argwhere(self.clearance >= radius - self.cell)  # a neighbour of a free place may hold one as well
        found = np.zeros((0, 2))
        for _ in range(1000):
            if len(found) >= n or len(cells) == 0:
                break
            tries = rng.uniform(-0.5, 0.5, size=(2 * n + 16, 2)) + cells[rng.integers(len(cells), size=2 * n + 16)]
            points = tries * self.cell + self.origin
            found = np.concatenate([found, points[self.contains(points, radius)]])
        if len(found) < n:
            raise UserError(
                f"nowhere on the floor is a person of radius {radius:g} m and height {self.height:g} m clear of "
                f"obstacles (the widest place has {self.clearance.max():.2f} m); use a smaller radius"
            )
        return found[:n]

    def path(self, start_xz: Place, goal_xz: Place, radius: float | None = None) -> np.ndarray:
        """The way from `start_xz` to `goal_xz` (x, z in metres) for a person of `radius` (m).

        The cheapest path on the map (scikit-image's fast-marching-like minimum cost path) for a cost that rises
        within `COMFORT` of what the radius allows, pulled straight where that costs no more, rounded at its corners.

        Returns:
            ``[P, 3]`` metres, world, at the floor's height, first and last point as given, neighbours at most 5 cm
            apart; every point keeps `radius` from obstacles by the map.

        Raises:
            UserError: start or goal is not free (by how much), or no path joins them (the largest radius that can).
        """
        radius = self.radius if radius is None else radius
        ends = [np.asarray(end, dtype=np.float64) for end in (start_xz, goal_xz)]
        for name, end in zip(("start", "goal"), ends, strict=True):
            self._check_free(name, end, radius)
        cells = self._cheapest(ends[0], ends[1], radius)
        corners = self._pulled(np.concatenate([ends[:1], cells * self.cell + self.origin, ends[1:]]), radius)
        line = self._rounded(resample(corners, SPACING), radius)
        line = resample(line, SPACING)
        return np.stack([line[:, 0], np.full(len(line), self.floor), line[:, 1]], axis=1)

    def _check_free(self, name: str, end: np.ndarray, radius: float) -> None:
        if end.shape != (2,) or not np.isfinite(end).all():
            raise UserError(f"path {name} is {end.tolist()}; give x and z in metres")
        clear = float(self.clearance_at(end))
        if clear >= radius:
            return
        nearest = self._nearest_free(end, radius)
        hint = "no place on this floor is" if nearest is None else f"({nearest[0]:.2f}, {nearest[1]:.2f}) is nearest"
        at = f"({end[0]:.2f}, {end[1]:.2f})"
        raise UserError(
            f"path {name} {at} is not free: an obstacle or the floor's edge is {max(clear, 0):.2f} m away and the "
            f"radius is {radius:g} m; {hint}{' free' if nearest is not None else ''}"
        )

    def _nearest_free(self, xz: np.ndarray, radius: float) -> np.ndarray | None:
        free = np.argwhere(self.clearance >= radius) * self.cell + self.origin
        return free[np.argmin(((free - xz) ** 2).sum(axis=1))] if len(free) else None

    def _cost(self, clearance: np.ndarray, radius: float) -> np.ndarray:
        """Cost of a metre: 1 in the open, 3 along the nearest allowed line beside an obstacle, infinite beyond."""
        lack = np.clip((radius + COMFORT - clearance) / COMFORT, 0.0, 1.0)
        return np.where(clearance >= radius, 1.0 + 2.0 * lack**2, np.inf)

    def _cheapest(self, start: np.ndarray, goal: np.ndarray, radius: float) -> np.ndarray:
        """Cells ``[n, 2]`` of the cheapest path."""
        from skimage.graph import MCP_Geometric

        first, last = (self._free_cell(end, radius) for end in (start, goal))
        cost = self._cost(self.clearance, radius)
        for x, z in (first, last):
            cost[x, z] = min(cost[x, z], 3.0)  # the end itself is free even if the centre of its cell is not
        search = MCP_Geometric(cost, fully_connected=True)
        total, _ = search.find_costs([first], [last])
        if not np.isfinite(total[last]):
            raise UserError(self._no_way(start, goal, radius))
        return np.array(search.traceback(last), dtype=np.float64)

    def _free_cell(self, xz: np.ndarray, radius: float) -> tuple[int, int]:
        """The cell of a free point, or the free one of its neighbours that is nearest."""
        grid = (xz - self.origin) / self.cell
        limit = np.array(self.clearance.shape) - 1
        x, z = np.clip(np.round(grid).astype(int), 0, limit)
        around = [(i, j) for i in range(x - 1, x + 2) for j in range(z - 1, z + 2)]
        free = [
            (i, j) for i, j in around if 0 <= i <= limit[0] and 0 <= j <= limit[1] and self.clearance[i, j] >= radius
        ]
        if not free:
            return int(x), int(z)
        return min(free, key=lambda c: float(((np.array(c) - grid) ** 2).sum()))

    def _no_way(self, start: np.ndarray, goal: np.ndarray, radius: float) -> str:
        widest = self.widest(start, goal)
        ends = f"from ({start[0]:.2f}, {start[1]:.2f}) to ({goal[0]:.2f}, {goal[1]:.2f})"
        hint = f"a radius of {widest:.2f} m would pass" if widest > 0 else "they are on separate parts of the floor"
        return f"no way {ends} is {radius:g} m clear of obstacles on both sides and {self.height:g} m high; {hint}"

    def widest(self, start_xz: Place, goal_xz: Place) -> float:
        """The largest radius (m, to 5 mm) that gets from start to goal (x, z in metres); 0 if none does."""
        from scipy.ndimage import label

        ends = [np.asarray(end, dtype=np.float64) for end in (start_xz, goal_xz)]
        low, high = 0.0, min(float(self.clearance_at(end)) for end in ends)
        while high - low > 0.005:
            middle = (low + high) / 2
            parts, _ = label(self.clearance >= middle, structure=np.ones((3, 3)))
            first, last = (parts[self._free_cell(end, middle)] for end in ends)
            low, high = (middle, high) if first == last != 0 else (low, middle)
        return float(np.floor(low * 200) / 200)

    def _price(self, a: np.ndarray, b: np.ndarray, radius: float) -> float:
        """Cost of the straight line between two points: infinite where it is not free."""
        steps = max(2, int(np.ceil(np.linalg.norm(b - a) / (self.cell / 2))) + 1)
        points = a + np.linspace(0.0, 1.0, steps)[:, None] * (b - a)
        cost = self._cost(self.clearance_at(points), radius)
        return float((cost[1:] + cost[:-1]).mean() / 2 * np.linalg.norm(b - a))

    def _pulled(self, points: np.ndarray, radius: float) -> np.ndarray:
        """Corners of the path after straight shortcuts that cost no more than what they replace."""
        prices = [self._price(a, b, radius) for a, b in zip(points[:-1], points[1:], strict=True)]
        along = np.concatenate([[0.0], np.cumsum(np.where(np.isfinite(prices), prices, 3 * self.cell))])
        corners, at = [points[0]], 0
        while at < len(points) - 1:
            ahead = at + 1
            for candidate in range(len(points) - 1, at + 1, -1):
                if self._price(points[at], points[candidate], radius) <= along[candidate] - along[at] + 1e-9:
                    ahead = candidate
                    break
            corners.append(points[ahead])
            at = ahead
        return np.array(corners)

    def _rounded(self, line: np.ndarray, radius: float) -> np.ndarray:
        """The polyline with its corners rounded: each point moves to its neighbours' middle where that is free.

        A quarter of a cell more than the radius is asked for, since the map is flat between its cells.
        """
        for _ in range(60):
            moved = line.copy()
            moved[1:-1] = (line[:-2] + 2 * line[1:-1] + line[2:]) / 4
            kept = self.clearance_at(moved) >= np.minimum(radius + self.cell / 4, self.clearance_at(line))
            line = np.where(kept[:, None], moved, line)
        return line

    @cached_property
    def bounds(self) -> np.ndarray:
        """Lowest and highest x, z (m) of the map's cells, ``[2, 2]``."""
        low = np.array(self.origin) - self.cell / 2
        return np.stack([low, low + np.array(self.clearance.shape) * self.cell])


def free_area(scene: Scene, radius: float = 0.3, height: float = 1.8, cell: float = 0.05) -> FreeArea:
    """Map the floor of a scene for a person of `radius` and `height` (m) in square cells of side `cell` (m).

    An obstacle is whatever comes between `STEP` above the floor and `height` above it; cells without floor below,
    outside the room, or inside something count as obstacles too. Moving shapes are taken where they are at 0 s.

    Raises:
        UserError: sizes that make no sense, or a map of more than 16 million cells.
    """
    for name, value, least in (("radius", radius, 0.0), ("height", height, STEP), ("cell", cell, 0.0)):
        if not (np.isfinite(value) and value > least):
            raise UserError(f"free area: {name} is {value} m; give more than {least:g} m")
    low, high = scene.bounds[:, [0, 2]]
    counts = np.maximum(np.ceil((high - low) / cell - 1e-6).astype(int), 1)
    if int(np.prod(counts)) > _CELLS:
        raise UserError(f"free area: {counts[0]} x {counts[1]} cells are too many; use a cell larger than {cell:g} m")
    origin = (low + high) / 2 - (counts - 1) / 2 * cell
    x, z = (origin[k] + cell * np.arange(counts[k]) for k in range(2))
    floor = scene.floor.height
    reach = float(np.sqrt(3) / 2 * cell)  # from a sample to the farthest point of its cube
    lowest, highest = STEP + reach, max(height - reach, STEP + reach)
    nearest = np.full(counts, OPEN)
    for level in np.linspace(lowest, highest, int(np.ceil((highest - lowest) / cell - 1e-6)) + 1):
        np.minimum(nearest, _layer(scene, x, z, floor + level), out=nearest)
    no_floor = np.abs(_layer(scene, x, z, floor)) > FLOOR_BELOW
    nearest[no_floor] = np.minimum(nearest[no_floor], 0.0)
    clearance = _spread(nearest, cell, reach)
    return FreeArea(clearance, (float(origin[0]), float(origin[1])), float(cell), floor, float(radius), float(height))


def _layer(scene: Scene, x: np.ndarray, z: np.ndarray, y: float) -> np.ndarray:
    """Distance (m) of the scene on a horizontal grid ``[X, Z]`` at height y."""
    grid = np.stack(np.broadcast_arrays(x[:, None], y, z[None, :]), axis=-1)
    with torch.no_grad():
        distance = scene.distance(torch.from_numpy(fine_enough(grid)))
    return np.asarray(distance.double())


def _spread(nearest: np.ndarray, cell: float, reach: float) -> np.ndarray:
    """Horizontal clearance (m) from the smallest distance (m) in every cell's column.

    Distances in a column cannot serve as they are, for the floor is near as well. But every obstacle comes within
    `reach` (half the diagonal of a cube of a cell's side) of a sample in its own column; such cells are the
    obstacles, each known more exactly than its size by the distance it holds: a point is as far from the obstacle
    as from that cell, and the remaining distance.
    """
    from scipy.spatial import cKDTree

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
