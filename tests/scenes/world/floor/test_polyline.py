"""Polylines are resampled evenly, and are as long as before."""

from __future__ import annotations

import numpy as np
import pytest

from scenes.world.floor.polyline import path_length, resample


def test_resampling_keeps_ends_and_length() -> None:
    corner = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 0.5]])
    line = resample(corner, 0.1)
    assert np.allclose(line[[0, -1]], corner[[0, -1]]) and len(line) == 16
    assert path_length(line) == pytest.approx(1.5)
