"""Rigid frames as 4 x 4 matrices: points carried by them, rotations, and the nearest one to an affine matrix."""

from __future__ import annotations

import math

import numpy as np
import torch

from scenes.motion.rotations import matrices


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
