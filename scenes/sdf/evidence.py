"""What speaks for a room where windings alone do not say: which way sheets face, and where a person could stand."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from scenes.mesh.surface import Surface

STANDING = 1.8
"""Metres of air that a person needs to stand upright, as `scenes.world.floor.planning.free_area` takes it."""

ROOM = 6.5
"""Square metres of standing room from which on what is enclosed may be a room: the least that the International
Residential Code (R304.1) allows habitable ones."""

CROUCHING, CLOSET = 1.0, 1.5
"""Metres of height, and square metres, into which no person fits who is to move: what is smaller is furniture."""

_SHOULDER = 0.5  # metres across
_MOST = 48  # columns along the longer side where it is looked at closely
_COLUMNS = 12  # along the longer side
_STEP = 0.2  # metres between the heights that are asked for
_SEAT, _SILL = 0.2, 1.3  # heights of furniture above the floor, metres
_FURNISHED = 0.1  # share of the columns that end on furniture; 0.16 and 0.19 in the two scans that we have
_HALL = 0.25  # share of the middle height that must be enclosed for it to be worth a look
_LEVEL = 0.4  # share of what is enclosed that lies over one level floor; 0.60 and 0.68 in the two scans
_REST = 0.25  # share of what can be stood on inside up to which what lies outside does not count


@dataclass(frozen=True)
class Room:
    """How much of what a surface encloses could be a room.

    Attributes:
        standing: m² on which a person could stand inside.
        outside: m² between the parts of the mesh on which one could stand outside.
        furnished: share of the columns that end between seat and sill above the floor, beside lower ones.
    """

    standing: float = 0.0
    outside: float = 0.0
    furnished: float = 0.0

    @property
    def likely(self) -> bool:
        """There is room inside, and hardly any outside."""
        return self.standing >= ROOM and self.outside < _REST * self.standing

    @property
    def certain(self) -> bool:
        """Furniture stands in it, besides."""
        return self.likely and self.furnished >= _FURNISHED


def room_inside(surface: Surface) -> Room:
    """Look along vertical lines for what is enclosed as a solid is: winding number over 1/2."""
    low, high = surface.bounds
    size = high - low
    if size[1] < STANDING or size[0] * size[2] < ROOM:
        return Room()
    cell = float(max(size[0], size[2])) / _COLUMNS
    x, z = (np.arange(low[k] + cell / 2, high[k], cell) for k in (0, 2))
    y = np.arange(low[1] + _STEP / 2, high[1], _STEP)
    if _within(surface, x, y[len(y) // 2 :][:1], z).mean() < _HALL:
        return Room()
    within = _within(surface, x, y, z)
    tall, bottom = _longest(within)
    stands = tall * _STEP >= STANDING - _STEP / 2
    if not stands.any():
        return Room()
    floor = np.bincount(bottom[stands]).argmax()
    above = (bottom - floor) * _STEP
    stands &= np.abs(bottom - floor) <= 1
    if stands.sum() < _LEVEL * within.any(axis=1).sum():
        return Room()
    furnished = (above > _SEAT) & (above < _SILL) & (tall * _STEP >= STANDING - _SILL)
    furnished &= _drops(np.where(tall > 0, bottom, -1).reshape(len(x), len(z))).reshape(-1)
    beside, under = _longest(~within & (np.cumsum(within, axis=1) > 0))
    outside = (beside * _STEP >= STANDING - _STEP / 2) & (under > 0)
    return Room(float(stands.sum()) * cell**2, float(outside.sum()) * cell**2, float(furnished.mean()))


def fits(surface: Surface) -> bool:
    """Whether a person fits into what a surface encloses as a room: winding number below -1/2 over some height."""
    low, high = surface.bounds
    size = high - low
    if size[1] < CROUCHING or size[0] * size[2] < CLOSET:
        return False
    coarse, fine = float(max(size[0], size[2])) / _COLUMNS, max(float(max(size[0], size[2])) / _MOST, _SHOULDER / 2)
    y = np.arange(low[1] + _STEP / 2, high[1], _STEP)
    x, z = (np.arange(low[k] + coarse / 2, high[k], coarse) for k in (0, 2))
    if _within(surface, x, y[len(y) // 2 :][:1], z, -1).mean() >= 2 * _HALL:
        return True  # as in nearly every room, so that the rest need not be asked
    x, z = (np.arange(low[k] + fine / 2, high[k], fine) for k in (0, 2))
    tall = _longest(_within(surface, x, y, z, -1))[0].reshape(len(x), len(z)) * _STEP >= CROUCHING - _STEP / 2
    wide = [tall[i : len(x) - 2 + i, j : len(z) - 2 + j] for i in range(3) for j in range(3)]  # nobody fits into a wall
    return bool(np.logical_and.reduce(wide).sum() * fine**2 >= CLOSET / 4)


def _within(surface: Surface, x: np.ndarray, y: np.ndarray, z: np.ndarray, facing: int = 1) -> np.ndarray:
    """Which points of a lattice are enclosed as by a solid, or by a room (-1), columns in rows: ``[X Z, Y]``."""
    across, along, up = np.meshgrid(x, z, y, indexing="ij")
    points = np.stack([across, up, along], axis=-1).reshape(-1, 3)
    return np.asarray(facing * surface.dipoles.at(points - surface.centre).reshape(-1, len(y)) > 0.5)


def _drops(bottom: np.ndarray) -> np.ndarray:
    """Columns beside one that ends two steps and more below, as furniture does and a slope does not, ``[X, Z]``."""
    padded = np.pad(bottom, 1, constant_values=-1)
    beside = (padded[:-2, 1:-1], padded[2:, 1:-1], padded[1:-1, :-2], padded[1:-1, 2:])
    return np.asarray(np.logical_or.reduce([(other >= 0) & (bottom - other >= 2) for other in beside]))


def _longest(rows: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Length of the longest run of True in each row, and where it begins."""
    run, best, first = (np.zeros(len(rows), dtype=int) for _ in range(3))
    for step in range(rows.shape[1]):
        run = np.where(rows[:, step], run + 1, 0)
        longer = run > best
        first[longer] = step + 1 - run[longer]
        best = np.maximum(best, run)
    return best, first


def in_front(surface: Surface, samples: int = 512) -> float:
    """Median winding number just in front of points spread evenly over the surface."""
    rng = np.random.default_rng(0)
    chosen = surface.by_area(samples, rng)
    step = 1e-4 * float(np.ptp(surface.bounds, axis=0).max()) * surface.normals(chosen)
    return float(np.median(surface.dipoles.at(surface.points_on(chosen, rng) + step)))
