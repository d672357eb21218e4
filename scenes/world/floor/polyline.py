"""Polylines over the floor: points at even steps along them, and their length."""

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
