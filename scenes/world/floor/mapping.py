"""From what can be stood on to sheets of ground, and what is clear on each of them."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np
import torch

from scenes.kernels import ground as kernels
from scenes.motion.frames import fine_enough
from scenes.world.floor.ground import LARGE
from scenes.world.floor.levels import STEP, Levels
from scenes.world.floor.sheet import OPEN, Sheet, reach_of

CLIMB = 0.25
"""Highest step (m) that is climbed. Building codes allow risers up to 0.18 m (International Building Code 1011.5.2) and
0.22 m (Approved Document K, private stairs); kerbs and worn or rough ones come on top."""

FLOOR_BELOW = 0.15
"""Half the width (m) of the widest hole, between ground or between it and an obstacle, that one steps over."""


RADIUS, HEIGHT = 0.3, 1.8
"""Of a person, metres, where neither is stated."""


def surfaces(levels: Levels, floor: float, radius: float = RADIUS, height: float = HEIGHT) -> list[np.ndarray]:
    """What a person can walk on: which surface of each cell ``[X, Z]``, -1 for none, sheet by sheet.

    First the main floor with all that hangs together with it, then storeys that lie over or under others. A storey
    counts where steps of up to `CLIMB` lead there, or where it is as large as `LARGE` asks, but no table. Each sheet
    goes on over what others hold, as far as it is the first to get there, so that none ends where it is joined.

    Args:
        levels: of the scene.
        floor: height of the main floor, metres.
        radius, height: of the person, metres.
    """
    walkable = levels.walkable
    away = np.nan_to_num(np.abs(walkable - floor), nan=np.inf)
    main = np.where(away.min(axis=2) <= STEP, away.argmin(axis=2), -1)
    found = [kernels.grown(walkable, main, CLIMB)]
    covered = held(found[0], walkable.shape)
    rest = ~np.isnan(walkable) & (levels.headroom >= height) & ~covered
    for seeds in _patches(walkable, rest, np.pi * radius**2 / levels.cell**2):
        more = kernels.grown(walkable, seeds, CLIMB)
        holds = held(more, walkable.shape)
        if (holds & covered).any() or (seeds >= 0).sum() >= LARGE * (main >= 0).sum():
            found.append(more)
            covered |= holds
            rest &= ~holds
    return found


def held(surface: np.ndarray, shape: tuple[int, ...]) -> np.ndarray:
    """True for those of all surfaces ``[X, Z, K]`` that a sheet ``[X, Z]`` holds."""
    return np.asarray(surface[..., None] == np.arange(shape[2]))


def _patches(walkable: np.ndarray, rest: np.ndarray, least: float) -> Iterator[np.ndarray]:
    """Level patches of enough cells ``[X, Z]`` in what no sheet holds yet: in `rest`, which shrinks meanwhile."""
    from scipy.ndimage import label

    while rest.sum() >= least:
        heights = walkable[rest]
        bins = np.floor((heights - heights.min()) / STEP).astype(int)
        height = heights.min() + (np.bincount(bins).argmax() + 0.5) * STEP
        here = rest & (np.abs(walkable - height) <= STEP)
        rest &= ~here
        parts, _ = label(here.any(axis=2))
        for part in np.flatnonzero(np.bincount(parts.ravel())[1:] >= least) + 1:
            yield np.where(parts == part, here.argmax(axis=2), -1)


@dataclass(frozen=True, eq=False)
class Mapper:
    """Makes the sheets of one scene for one person.

    Attributes:
        levels: of the scene.
        distance: of the scene, m: ``[n, 3] -> [n]``.
        floor: height of the main floor, metres.
        radius, height: of the person, metres.
    """

    levels: Levels
    distance: Callable[[torch.Tensor], torch.Tensor]
    floor: float
    radius: float
    height: float

    def sheets(self) -> tuple[Sheet, ...]:
        """One for each of `surfaces`."""
        walkable = self.levels.walkable
        found = surfaces(self.levels, self.floor, self.radius, self.height)
        return tuple(self._sheet(walkable, surface) for surface in found)

    def _sheet(self, walkable: np.ndarray, surface: np.ndarray) -> Sheet:
        """What is clear on some surfaces, one a cell.

        An obstacle is whatever comes between `STEP` above the ground under it and the person's height above that; for
        who climbs, between `CLIMB` and there. Where the ground ends, and where it rises or drops by more, is an edge.
        """
        from scipy.ndimage import distance_transform_edt

        ground = np.take_along_axis(walkable, np.maximum(surface, 0)[..., None], axis=2)[..., 0]
        ground[surface < 0] = np.nan
        cell = self.levels.cell
        reach = reach_of(cell)
        missing = surface < 0
        if missing.all():
            near = np.full(ground.shape, self.floor)
        else:
            x, z = distance_transform_edt(missing, return_distances=False, return_indices=True)
            near = ground[x, z]
        # Ground that is the floor but for noise is asked about at the floor's height.
        base = np.where(np.abs(near - self.floor) <= STEP / 2, self.floor, near)
        low, high = self._columns(base, reach)
        maps, heights = [], near
        for column, limit in ((high, CLIMB), (np.minimum(low, high), STEP)):
            bridged = closed(~missing | (column <= reach), FLOOR_BELOW / cell)  # ground that goes on under obstacles
            heights = np.where(bridged, near, np.nan)
            column = np.where(~bridged & (column > 0), -np.minimum(np.abs(self._layer(base)), cell), column)
            column = np.where(_beside_steps(near, bridged, limit), np.minimum(column, cell / 2), column)
            maps.append(column)
        return Sheet(heights, surface, maps[1], maps[0], self.levels.origin, cell)

    def _columns(self, base: np.ndarray, reach: float) -> tuple[np.ndarray, np.ndarray]:
        """Smallest distance (m) in every cell's column over the ground, ``[X, Z]``: up to `CLIMB`, and above."""
        lowest, highest = STEP + reach, max(self.height - reach, STEP + reach)
        low, high = np.full(base.shape, OPEN), np.full(base.shape, OPEN)
        steps = np.linspace(lowest, highest, int(np.ceil((highest - lowest) / self.levels.cell - 1e-6)) + 1)
        for step in steps:
            part = high if step >= min(CLIMB + reach, highest) else low
            np.minimum(part, self._layer(base + step), out=part)
        return low, high

    def _layer(self, y: np.ndarray) -> np.ndarray:
        """Distance (m) of the scene over the cells' centres at heights ``[X, Z]``."""
        x, z = (self.levels.origin[k] + self.levels.cell * np.arange(y.shape[k]) for k in range(2))
        grid = np.stack(np.broadcast_arrays(x[:, None], y, z[None, :]), axis=-1)
        with torch.no_grad():
            distance = self.distance(torch.from_numpy(fine_enough(grid)))
        return np.asarray(distance.double())


def closed(ground: np.ndarray, radius: float) -> np.ndarray:
    """Ground ``[X, Z]`` with its holes and gaps that are no wider than twice `radius` (cells) filled."""
    from scipy.ndimage import binary_closing

    size = int(radius + 1e-6)
    if size == 0:
        return ground
    x, z = np.ogrid[-size : size + 1, -size : size + 1]
    filled = binary_closing(np.pad(ground, size), x * x + z * z <= radius * radius + 1e-6)
    return np.asarray(filled[size:-size, size:-size])


def _beside_steps(heights: np.ndarray, ground: np.ndarray, limit: float) -> np.ndarray:
    """True where ground rises or drops by more than `limit` (m) to one of the four neighbours, ``[X, Z]``."""
    beside = np.zeros(heights.shape, dtype=bool)
    for axis in range(2):
        a, b = (np.s_[:-1, :], np.s_[1:, :]) if axis == 0 else (np.s_[:, :-1], np.s_[:, 1:])
        step = (np.abs(heights[a] - heights[b]) > limit) & ground[a] & ground[b]
        beside[a] |= step
        beside[b] |= step
    return beside
