"""Frames: rigid ones as 4 x 4 matrices, and where one begins in which single precision is fine enough."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TypeAlias

import numpy as np
import torch

from scenes.motion.rotations import matrices

Place: TypeAlias = tuple[float, float, float]
"""x, y, z in metres."""

HOME: Place = (0.0, 0.0, 0.0)
"""Where the world's own frame begins."""

FAR = 1024.0
"""Metres from the origin from which on single precision is too coarse for motions: neighbours among its numbers, of 24
bits, lie 2^-13 m apart there, 0.12 mm (``numpy.spacing(numpy.float32(1024))``)."""


def origin_near(place: Sequence[float] | np.ndarray, step: float = 100.0) -> Place:
    """Where the frame begins in which what is near a place (m, world) is computed: 0 along axes on which it isn't far.

    Along the others it is the nearest multiple of `step` (m), so that what is moved by whole hundreds of metres is
    computed as it was before.
    """
    x, y, z = (step * round(float(c) / step) if abs(c) >= FAR else 0.0 for c in place)
    return x, y, z


def fine_enough(places: np.ndarray) -> np.ndarray:
    """Places (m) in single precision, but doubles as they are where any is as far from the origin as `FAR`."""
    coarse = places.dtype == np.float64 and bool((np.abs(places) >= FAR).any())
    return places if coarse else places.astype(np.float32)


def shifted(place: Sequence[float], by: Sequence[float]) -> Place:
    """A place (m) moved by so much (m)."""
    x, y, z = (float(a) + float(b) for a, b in zip(place, by, strict=True))
    return x, y, z


def back(origin: Sequence[float]) -> Place:
    """By how much (m) what is stated in the world moves when it is stated from `origin` on instead."""
    x, y, z = (0.0 - float(c) for c in origin)
    return x, y, z


def about_y(heading: float) -> np.ndarray:
    """Rotation about +y by an angle in radians, ``[3, 3]``: local to world as ``local @ R.T``, back as ``world @ R``.

    `scenes.motion.headings.rotation_about_y` of one number, to the last bit of the C library's sine and cosine.
    """
    c, s = math.cos(heading), math.sin(heading)
    return np.array([[c, 0.0, s], [0.0, 1.0, 0.0], [-s, 0.0, c]])


def rotations(quaternions: np.ndarray) -> np.ndarray:
    """Rotation matrices ``[*b, 3, 3]`` of unit quaternions (w, x, y, z) ``[*b, 4]``."""
    return matrices(torch.tensor(quaternions)).numpy()


def transform(frame: np.ndarray, points: np.ndarray) -> np.ndarray:
    """Points ``[*b, 3]`` carried by a transform ``[4, 4]``."""
    moved: np.ndarray = points @ frame[:3, :3].T + frame[:3, 3]
    return moved


def rigid(frame: np.ndarray) -> np.ndarray:
    """The rigid transform nearest to an affine one ``[4, 4]``: same origin, scale, shear and mirroring left out."""
    u, _, v = np.linalg.svd(frame[:3, :3])
    turn = u @ np.diag([1.0, 1.0, np.sign(np.linalg.det(u @ v))]) @ v
    result = np.eye(4)
    result[:3, :3], result[:3, 3] = turn, frame[:3, 3]
    return result
