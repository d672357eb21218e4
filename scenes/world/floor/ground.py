"""How high the floors lie: large levels that one can stand on."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from scenes.errors import UserError
from scenes.world.floor.levels import ROOM, Levels

NEAR = 0.05
"""What lies within this (m) of a floor's height is evidence for it."""

LARGE = 1 / 3
"""Share of the largest level's area from which a level is a floor: no table, no shelf."""

_BIN = 0.02  # of the histogram over heights, metres


@dataclass(frozen=True)
class Floor:
    """Where soles stand.

    Attributes:
        height: y of the floor, metres.
        found: True where it was found in the meshes, False where the user stated it.
        area: m² within 5 cm of it over which a person can stand, the evidence; 0 where it was stated.
    """

    height: float
    found: bool
    area: float = 0.0


def find_floors(levels: Levels, name: str) -> tuple[Floor, ...]:
    """The large levels of a scene from low to high; the lowest is its floor.

    A histogram over height of the places that have standing room in free space above them; of its peaks those count
    that have at least a third of the largest one's area, so that no table is taken for a floor, and the lowest is the
    floor, so that no roof is; each refined to the median around it.

    Args:
        levels: of the scene.
        name: of the scene, for the error.

    Raises:
        UserError: nowhere is there room to stand.
    """
    heights = levels.walkable[levels.headroom >= ROOM]
    heights = np.sort(heights[~np.isnan(heights)])
    if not len(heights):
        raise UserError(f"found no floor in '{name}' because {_why(levels)}; state its height with floor = …")
    bins = np.floor((heights - heights[0]) / _BIN).astype(int)
    histogram = np.bincount(bins)
    level = np.convolve(np.pad(histogram, 2), np.ones(5), mode="valid")  # places within 5 cm of each bin
    found, at = [], 0
    while (large := at + np.flatnonzero(level[at:] >= level.max() * LARGE)).size:
        first = int(large[0])
        peak = first + int(np.argmax(level[first : first + 6]))  # the slope of a noisy floor starts lower
        near = heights[np.abs(heights - (heights[0] + (peak + 0.5) * _BIN)) <= NEAR]
        middle = float(near[(len(near) - 1) // 2])
        found.append(Floor(height=middle, found=True, area=len(near) * levels.cell**2))
        at = peak + 6
    return tuple(found)


def _why(levels: Levels) -> str:
    """What is wrong with the best place to stand."""
    room = np.where(np.isnan(levels.walkable), 0.0, levels.headroom)
    if not (room > 0).any():
        return "nothing level has free space above it"
    best = np.unravel_index(int(np.nanargmax(room)), room.shape)
    return (
        f"the best place, at a height of {levels.heights[best]:.2f} m, has {room[best]:.2f} m of free space above it, "
        f"and standing takes {ROOM:g} m"
    )
