"""The building is closed and the bench measures what it says."""

from __future__ import annotations

import numpy as np

from scenectl.bench.scenes.building import bench_building, building
from scenes.mesh.surface import Surface


def test_the_building_is_closed_and_the_same_each_time() -> None:
    mesh = building(0, 10.0)
    assert Surface.of(mesh).closed
    assert np.allclose(np.ptp(mesh.bounds, axis=0), [10.0, 20.0, 10.0])
    assert building(0, 10.0).digest == mesh.digest != building(1, 10.0).digest


def test_a_small_building_at_a_coarse_spacing() -> None:
    summary = bench_building(0.08, 10.0)["summary"]
    assert summary["grid_mb"] < 0.9 * summary["dense_mb"]
    assert summary["near_mean_error_voxels"] < 0.1
    assert int(summary["sign_errors"].split()[0]) < 60
