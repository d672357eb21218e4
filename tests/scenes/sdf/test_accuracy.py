"""The oracle, and grids that contradict themselves."""

from __future__ import annotations

import numpy as np
import pytest
import torch

from scenes.mesh.primitives import Sphere
from scenes.sdf import accuracy
from scenes.sdf.accuracy import Oracle, impossible_flips
from scenes.sdf.bake import sided
from scenes.sdf.grid import SdfGrid
from scenes.sdf.lattice import Lattice


def grid_of(values: np.ndarray, spacing: float = 0.1) -> SdfGrid:
    return SdfGrid(torch.from_numpy(values), torch.zeros(3, dtype=torch.float64), spacing)


@pytest.mark.parametrize("layers", [2, 7, 8, 9, 16, 17])
def test_flips_are_counted_slab_by_slab_as_all_at_once(layers: int) -> None:
    values = np.random.default_rng(layers).uniform(-0.2, 0.2, (layers, 6, 5)).astype(np.float32)
    values[values < -0.15] = 0.0
    naive = 0
    for axis in range(3):
        a, b = np.delete(values, -1, axis), np.delete(values, 0, axis)
        naive += int(((np.sign(a) * np.sign(b) < 0) & (np.abs(a) + np.abs(b) > 0.101)).sum())
    assert naive > 0
    assert impossible_flips(grid_of(values)) == naive


def test_the_oracle_looks_near_the_surface_and_everywhere() -> None:
    mesh = Sphere((1, 2, 3), 0.8).mesh()
    lattice = Lattice.cube(mesh.bounds, 40, 0.2)
    oracle = Oracle.of(sided(mesh, "auto", lattice), lattice, samples=2000)
    points = lattice.nodes_at(oracle.nodes)
    radius = np.linalg.norm(points - [1, 2, 3], axis=1)
    assert np.abs(oracle.distance - np.abs(radius - 0.8)).max() < 0.02
    assert (oracle.free == (radius > 0.8))[np.abs(radius - 0.8) > 0.02].all()
    near = np.abs(radius - 0.8) < 2 * lattice.spacing
    assert near.sum() > 600 and (~near).sum() > 600


def test_values_that_are_no_numbers_are_infinitely_wrong() -> None:
    mesh = Sphere((0, 0, 0), 1.0).mesh()
    lattice = Lattice.cube(mesh.bounds, 12, 0.2)
    found = Oracle.of(sided(mesh, "auto", lattice), lattice, 500).judge(
        accuracy.SdfGrid(torch.full((12, 12, 12), torch.nan), torch.tensor(lattice.origin).double(), lattice.spacing),
    )
    assert found.near_error_voxels == found.far_error_voxels == np.inf
