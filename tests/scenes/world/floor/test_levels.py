"""The height of the ground at a place is that of the surface under it, storey by storey."""

from __future__ import annotations

import numpy as np
import pytest
import torch
from hypothesis import given, settings, strategies as st

from scenes.mesh.mesh import Mesh
from scenes.mesh.primitives import Box, Cylinder, Plane, Sphere
from scenes.motion.waypoints import Waypoints
from scenes.world.floor.levels import STEP
from scenes.world.scene import Scene
from tests.scenes.world.floor.grounds import block, joined, ramp, steps, storeys

TILE = 0.6
"""Side of a tile (m); places at least `AWAY` from its border lie in cells of its own."""
AWAY = 0.005


def tiles(heights: np.ndarray) -> Scene:
    """Boxes side by side on a plane at y = -1, of the heights given, ``[n, m]``."""
    shapes = [
        Box(((i + 0.5) * TILE, (y - 1.2) / 2, (j + 0.5) * TILE), (TILE, y + 1.2, TILE))
        for (i, j), y in np.ndenumerate(heights)
    ]
    return Scene(primitives=shapes, floor=-1.0, cache=None)


@settings(max_examples=25, deadline=None)
@given(seed=st.integers(0, 2**31), rough=st.sampled_from([0.06, 0.17, 0.4]))
def test_the_ground_is_as_high_as_the_tile_under_a_place(seed: int, rough: float) -> None:
    rng = np.random.default_rng(seed)
    heights = rough * rng.integers(-2, 3, (3, 4))
    scene = tiles(heights)
    scene.__dict__["bounds"] = np.array([[0.0, -1.2, 0.0], [3 * TILE, 1.0, 4 * TILE]])
    i, j = rng.integers(3, size=200), rng.integers(4, size=200)
    x, z = (TILE * index + rng.uniform(AWAY, TILE - AWAY, 200) for index in (i, j))
    found = scene.ground_at(x, z, 2.0)
    assert found == pytest.approx(heights[i, j], abs=1e-9)


@settings(max_examples=25, deadline=None)
@given(seed=st.integers(0, 2**31))
def test_of_floors_over_one_another_the_nearest_below_counts(seed: int) -> None:
    rng = np.random.default_rng(seed)
    levels = np.cumsum(rng.uniform(0.4, 3.0, 4)) - 1.0
    slabs = [Box((0.0, y - 0.05, 0.0), (2.0, 0.1, 2.0)) for y in levels]
    scene = Scene(primitives=slabs, floor=-1.0, cache=None)
    y = rng.uniform(-1.0, levels[-1] + 1.0, 50)
    y = y[(np.abs(y[:, None] + STEP - levels) > 1e-6).all(axis=1)]  # a sole may be up to `STEP` in the ground
    below = np.array([max([-1.0, *levels[levels <= value + STEP]]) for value in y])
    assert scene.ground_at(0.3, -0.2, y) == pytest.approx(below, abs=1e-6)
    assert np.isnan(scene.ground_at(0.3, -0.2, -9.0))


def test_slopes_are_smooth_and_steps_are_steps() -> None:
    slope, angle = ramp(12.0), np.tan(np.radians(12.0))
    z = np.linspace(0.1, 2.9, 300)
    assert slope.ground_at(0.3, z, 3.0) == pytest.approx(z * angle, abs=1e-6)
    stairs = steps(0.17, 4, 0.3)
    z = np.linspace(-1.0, 2.0, 601)
    z = z[(np.abs(z[:, None] - 0.3 * np.arange(4)) > AWAY).all(axis=1)]
    assert stairs.ground_at(0.0, z, 3.0) == pytest.approx(0.17 * np.clip(np.floor(z / 0.3) + 1, 0, 4), abs=1e-6)


def test_what_floats_moves_or_ends_is_no_ground() -> None:
    ball = Sphere((0.0, 1.0, 0.0), 0.5, Waypoints((0.0, 1.0), ((0, 1, 0), (1, 1, 0))))
    scene = Scene([block((-1.0, 1.0), (-1.0, 1.0), 0.5)], [ball, Cylinder((0.5, 0.6, 0.5), 0.2, 0.3)], cache=None)
    assert scene.ground_at([0.0, 0.5], [0.0, 0.5], 3.0) == pytest.approx([0.5, 0.75], abs=1e-6)
    assert np.isnan(scene.ground_at(3.0, 0.0, 3.0)) and float(scene.ground_under(torch.tensor([3.0, 1.0, 0.0]))) == 0.5
    assert Scene.empty(floor=0.2).ground_at(99.0, 0.0) == pytest.approx(0.2)
    hill = Plane((0.0, 0.0, 0.0), (0.0, 1.0, 0.2))
    assert Scene(primitives=[hill], floor=-9.0).ground_at(1.0, [2.0, -2.0]) == pytest.approx([-0.4, 0.4], abs=1e-6)


def test_a_table_is_ground_for_what_is_on_it_but_nobody_is_put_there() -> None:
    scene = joined(block((-2.0, 2.0), (-2.0, 2.0), 0.0), block((0.0, 1.0), (0.0, 1.0), 0.75, 0.7))
    assert scene.ground_at(0.5, 0.5, [0.8, 0.6, 0.1]) == pytest.approx([0.75, 0.0, 0.0], abs=1e-5)
    assert scene.ground_at(0.5, 0.5) == pytest.approx(0.0, abs=1e-5)
    assert float(scene.ground_under(torch.tensor([0.5, 0.8, 0.5]))) == pytest.approx(0.0, abs=1e-5)


def test_of_storeys_the_main_floor_counts_where_nothing_is_said() -> None:
    scene = storeys()
    assert scene.ground_at(0.0, -1.0) == pytest.approx(0.0, abs=1e-5)
    assert scene.ground_at(2.0, 1.4) == pytest.approx(0.0, abs=1e-5)
    assert scene.ground_at(1.45, 1.4) == pytest.approx(2.72, abs=1e-5)  # at the head of the stairs nothing is under it


def test_normals_do_not_matter() -> None:
    mesh = steps().meshes[0]
    flipped = Mesh(
        mesh.vertices, np.where(np.arange(len(mesh.faces))[:, None] % 3 > 0, mesh.faces, mesh.faces[:, ::-1])
    )
    a, b = (Scene([m], resolution=128, cache=None, free_space="outside").levels for m in (mesh, flipped))
    rows, columns = np.mgrid[2 : a.heights.shape[0] - 2, 2 : a.heights.shape[1] - 2]
    top = [np.nanmax(levels.heights[rows, columns], axis=-1) for levels in (a, b)]
    assert (np.abs(top[0] - top[1]) < 1e-6).mean() > 0.98
