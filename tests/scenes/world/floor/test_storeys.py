"""Storeys, slopes, steps and kerbs: free areas and ways by hand, and ways that climb only where none is level."""

from __future__ import annotations

import numpy as np
import pytest

from scenes.errors import UserError
from scenes.mesh.mesh import Mesh
from scenes.mesh.primitives import Box
from scenes.world.floor.levels import STEP
from scenes.world.floor.mapping import CLIMB
from scenes.world.floor.planning import free_area
from scenes.world.floor.polyline import sloped, walked
from scenes.world.scene import Scene
from tests.scenes.world.floor.grounds import block, joined, kerb, ramp, steps, storeys, wedge


def on_ground(scene: Scene, path: np.ndarray) -> float:
    """Largest distance (m) of a path's points from the ground under them."""
    return float(np.abs(scene.ground_at(path[:, 0], path[:, 2], path[:, 1] + 0.05) - path[:, 1]).max())


@pytest.mark.parametrize("angle", [5.0, 10.0, 20.0])
def test_slopes_up_to_20_degrees_are_level_ways(angle: float) -> None:
    scene = ramp(angle)
    area = free_area(scene)
    path = area.path((0.0, -2.0), (0.3, 4.0))
    rise = 3.0 * np.tan(np.radians(angle))
    assert [floor.height for floor in scene.floors] == pytest.approx([0.0, rise], abs=0.05)
    assert area.square_metres == pytest.approx(2.4 * 7.4, rel=0.01)  # the borders are edges, the ramp is none
    assert path[[0, -1], 1] == pytest.approx([0.0, rise], abs=1e-4) and not len(area.climbs(path))
    assert on_ground(scene, path) < 1e-4 and walked(path) == pytest.approx(np.hypot(6.0, 0.3), rel=0.01)


@pytest.mark.parametrize("height", [0.26, 0.27, 0.29, 0.32])
def test_ways_never_lead_into_what_is_too_high_to_climb(height: float) -> None:
    area = free_area(kerb(height))
    ends = (0.0, -1.0), (0.0, 1.0)
    for way in (ends, ends[::-1]):
        with pytest.raises(UserError, match=rf"from \(0.00, .*{height:.2f}, .* no steps up to 0.25 m join"):
            area.path(*way)
    assert area.path((0.0, height, 1.0), (0.5, 1.4))[:, 1] == pytest.approx(height, abs=1e-3)


def test_heights_that_are_stated_are_those_of_the_ground() -> None:
    area = free_area(kerb(0.12))
    assert area.path((0.0, 0.2, -1.0), (0.5, -0.2, -1.0))[:, 1] == pytest.approx(0.0, abs=1e-4)
    with pytest.raises(UserError, match=r"no ground at a height of 0\.60 m; it is at 0\.12 m there"):
        area.path((0.0, 0.0, -1.0), (0.0, 0.6, 1.0))


@pytest.mark.parametrize("angle", [25.0, 40.0])
def test_steeper_slopes_are_not_walked_on(angle: float) -> None:
    area = free_area(ramp(angle))
    with pytest.raises(UserError, match=r"parts of the floor, which no slope up to 20° and no steps up to 0.25 m join"):
        area.path((0.0, -2.0), (0.0, 4.0))


@pytest.mark.parametrize(("height", "climbed"), [(0.08, False), (0.12, True), (0.2, True), (0.25, True)])
def test_kerbs_up_to_a_step_are_level_and_higher_ones_are_climbed(height: float, climbed: bool) -> None:
    scene = kerb(height)
    area = free_area(scene)
    path = area.path((-0.5, -1.0), (0.5, 1.0))
    assert path[[0, -1], 1] == pytest.approx([0.0, height], abs=1e-5)
    assert area.climbs(path) == pytest.approx([height] if climbed else [], abs=1e-4)
    assert area.climbs(path[::-1]) == pytest.approx([-height] if climbed else [], abs=1e-4)
    level = 3.4 * 3.4 if not climbed else 2 * 3.4 * 1.4  # nobody stands with half a body over a step
    assert area.square_metres == pytest.approx(level, rel=0.01)


def test_a_higher_kerb_stops_everybody() -> None:
    with pytest.raises(UserError, match=r"from \(0.00, 0.00, -1.00\) to \(0.00, 0.30, 1.00\).*steps up to 0.25 m join"):
        free_area(kerb(0.3)).path((0.0, -1.0), (0.0, 1.0))


@pytest.mark.parametrize("rise", [0.14, 0.17, 0.25])
def test_four_steps_lead_to_a_platform(rise: float) -> None:
    scene = steps(rise, 4, 0.3, side=0.4)
    area = free_area(scene)
    path = area.path((-1.2, -2.0), (-1.0, 2.2))
    assert [floor.height for floor in scene.floors] == pytest.approx([0.0, 4 * rise], abs=1e-5)
    assert path[[0, -1], 1] == pytest.approx([0.0, 4 * rise], abs=1e-5)
    assert area.climbs(path) == pytest.approx([rise] * 4, abs=1e-4) and on_ground(scene, path) < 1e-4
    flight = path[(path[:, 2] > 0.05) & (path[:, 2] < 1.15)]
    assert np.abs(flight[:, 0] - 0.4).max() <= 0.7 - 0.3 + 0.03  # clear of the open sides, as of any edge
    assert float(area.clearance_at(np.array([0.0, 2.2]))) == pytest.approx(0.8, abs=0.05)  # of the platform's border


def test_nobody_climbs_where_a_level_way_exists() -> None:
    rise = 3.0 * float(np.tan(np.radians(9.0)))
    parts = [block((0.5, 2.0), (k * 0.3, 3.0), rise / 3 * (k + 1)) for k in range(3)]  # steps, and a ramp beside them
    parts += [wedge((-2.0, 0.4), (0.0, 3.0), rise), block((-2.0, 2.0), (3.0, 5.0), rise)]
    area = free_area(joined(block((-2.0, 2.0), (-3.0, 0.0), 0.0), *parts))
    path = area.path((1.2, -2.0), (1.2, 4.0))
    assert not len(area.climbs(path)) and path[:, 0].min() < 0.1  # round by the ramp, though the steps are straight on


def test_a_level_way_is_taken_however_long_it_is() -> None:
    upper = [block((0.0, 10.5), (0.0, 2.0), 0.2), block((10.5, 12.0), (1.2, 2.0), 0.2)]
    area = free_area(joined(block((0.0, 12.0), (-2.0, 0.0), 0.0), *upper, wedge((10.5, 12.0), (0.0, 1.2), 0.2)))
    path = area.path((0.6, -1.0), (0.6, 1.0))
    assert not len(area.climbs(path)) and walked(path) > 20.0


def test_steps_are_crossed_and_not_walked_along() -> None:
    path = free_area(kerb(0.2)).path((-1.5, -0.4), (1.5, 0.4))
    near = np.abs(path[:, 2]) < 0.3
    assert walked(path[near]) < 1.0  # of 2.3 m straight ahead


def test_low_steps_are_level_however_steep() -> None:
    area = free_area(steps(0.09, 7, 0.2))
    path = area.path((0.0, -2.0), (0.0, 2.2))
    assert path[-1, 1] == pytest.approx(0.63, abs=1e-4) and not len(area.climbs(path))


def test_ways_lead_from_storey_to_storey_and_back() -> None:
    scene = storeys()
    area = free_area(scene)
    up = area.path((0.0, -1.0), (0.5, 2.72, -1.0))
    down = area.path((0.5, 2.72, -1.0), (0.0, 0.0, -1.0))
    for path, sign in ((up, 1.0), (down, -1.0)):
        assert len(area.climbs(path)) == 16 and (np.sign(area.climbs(path)) == sign).all()
        assert on_ground(scene, path) < 0.01
        assert np.linalg.norm(np.diff(path[:, ::2], axis=0), axis=1).max() <= 0.05 + 1e-9
        body = np.concatenate([path + np.array([0.0, h, 0.0]) for h in (0.8, 1.2, 1.6)])
        assert scene.distance_exact(body).min() > 0.2  # no head through the upper floor
    assert up[-1] == pytest.approx([0.5, 2.72, -1.0], abs=1e-4)
    above = area.path((1.0, 2.72, -1.0), (-2.0, 2.72, 0.2))
    assert (np.abs(above[:, 1] - 2.72) < 1e-4).all()


def test_storeys_without_stairs_are_both_free_and_not_joined() -> None:
    area = free_area(storeys(stairs=False))
    lower, upper = 5.4 * 3.4, 5.4 * 2.2 + 0.8 * 1.2
    assert area.square_metres == pytest.approx(lower + upper, rel=0.04)  # posts take some
    with pytest.raises(UserError, match="separate parts of the floor"):
        area.path((0.0, 0.0, -1.0), (0.0, 2.72, -1.0))
    with pytest.raises(UserError, match=r"no ground at a height of 1.20 m; it is at 0.00 and 2.72 m there"):
        area.path((0.0, 1.2, -1.0), (1.0, -1.0))


def test_the_border_of_a_slab_is_an_edge() -> None:
    scene = Scene([block((-2.0, 2.0), (-2.0, 2.0), 0.0)], resolution=96, cache=None)
    area = free_area(scene)
    assert area.square_metres == pytest.approx(3.4**2, rel=1e-3)
    for away in (0.02, 0.1, 0.31):
        assert float(area.clearance_at(np.array([2.0 - away, 0.0]))) == pytest.approx(away, abs=1e-6)
    with pytest.raises(UserError, match=r"edge is 0.10 m away"):
        area.path((1.9, 0.0), (0.0, 0.0))


@pytest.mark.parametrize("shift", [0.0, 0.013, 0.031])
def test_edges_within_the_map_are_where_they_are(shift: float) -> None:
    parts = [block((-2.0, shift), (-2.0, 2.0), 0.0), Box((1.5, 0.5, 1.5), (0.1, 1.0, 0.1)).mesh()]
    area = free_area(joined(*parts))
    x = np.linspace(shift - 0.6, shift - 0.05, 12)
    clear = area.clearance_at(np.stack([x, np.zeros(12)], axis=1))
    assert clear == pytest.approx(shift - x, abs=0.02)


def test_small_holes_of_a_scan_are_stepped_over_and_large_ones_are_not() -> None:
    def floor(hole: float) -> Scene:
        n, size = 81, 4.0
        x, z = np.meshgrid(np.linspace(0, size, n), np.linspace(0, size, n), indexing="ij")
        vertices = np.stack([x.ravel(), np.zeros(n * n), z.ravel()], axis=1)
        quad = np.arange(n * n).reshape(n, n)
        a, b, c, d = quad[:-1, :-1], quad[:-1, 1:], quad[1:, 1:], quad[1:, :-1]
        faces = np.concatenate([np.stack([p.ravel() for p in t], axis=1) for t in ((a, b, c), (a, c, d))])
        middle = vertices[faces].mean(axis=1)
        kept = np.abs(middle[:, [0, 2]] - 2.0).max(axis=1) > hole / 2
        return Scene([Mesh(vertices, faces[kept], "scan")], resolution=96, cache=None, free_space="outside")

    assert float(free_area(floor(0.2)).clearance_at(np.array([2.0, 2.0]))) > 1.5
    assert float(free_area(floor(0.8)).clearance_at(np.array([2.0, 2.0]))) <= 0.0


def test_rough_ground_is_walked_on_and_a_bench_is_not_part_of_it() -> None:
    rng = np.random.default_rng(0)
    n = 81
    x, z = np.meshgrid(np.linspace(0, 4, n), np.linspace(0, 4, n), indexing="ij")
    vertices = np.stack([x.ravel(), rng.normal(0.0, 0.01, n * n), z.ravel()], axis=1)
    quad = np.arange(n * n).reshape(n, n)
    a, b, c, d = quad[:-1, :-1], quad[:-1, 1:], quad[1:, 1:], quad[1:, :-1]
    faces = np.concatenate([np.stack([p.ravel() for p in t], axis=1) for t in ((a, b, c), (a, c, d))])
    bench = Box((2.0, 0.4, 2.0), (1.6, 0.1, 0.8))
    scene = Scene([Mesh(vertices, faces, "rough")], [bench], resolution=96, cache=None, free_space="outside")
    area = free_area(scene)
    assert scene.floor.height == pytest.approx(0.0, abs=0.005)
    assert area.square_metres == pytest.approx(3.4**2 - 1.6 * 0.8 - 2 * 2.4 * 0.3 - np.pi * 0.09, rel=0.03)
    assert not area.contains(np.array([2.0, 2.0]))


def test_steps_become_a_slope_for_the_body() -> None:
    z = np.linspace(0.0, 3.0, 61)
    path = np.stack([0 * z, 0.17 * np.clip(np.floor((z - 1.0) / 0.3 + 1), 0, 4), z], axis=1)
    line = sloped(path, 0.6)
    assert line[[0, -1]] == pytest.approx(path[[0, -1]]) and (np.diff(line[:, 1]) > -1e-9).all()
    assert np.abs(np.diff(line[:, 1]) / np.diff(line[:, 2])).max() < 0.17 / 0.3 * 1.3


def test_the_heights_of_steps_are_ordered() -> None:
    assert 0 < STEP < CLIMB == 0.25
