"""Rigid frames as 4 x 4 matrices: points carried by them, rotations, and the nearest one to an affine matrix."""

from __future__ import annotations

import numpy as np


def rotations(quaternions: np.ndarray) -> np.ndarray:
    """Rotation matrices ``[*b, 3, 3]`` of unit quaternions (w, x, y, z) ``[*b, 4]``."""
    w, x, y, z = np.moveaxis(quaternions, -1, 0)
    rows = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
        [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
        [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
    ]
    return np.stack([np.stack(row, axis=-1) for row in rows], axis=-2)


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
