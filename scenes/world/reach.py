"""Which free space a place is connected to, and how far the way back is from what lies beyond.

A distance knows the nearest surface only: behind a wall it is free again, and in a wall it points to whichever side is
nearer. Here free space is divided into parts that a person cannot pass between: a door is a way, a wall is none, and
neither are a crack, a flight over walls that have no ceiling, nor air without ground. What lies beyond the part that
a place is in is as deep as the way back is long.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from scenes.motion.frames import Place, fine_enough
from scenes.sdf.grid import SdfGrid
from scenes.sdf.lattice import Lattice, padded
from scenes.world.floor.levels import STEP, Levels
from scenes.world.floor.mapping import FLOOR_BELOW, HEIGHT, closed
from scenes.world.floor.sheet import reach_of

WAY = 0.1
"""Half the width (m) of what is a way: half a chest is 0.13 m deep, and scans blur doors. A crack or a slot is none."""

ROOM = 0.2, 0.6
"""A part of free space counts where a ball of this radius (m) can rise by this much (m): in wardrobes and up, not in
what is free under a bed, which falls to what it is open to."""

OVER = 1.2
"""Height (m) over the ground up to which an obstacle is no wall: it is stepped, climbed or leant over. Guards, built so
that nobody falls over them, are 1.07 m high (International Building Code 1015.3), tables 0.75 m, doors 2 m."""

EDGE = 1.5
"""Metres from all ground beyond which air is nowhere that anybody gets to; a hand over an edge is half as far off."""

CROUCH, HEAD = 0.3, 1.5
"""Heights (m) over the ground between which somebody who stands somewhere certainly is."""

FINE, COARSE = 0.1, 0.2
"""Least and greatest distance (m) between nodes: no more than a way is wide, so that no sheet slips between two."""

MANY, MOST = 1_500_000, 4_000_000
"""Nodes from which on they are farther apart, and beyond which space is not divided: a storey of 100 x 100 m."""

_SEARCH = 3  # nodes within which the way back is looked for in all directions: walls of up to 0.3 m

Distance = Callable[[Tensor], Tensor]


@dataclass(frozen=True, eq=False)
class Reach:
    """A distance field that is felt outside of the free space that some place is connected to, and infinite within.

    In a wall it is felt from the middle on, where the near side and the far one are equally far.

    Attributes:
        side: how much nearer (m) the near side is than the far one: negative from the middle of walls on.
        back: the way back (m) to that free space, negated.
    """

    side: SdfGrid
    back: SdfGrid

    def distance(self, points: Float[Tensor, "*b 3"], time: Tensor | None = None) -> Float[Tensor, "*b"]:
        """The way back (m), negated, at points (m, world) beyond; infinite at others. `time` is ignored."""
        with torch.no_grad():
            beyond = self.side.distance(points.detach()) < 0
        value = torch.full_like(points[..., 0], math.inf, requires_grad=False)
        return value.masked_scatter(beyond, self.back.distance(points[beyond])) if beyond.any() else value

    def depth(self, points: np.ndarray) -> np.ndarray:
        """The way back (m) from points ``[n, 3]`` (m, world) beyond; 0 at others."""
        with torch.no_grad():
            away = self.distance(torch.from_numpy(np.ascontiguousarray(points, dtype=np.float64)))
        return np.asarray((-away).clamp_min(0.0))

    def value_and_gradient(self, points: Float[Tensor, "*b 3"]) -> tuple[Float[Tensor, "*b"], Float[Tensor, "*b 3"]]:
        """What `distance` gives, and its gradient (no unit), 0 where that is infinite."""
        with torch.no_grad():
            value, (_, slope) = self.distance(points), self.back.value_and_gradient(points)
        return value, slope.where(value.isfinite()[..., None], 0.0)

    def lowest_on_way(
        self, ends: Float[Tensor, "n 4 3"], enough: Float[Tensor, " n"], tolerance: float | int
    ) -> Float[Tensor, "n 2"]:
        """Where the way back is longest for segments on their way, as `SdfGrid.lowest_on_way` takes and gives it."""
        return self.back.lowest_on_way(ends, enough, tolerance)

    @property
    def lipschitz(self) -> float:
        """The most by which the way back changes over a metre, m/m."""
        return self.back.lipschitz


@dataclass(frozen=True, eq=False)
class Parts:
    """The free space of what does not move, divided into what a person can get to from one another.

    Attributes:
        lattice: nodes.
        distance: to all surfaces, m, ``[X, Y, Z]`` float32.
        part: which part each free node is in, from 1, ``[X, Y, Z]``; 0 in solids and where nobody could be.
        abyss: the part that is air without ground; 0 for none.
    """

    lattice: Lattice
    distance: np.ndarray
    part: np.ndarray
    abyss: int
    _known: dict[int, Reach] = field(default_factory=dict, init=False, repr=False)

    @classmethod
    def of(cls, distance: Distance, bounds: np.ndarray, levels: Levels, grounds: Sequence[np.ndarray]) -> Parts | None:
        """Divide the space around a scene; None where there is one part alone, or too much to look at.

        Ways are where a ball of radius `WAY` fits that is no higher than `OVER` above ground. What is free besides,
        such as shelves, air under ceilings and the last inches before walls, falls to the part to which it is most
        widely open.

        Args:
            distance: of all that does not move, m: ``[n, 3] -> [n]``.
            bounds: of that, ``[2, 3]``, m.
            levels: all that can be stood on.
            grounds: height (m) of what can be walked on in the cells of `levels`, ``[X, Z]``, sheet by sheet.
        """
        lattice = _lattice(bounds, grounds)
        if lattice is None:
            return None
        x, y, z = (o + lattice.spacing * np.arange(n) for o, n in zip(lattice.origin, lattice.shape, strict=True))
        away = np.empty(lattice.shape, dtype=np.float32)
        for i, plane in enumerate(x):  # plane by plane, for memory's sake
            points = np.stack(np.broadcast_arrays(plane, y[:, None], z[None, :]), axis=-1)
            with torch.no_grad():
                away[i] = distance(torch.from_numpy(fine_enough(points)))
        *cell, known = _cells(levels, x, z)
        heights = [np.where(known, ground[tuple(cell)], levels.beyond) for ground in grounds]
        sheets = [_ground(height, away, y, lattice.spacing) for height in heights]
        way = max(WAY, 0.55 * lattice.spacing)
        part, count = _rooms(away, sheets, y, way)
        anything = np.where(known, ~np.isnan(levels.heights).all(axis=2)[tuple(cell)], not np.isnan(levels.beyond))
        abyss = _far(~anything & (away > reach_of(lattice.spacing)).all(axis=1), EDGE / lattice.spacing)
        part[np.broadcast_to(abyss[:, None, :], part.shape) & (away >= way)] = count + 1
        if count + bool(abyss.any()) < 2:
            return None
        from skimage.segmentation import watershed

        part = watershed(-np.minimum(away, way), part, mask=away > 0)
        return cls(lattice, away, part, count + 1 if abyss.any() else 0)

    def at(self, place: Place) -> int:
        """The part that somebody is in who stands on a place (m, world), or that is nearest to them."""
        index = np.argwhere(self.part > 0)
        off = self.lattice.nodes(index) - np.asarray(place)
        off[:, 1] -= off[:, 1].clip(CROUCH, HEAD)
        return int(self.part[tuple(index[np.square(off).sum(axis=1).argmin()])])

    def around(self, place: Place) -> Reach | None:
        """What lies beyond the part that a place (m, world; on the ground) is in; None where nothing can be said."""
        part = self.at(place)
        if part == self.abyss:
            return None
        if part not in self._known:
            self._known[part] = self._reach(part)
        return self._known[part]

    def _reach(self, part: int) -> Reach:
        near, far = self.part == part, (self.part != part) & (self.part > 0)
        nearest_near, nearest_far = _nearest(near), _nearest(far)
        spacing, away = self.lattice.spacing, self.distance
        free = np.where(near, _own(away, nearest_far, spacing), np.where(far, _own(away, nearest_near, spacing), 0.0))
        back = _way(near, nearest_near, free, spacing)
        side = _way(far, nearest_far, free, spacing) - back
        faces = np.concatenate([self.part[[0, -1]].ravel(), self.part[:, :, [0, -1]].ravel()])
        around = 1.0 if (faces == part).sum() > (faces > 0).sum() / 2 else -1.0
        origin = torch.tensor(self.lattice.origin, dtype=torch.float64)
        sides = SdfGrid(torch.from_numpy(side), origin, spacing, around)
        return Reach(sides, SdfGrid(torch.from_numpy(-back), origin, spacing, -1.0))


def _lattice(bounds: np.ndarray, grounds: Sequence[np.ndarray]) -> Lattice | None:
    """Nodes around a scene, as high as people get; None where that takes too many."""
    low, high = padded(bounds, EDGE + 2 * COARSE)
    heights = np.concatenate([ground[~np.isnan(ground)] for ground in grounds])
    if not len(heights):
        return None
    low[1], high[1] = heights.min() - HEAD / 4, heights.max() + HEAD + OVER
    volume = float(np.prod(high - low))
    spacing = min(max(FINE, (volume / MANY) ** (1 / 3)), COARSE)
    return None if volume > MOST * spacing**3 else Lattice.spaced(np.stack([low, high]), spacing)


def _cells(levels: Levels, x: np.ndarray, z: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Cells of a map at columns of nodes: rows ``[X, 1]``, columns ``[1, Z]``, and which are on the map ``[X, Z]``."""
    count = levels.heights.shape[:2]
    found = [np.rint((at - o) / levels.cell).astype(int) for at, o in zip((x, z), levels.origin, strict=True)]
    on = [(index >= 0) & (index < n) for index, n in zip(found, count, strict=True)]
    rows, columns = (index.clip(0, n - 1) for index, n in zip(found, count, strict=True))
    return rows[:, None], columns[None, :], on[0][:, None] & on[1][None, :]


def _ground(ground: np.ndarray, away: np.ndarray, y: np.ndarray, spacing: float) -> np.ndarray:
    """Height (m) of one sheet of ground in columns of nodes ``[X, Z]``, under obstacles too; NaN for none."""
    missing = np.isnan(ground)
    if missing.all():
        return ground
    near = ground[tuple(_nearest(~missing))]
    over = y[:, None] - near[:, None, :]
    blocked = ((away <= reach_of(spacing)) & (over > STEP) & (over < HEIGHT)).any(axis=1)
    return np.where(closed(~missing | blocked, FLOOR_BELOW / spacing), near, np.nan)


def _rooms(away: np.ndarray, sheets: Sequence[np.ndarray], y: np.ndarray, way: float) -> tuple[np.ndarray, int]:
    """Parts ``[X, Y, Z]`` of the air over the ground that hang together by ways, from 1, and their number."""
    from scipy.ndimage import label, maximum, minimum

    over = [y[:, None] - ground[:, None, :] for ground in sheets]
    band = np.logical_or.reduce([(height >= 0) & (height <= OVER + way) for height in over])
    part, count = label(band & (away >= way))
    numbers = np.arange(1, count + 1)
    wide = np.where(away >= ROOM[0], part, 0)
    heights = np.broadcast_to(y[:, None], part.shape)
    rise = maximum(heights, wide, numbers) - minimum(heights, wide, numbers) if count else np.zeros(0)
    kept = rise >= ROOM[1]
    number = np.append(0, np.where(kept, np.cumsum(kept), 0)).astype(np.int32)
    return number[part], int(kept.sum())


def _far(empty: np.ndarray, least: float) -> np.ndarray:
    """Columns ``[X, Z]`` that are so many columns and more from all that are not empty."""
    from scipy.ndimage import distance_transform_edt

    return empty if not empty.any() else np.asarray(distance_transform_edt(empty) >= least)


def _nearest(some: np.ndarray) -> np.ndarray:
    """Index of the nearest of some nodes at every node, ``[d, ...]``."""
    from scipy.ndimage import distance_transform_edt

    return np.asarray(distance_transform_edt(~some, return_distances=False, return_indices=True))


def _gap(nearest: np.ndarray) -> np.ndarray:
    """How many nodes away the nearest is, ``[X, Y, Z]`` float32."""
    apart = (nearest - np.indices(nearest.shape[1:], dtype=np.int32, sparse=False)).astype(np.float32)
    return np.asarray(np.sqrt(np.square(apart).sum(axis=0)))


def _own(away: np.ndarray, others: np.ndarray, spacing: float) -> np.ndarray:
    """Radius (m) of a ball around each node that lies in its own part: it reaches no ball of the `others`' nearest."""
    theirs = away[tuple(others)]
    return away * np.minimum(_gap(others) * spacing / np.maximum(away + theirs, 1e-6), 1.0)


def _way(some: np.ndarray, nearest: np.ndarray, free: np.ndarray, spacing: float) -> np.ndarray:
    """The way (m) from every node to the part that some nodes are in, negative within, ``[X, Y, Z]`` float32.

    Each of them has a ball of radius `free` in that part. The way is that to the nearest ball: of the node that is
    nearest, and close by of all within `_SEARCH` nodes, so that walls at any angle are as thick as they are.
    """
    gap = _gap(nearest)
    way = gap * spacing - free[tuple(nearest)]
    close = np.flatnonzero((gap > 0) & (gap <= _SEARCH))
    balls = np.pad(np.where(some, free, -np.inf), _SEARCH, constant_values=-np.inf).astype(np.float32)
    steps = np.array([1, *np.cumprod(balls.shape[:0:-1])])[::-1]
    begin = steps @ (np.stack(np.unravel_index(close, some.shape)) + _SEARCH)
    best, balls = way.ravel()[close], balls.ravel()
    for offset in np.argwhere(np.ones((2 * _SEARCH + 1,) * 3)) - _SEARCH:
        apart = float(np.sqrt(np.square(offset).sum()))
        if apart <= _SEARCH:
            np.minimum(best, np.float32(apart * spacing) - balls[begin + steps @ offset], out=best)
    way.ravel()[close] = best
    # From farther off it leads by one of those nodes.
    far = np.flatnonzero(gap > _SEARCH)
    here, there = np.stack(np.unravel_index(far, gap.shape)), nearest.reshape(3, -1)[:, far]
    length = gap.ravel()[far]
    by = np.rint(there + (here - there) * (_SEARCH - 0.5) / length).astype(np.int32)
    rest = np.sqrt(np.square(here - by, dtype=np.float32).sum(axis=0)) * np.float32(spacing)
    way.ravel()[far] = np.minimum(way.ravel()[far], way[tuple(by)] + rest)
    return way
