"""Polylines over the ground: points at even steps along them, their length, and the steps that they take."""

from __future__ import annotations

import numpy as np


def resample(line: np.ndarray, spacing: float) -> np.ndarray:
    """A polyline ``[n, d]`` with points at equal steps of at most `spacing` (m) along it, ends kept."""
    along = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(line, axis=0), axis=1))])
    steps = max(1, int(np.ceil(along[-1] / spacing - 1e-9)))
    at = np.linspace(0.0, along[-1], steps + 1)
    return np.stack([np.interp(at, along, column) for column in line.T], axis=1)


def path_length(line: np.ndarray) -> float:
    """Length (m) of a polyline ``[n, d]``."""
    return float(np.linalg.norm(np.diff(np.asarray(line, dtype=np.float64), axis=0), axis=1).sum())


def walked(path: np.ndarray) -> float:
    """Length (m) of a path ``[P, 3]`` on the ground as seen from above: what noise of the ground does not lengthen."""
    return path_length(np.asarray(path)[:, [0, 2]])


def climbs(path: np.ndarray, step: float) -> np.ndarray:
    """Rises (m, negative for drops) of the steps of a path ``[P, 3]`` that are higher than `step` (m), in order."""
    rises = np.diff(np.asarray(path)[:, 1])
    return np.asarray(rises[np.abs(rises) > step])


def sloped(path: np.ndarray, stride: float) -> np.ndarray:
    """A path ``[P, 3]`` as a body's middle rises over it: heights are means over a `stride` (m), steps become slopes.

    Vertices are a third of a stride apart at most.
    """
    flat = path[:, [0, 2]]
    along = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(flat, axis=0), axis=1))])
    fine = np.linspace(0.0, along[-1], max(2, int(np.ceil(along[-1] / 0.01)) + 1))
    heights = np.interp(fine, along, path[:, 1])
    area = np.concatenate([[0.0], np.cumsum((heights[1:] + heights[:-1]) / 2 * np.diff(fine))])
    at = np.linspace(0.0, along[-1], max(2, int(np.ceil(along[-1] / (stride / 3))) + 1))
    half = np.minimum(np.minimum(at, along[-1] - at), stride / 2)  # a shorter mean near the ends, which stay
    total = np.interp(at + half, fine, area) - np.interp(at - half, fine, area)
    middle = np.where(half > 1e-9, total / np.maximum(2 * half, 1e-9), np.interp(at, along, path[:, 1]))
    return np.stack([np.interp(at, along, path[:, 0]), middle, np.interp(at, along, path[:, 2])], axis=1)
