"""Where on the ground a person can stand, and the way from one place to another."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TypeAlias

import numpy as np

from scenes.errors import UserError
from scenes.world.floor.across import across
from scenes.world.floor.levels import CELL, STEP, fitting, lattice
from scenes.world.floor.mapping import CLIMB, HEIGHT, RADIUS, Mapper
from scenes.world.floor.polyline import climbs
from scenes.world.floor.sheet import COMFORT, OPEN, SPACING, Sheet, Walker
from scenes.world.scene import Scene

__all__ = ["CLIMB", "COMFORT", "OPEN", "SPACING", "STEP", "FreeArea", "Place", "free_area"]

Place: TypeAlias = Sequence[float] | Sequence[int] | np.ndarray
"""A point of the ground: x and z, metres, world; or x, y and z, where y tells storeys apart."""

OFF = 0.25
"""Metres that a stated height may be off the ground: more than a step up to `CLIMB`, less than the seat of a chair."""

COARSEST = 0.2
"""Side (m) of the widest cells in which ways are planned by default: scenes of 200 x 200 m. Doors are four of them."""

_CELLS = 16_000_000  # largest map: 200 x 200 m in cells of 5 cm


@dataclass(frozen=True, eq=False)
class FreeArea:
    """Where on the ground a person can be.

    Attributes:
        sheets: of the ground: the main floor with what hangs together with it, then storeys over or under it.
        floor: height of the main floor, metres.
        radius: of the person, metres: the default of every method.
        height: of the person, metres: what hangs higher is no obstacle.
    """

    sheets: tuple[Sheet, ...]
    floor: float
    radius: float
    height: float

    @property
    def clearance(self) -> np.ndarray:
        """Horizontal distance (m) from each cell's centre to the nearest obstacle, or step of more than `STEP`, or edge
        of the ground or the map, ``[X, Z]``, at most 5; 0 or less where no person can stand. Of the first sheet."""
        return self.sheets[0].level

    @property
    def origin(self) -> tuple[float, float]:
        """x and z (m) of the centre of cell [0, 0]."""
        return self.sheets[0].origin

    @property
    def cell(self) -> float:
        """Side of the square cells, metres."""
        return self.sheets[0].cell

    def clearance_at(self, xz: np.ndarray) -> np.ndarray:
        """Clearance (m) at points ``[..., 2]`` (x, z in m) of the first sheet, bilinear; negative outside the map."""
        return self.sheets[0].clear(xz)

    def contains(self, xz: np.ndarray, radius: float | None = None) -> np.ndarray:
        """True where a person of `radius` (m) can stand, for points ``[..., 2]`` (x, z in m) of the first sheet."""
        return np.asarray(self.clearance_at(xz) >= (self.radius if radius is None else radius))

    def free(self, place: Place, radius: float | None = None) -> bool:
        """Whether a path for a person of `radius` (m) can end at a place on any storey."""
        try:
            self._end("end", place, self.radius if radius is None else radius)
        except UserError:
            return False
        return True

    @property
    def square_metres(self) -> float:
        """Area (m²) of the cells, of all storeys, where a person of the default radius can stand."""
        count = max(int(sheet.surface.max()) for sheet in self.sheets) + 2
        found = []
        for k, sheet in enumerate(self.sheets):  # what several sheets hold counts once, and bridged holes once
            free = (sheet.level >= self.radius) & ((sheet.surface >= 0) | (k == 0))
            found.append(np.flatnonzero(free) * count + sheet.surface[free] + 1)
        return float(len(np.unique(np.concatenate(found)))) * self.cell**2

    def storey(self, place: Place, radius: float | None = None) -> int:
        """The first sheet on which a path for a person of `radius` (m) can end at a place; UserError where none can."""
        radius = self.radius if radius is None else radius
        end = self._end("goal", place, radius)
        return next(k for k, sheet in enumerate(self.sheets) if self._holds(sheet, end, radius, climb=True))

    def sample(self, n: int, rng: np.random.Generator, radius: float | None = None, storey: int = 0) -> np.ndarray:
        """`n` places ``[n, 2]`` (x, z in m), uniform over where a person of `radius` (m) can stand on one sheet.

        Raises:
            UserError: there is no such place.
        """
        radius, sheet = self.radius if radius is None else radius, self.sheets[storey]
        cells = np.argwhere(sheet.level >= radius - self.cell)  # a neighbour of a free place may hold one as well
        found = np.zeros((0, 2))
        for _ in range(1000):
            if len(found) >= n or len(cells) == 0:
                break
            tries = rng.uniform(-0.5, 0.5, size=(2 * n + 16, 2)) + cells[rng.integers(len(cells), size=2 * n + 16)]
            points = tries * self.cell + self.origin
            found = np.concatenate([found, points[sheet.clear(points) >= radius]])
        if len(found) < n:
            raise UserError(
                f"nowhere on the floor is a person of radius {radius:g} m and height {self.height:g} m clear of "
                f"obstacles (the widest place has {sheet.level.max():.2f} m); use a smaller radius"
            )
        return found[:n]

    def path(self, start: Place, goal: Place, radius: float | None = None) -> np.ndarray:
        """The way from `start` to `goal` (x, z in metres, or x, y, z) for a person of `radius` (m).

        The cheapest path on the map (scikit-image's fast-marching-like minimum cost path) for a cost that rises
        within `COMFORT` of what the radius allows, pulled straight where that costs no more, rounded at its corners.
        Only where no level way joins them, over slopes up to 20° and steps up to `STEP`, does it climb steps up to
        `CLIMB`; `climbs` tells which.

        Returns:
            ``[P, 3]`` metres, world, on the ground, first and last point as given, neighbours at most 5 cm apart as
            seen from above; every point keeps `radius` from obstacles by the map.

        Raises:
            UserError: start or goal is not free (by how much), or no path joins them (the largest radius that can).
        """
        radius = self.radius if radius is None else radius
        ends = self._end("start", start, radius), self._end("goal", goal, radius)
        (a, _), (b, _) = ends
        for climb in (False, True):
            for sheet in self._shared(*ends, radius, climb):
                walker = Walker(sheet, radius, climb)
                places = walker.cheapest(a, b)
                if places is not None:
                    return walker.smoothed(np.concatenate([a[None], places, b[None]]))
            walkers = [Walker(sheet, radius, climb) for sheet in self.sheets]
            if len(walkers) > 1 and (line := across(walkers, *ends)) is not None:
                return line
        raise UserError(self._no_way(*ends, radius))

    def climbs(self, path: np.ndarray) -> np.ndarray:
        """Rises (m, negative for drops) of the steps that a path ``[P, 3]`` climbs, in order."""
        return climbs(path, STEP)

    def _end(self, name: str, place: Place, radius: float) -> tuple[np.ndarray, float]:
        """An end of a path: x and z, and the height of the ground there. Raises UserError where it is not free."""
        end = np.asarray(place, dtype=np.float64)
        if end.shape not in ((2,), (3,)) or not np.isfinite(end).all():
            raise UserError(f"path {name} is {end.tolist()}; give x and z, or x, y and z, in metres")
        xz = end[[0, -1]]
        heights = np.array([float(sheet.ground(xz[None])[0]) for sheet in self.sheets])
        sheets, at = list(enumerate(self.sheets)), f"({end[0]:.2f}, {end[-1]:.2f})"
        if len(end) == 3 and np.isfinite(heights).any():
            off = np.nan_to_num(np.abs(heights - end[1]), nan=np.inf)
            if off.min() > OFF:
                known = " and ".join(f"{height:.2f}" for height in heights if np.isfinite(height))
                raise UserError(
                    f"path {name} {at} has no ground at a height of {end[1]:.2f} m; it is at {known} m there"
                )
            sheets = [sheets[k] for k in np.flatnonzero(off <= off.min() + STEP)]
        clear = []
        for k, sheet in sheets:
            clear.append(float(sheet.clear(xz)))
            if clear[-1] < radius:
                clear[-1] = max(clear[-1], float(sheet.clear(xz, climb=True)))
            if clear[-1] >= radius:
                return xz, float(heights[k]) if np.isfinite(heights[k]) else self.floor
        nearest = self._nearest_free(sheets[0][1], xz, radius)
        hint = "no place on this floor is" if nearest is None else f"({nearest[0]:.2f}, {nearest[1]:.2f}) is nearest"
        raise UserError(
            f"path {name} {at} is not free: an obstacle or the floor's edge is {max(*clear, 0.0):.2f} m away and "
            f"the radius is {radius:g} m; {hint}{' free' if nearest is not None else ''}"
        )

    def _nearest_free(self, sheet: Sheet, xz: np.ndarray, radius: float) -> np.ndarray | None:
        free = np.argwhere(sheet.level >= radius) * sheet.cell + sheet.origin
        return free[np.argmin(((free - xz) ** 2).sum(axis=1))] if len(free) else None

    def _shared(
        self, start: tuple[np.ndarray, float], goal: tuple[np.ndarray, float], radius: float, climb: bool
    ) -> list[Sheet]:
        """The sheets on which both ends lie and are clear by `radius` (m)."""
        return [s for s in self.sheets if all(self._holds(s, end, radius, climb) for end in (start, goal))]

    @staticmethod
    def _holds(sheet: Sheet, end: tuple[np.ndarray, float], radius: float, climb: bool) -> bool:
        """Whether an end, place and height, lies on a sheet and is clear there by `radius` (m)."""
        xz, y = end
        off = abs(np.nan_to_num(sheet.ground(xz[None])[0], nan=y) - y)
        return bool(off <= STEP and sheet.clear(xz, climb) >= radius)

    def _no_way(self, start: tuple[np.ndarray, float], goal: tuple[np.ndarray, float], radius: float) -> str:
        widest, apart = self._widest(start, goal), abs(start[1] - goal[1]) > STEP
        a, b = (f"({xz[0]:.2f}, {f'{y:.2f}, ' if apart else ''}{xz[1]:.2f})" for xz, y in (start, goal))
        ends, hint = f"from {a} to {b}", f"a radius of {widest:.2f} m would pass"
        if widest == 0:
            hint = "they are on separate parts of the floor"
            hint += f", which no slope up to 20° and no steps up to {CLIMB:g} m join" if apart else ""
        return f"no way {ends} is {radius:g} m clear of obstacles on both sides and {self.height:g} m high; {hint}"

    def widest(self, start: Place, goal: Place) -> float:
        """The largest radius (m, to 5 mm) that gets from start to goal (x, z in metres, or x, y, z); 0 if none does."""
        return self._widest(self._end("start", start, 0.0), self._end("goal", goal, 0.0))

    def _widest(self, start: tuple[np.ndarray, float], goal: tuple[np.ndarray, float]) -> float:
        low, high = 0.0, OPEN
        while high - low > 0.005:
            middle = (low + high) / 2
            low, high = (middle, high) if self._joined(start, goal, middle) else (low, middle)
        return float(np.floor(low * 200) / 200)

    def _joined(self, start: tuple[np.ndarray, float], goal: tuple[np.ndarray, float], radius: float) -> bool:
        """Whether a person of `radius` (m) gets from start to goal, climbing where need be."""
        from scipy.ndimage import label

        for sheet in self._shared(start, goal, radius, climb=True):
            parts, _ = label(sheet.climbing >= radius, structure=np.ones((3, 3)))
            walker = Walker(sheet, radius, climb=True)
            if parts[walker.free_cell(start[0])] == parts[walker.free_cell(goal[0])] != 0:
                return True
        walkers = [Walker(sheet, radius, climb=True) for sheet in self.sheets]
        return len(walkers) > 1 and across(walkers, start, goal) is not None

    @cached_property
    def bounds(self) -> np.ndarray:
        """Lowest and highest x, z (m) of the map's cells, ``[2, 2]``."""
        low = np.array(self.origin) - self.cell / 2
        return np.stack([low, low + np.array(self.clearance.shape) * self.cell])


def coarse(scene: Scene) -> str:
    """A sentence where the map of a scene is coarser than others, "" elsewhere."""
    if (cell := fitting(scene.bounds)) <= CELL:
        return ""
    x, _, z = np.ptp(scene.bounds, axis=0)
    return (
        f"the scene is {x:.0f} x {z:.0f} m, so that ways are planned on a map with cells of {100 * cell:.0f} cm, which "
        "narrow passages may be missing from"
    )


def free_area(scene: Scene, radius: float = RADIUS, height: float = HEIGHT, cell: float | None = None) -> FreeArea:
    """Map the ground of a scene for a person of `radius` and `height` (m) in square cells of side `cell` (m).

    By default cells are 5 cm wide, and as wide as a million of them take in larger scenes (see `coarse`).

    An obstacle is whatever comes between `STEP` above the ground and `height` above it; cells without ground, outside
    the room, or inside something count as obstacles too. Moving shapes are taken where they are at 0 s.

    Raises:
        UserError: sizes that make no sense, or a map of more than 16 million cells, or of default ones over
            `COARSEST`.
    """
    own = fitting(scene.bounds)
    if cell is None and own > COARSEST:
        x, _, z = np.ptp(scene.bounds, axis=0)
        raise UserError(
            f"the scene is {x:.0f} x {z:.0f} m, too large for ways to be planned in it; give one of 200 x 200 m at most"
        )
    cell = own if cell is None else cell
    for name, value, least in (("radius", radius, 0.0), ("height", height, STEP), ("cell", cell, 0.0)):
        if not (np.isfinite(value) and value > least):
            raise UserError(f"free area: {name} is {value} m; give more than {least:g} m")
    _, counts = lattice(scene.bounds, cell)
    if int(np.prod(counts)) > _CELLS:
        raise UserError(f"free area: {counts[0]} x {counts[1]} cells are too many; use a cell larger than {cell:g} m")
    floor = scene.floor.height
    levels = scene.levels if own == cell else scene.levels_in(float(cell))
    sheets = Mapper(levels, scene.distance, floor, float(radius), float(height)).sheets()
    return FreeArea(sheets, floor, float(radius), float(height))
