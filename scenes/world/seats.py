"""Where in a scene a person can sit: how high a seat is, which way it faces, and where one stands before it."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch

from scenes.errors import UserError
from scenes.motion.frames import Place
from scenes.world.floor.planning import FreeArea
from scenes.world.scene import Scene

LOWEST, HIGHEST = 0.25, 0.8
"""Heights (m) over the ground of what is sat on, from a step to a bar stool's rung."""
INSET = 0.18
"""Metres from a seat's front edge back to the hips of somebody who sits on it: half of a thigh is on the seat."""
BEFORE = 0.22
"""Metres from the front edge to where somebody stands who is about to sit down: ankles are then under the knees once
the hips are `INSET` behind the edge, with a thigh of 0.4 m."""
NARROW = 0.15
"""Metres that are clear around somebody who stands so close to a seat."""
BACK = (0.12, 0.62)
"""Metres behind the hips in which a backrest is looked for, `OVER` (m) over the seat."""
OVER = 0.3
SAME, OFF = 0.04, 0.1
"""Metres within which heights are one level, and by which a stated point may be off the surface."""
ARM = 0.12
"""Metres that the trunk keeps to both sides, over the seat, on its way there."""


@dataclass(frozen=True)
class Seat:
    """A place to sit, m.

    Attributes:
        hips: on the seat, under the middle of the hips.
        heading: rad about +y that somebody faces who sits there.
        stand: on the ground, where one stands before sitting down, with the back to it.
        backed: there is a backrest.
        askew: how much further one side of the front edge is ahead than the other, m.
    """

    hips: Place
    heading: float
    stand: Place
    backed: bool
    askew: float = 0.0

    @property
    def height(self) -> float:
        """Of the seat over the ground before it, m."""
        return self.hips[1] - self.stand[1]


def find_seat(
    scene: Scene, area: FreeArea, on: str | Sequence[float], near: Place, heading: float | None = None
) -> Seat:
    """Where to sit on a named part of a scene, or on the surface at a point.

    The surface is read off the scene's levels (`scenes.world.floor.levels`): of a part the largest level that is as
    high as seats are, of a point what hangs together with it. Of 16 directions those count in which there is room for
    legs and trunk and a place to stand; a backrest behind decides, then how square the front edge is, then how near the
    place is.

    Args:
        scene: which.
        area: where people can stand.
        on: name of a part, or x, y, z (m) of a point on the surface.
        near: where somebody comes from, m.
        heading: which way to sit (rad), instead of finding one.

    Raises:
        UserError: an unknown name, nothing as high as a seat there, or no direction with room.
    """
    levels = scene.levels
    mask, top = _surface(scene, on)
    what = f"'{on}'" if isinstance(on, str) else f"the surface at {[round(float(v), 2) for v in on]}"
    cells = np.argwhere(mask) * levels.cell + levels.origin
    middle = cells.mean(axis=0) if isinstance(on, str) else np.array([on[0], on[2]], dtype=np.float64)
    tried = [heading] if heading is not None else list(np.arange(16) * math.pi / 8)
    found = [seat for way in tried if (seat := _facing(scene, area, cells, middle, top, way)) is not None]
    if not found:
        raise UserError(
            f"nobody can sit on {what}: no side of it has room for legs and a free place to stand before it"
        )
    return min(found, key=lambda seat: (not seat.backed, round(seat.askew, 1), math.dist(seat.stand, near)))


def _surface(scene: Scene, on: str | Sequence[float]) -> tuple[np.ndarray, float]:
    """Cells ``[X, Z]`` of the surface that is meant, and its height (m)."""
    heights, floor = scene.levels.heights, scene.floor.height
    high = (heights > floor + LOWEST) & (heights < floor + HIGHEST)
    return _of_part(scene, on, high) if isinstance(on, str) else _at_point(scene, on, high)


def _of_part(scene: Scene, name: str, high: np.ndarray) -> tuple[np.ndarray, float]:
    """The largest level of a named part, of surfaces ``[X, Z, K]`` that are as high as seats."""
    levels, floor = scene.levels, scene.floor.height
    heights, (low, top) = levels.heights, scene.part(name).bounds
    x, z = (levels.origin[k] + levels.cell * np.arange(heights.shape[k]) for k in (0, 1))
    inside = ((x >= low[0]) & (x <= top[0]))[:, None] & ((z >= low[2]) & (z <= top[2]))
    mine = high & inside[..., None] & (heights <= top[1] + SAME)
    if not mine.any():
        raise UserError(
            f"'{name}' has no surface between {floor + LOWEST:.2f} and {floor + HIGHEST:.2f} m to sit on; name another "
            "part or a point"
        )
    bins = np.floor((heights[mine] - heights[mine].min()) / SAME).astype(int)
    level = float(heights[mine].min()) + SAME * (int(np.bincount(bins).argmax()) + 0.5)
    close = mine & (np.abs(heights - level) <= SAME)
    mask = _largest(close.any(axis=2))
    return mask, float(np.median(heights[close & mask[..., None]]))


def _at_point(scene: Scene, on: Sequence[float], high: np.ndarray) -> tuple[np.ndarray, float]:
    """What hangs together with the surface at a point (m), of those that are as high as seats."""
    levels, heights = scene.levels, scene.levels.heights
    at = tuple(round((on[axis] - levels.origin[k]) / levels.cell) for k, axis in enumerate((0, 2)))
    if not all(0 <= index < size for index, size in zip(at, heights.shape, strict=False)):
        raise UserError(f"the point {[round(float(v), 2) for v in on]} lies outside the scene")
    close = high[at] & (np.abs(heights[at] - on[1]) < OFF)
    if not close.any():
        known = ", ".join(f"{height:.2f}" for height in heights[at] if np.isfinite(height))
        raise UserError(
            f"there is nothing to sit on at {[round(float(v), 2) for v in on]}"
            f"{f'; surfaces there are {known} m high' if known else ''}"
        )
    level = float(heights[at][close][0])
    return _joined(np.asarray((np.abs(heights - level) <= SAME).any(axis=2)), at), level


def _largest(mask: np.ndarray) -> np.ndarray:
    """The largest of the pieces that hang together."""
    from scipy.ndimage import label

    parts, count = label(mask)
    return mask if count < 2 else parts == 1 + int(np.bincount(parts[parts > 0] - 1).argmax())


def _joined(mask: np.ndarray, at: tuple[int, ...]) -> np.ndarray:
    """The piece that hangs together with a cell."""
    from scipy.ndimage import label

    parts, _ = label(mask)
    piece: np.ndarray = parts == parts[at]
    return piece


def _facing(scene: Scene, area: FreeArea, cells: np.ndarray, middle: np.ndarray, top: float, way: float) -> Seat | None:
    """The seat of somebody who faces a way; None where there is no room."""
    ahead, aside = np.array([math.sin(way), math.cos(way)]), np.array([math.cos(way), -math.sin(way)])
    off = cells - middle
    row = off[np.abs(off @ aside) < 0.15]
    if not len(row):
        return None
    depth, edge = np.ptp(row @ ahead) + scene.levels.cell, float((row @ ahead).max()) + scene.levels.cell / 2
    fronts = [off[np.abs(off @ aside - at) < 0.06] @ ahead for at in (-0.15, 0.0, 0.15)]
    askew = float(np.ptp([front.max() for front in fronts if len(front)]))
    hips = middle + (edge - min(INSET, depth / 2)) * ahead
    stand = middle + (edge + BEFORE) * ahead
    if not area.contains(stand, NARROW):
        return None
    ground = float(scene.ground_at(stand[0], stand[1]))
    # Knees and trunk on their way: nothing but the seat itself between standing and sitting.
    along = np.linspace(0, 1, 8)[:, None] * (stand - hips) + hips
    tall = np.array([top + 0.15, top + 0.35, top + 0.6])
    if _room(scene, along, tall) < ARM:
        return None
    behind = hips - np.linspace(*BACK, 11)[:, None] * ahead
    backed = _room(scene, behind, np.array([top + OVER])) < 0.02
    if not math.isfinite(ground) or not LOWEST <= top - ground <= HIGHEST:
        return None
    return Seat(
        (float(hips[0]), top, float(hips[1])), float(way), (float(stand[0]), ground, float(stand[1])), backed, askew
    )


def _room(scene: Scene, places: np.ndarray, heights: np.ndarray) -> float:
    """The least distance (m) to anything, over places ``[n, 2]`` at heights (m)."""
    points = np.array([[x, y, z] for x, z in places for y in heights])
    with torch.no_grad():
        return float(scene.distance(torch.from_numpy(points).float()).min())
