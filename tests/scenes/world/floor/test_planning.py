"""The map of the floor and its paths agree with geometry done by hand."""

from __future__ import annotations

import math
from functools import cached_property

import numpy as np
import pytest

from scenes.errors import UserError
from scenes.mesh.csg import csg
from scenes.mesh.primitives import Box, Capsule, Cylinder
from scenes.world.floor.planning import OPEN, SPACING, FreeArea, free_area
from scenes.world.floor.polyline import path_length
from scenes.world.scene import Scene

RADIUS = 0.3


class Room(Scene):
    """4 x 3 m with walls and a floor at 0.2 m, all analytic, and what else a test puts in."""

    HALF_X, HALF_Z, FLOOR = 2.0, 1.5, 0.2

    def __init__(self, *things: Box | Cylinder | Capsule) -> None:
        x, z, t = self.HALF_X, self.HALF_Z, 0.1
        walls = [Box((s * (x + t / 2), 1.2, 0.0), (t, 2.4, 2 * z + 2 * t)) for s in (-1, 1)]
        walls += [Box((0.0, 1.2, s * (z + t / 2)), (2 * x, 2.4, t)) for s in (-1, 1)]
        super().__init__(primitives=[*walls, *things], floor=self.FLOOR)

    @cached_property
    def bounds(self) -> np.ndarray:  # type: ignore[override]
        return np.array([[-2.1, self.FLOOR, -1.6], [2.1, 2.4, 1.6]])

    def wall_distance(self, xz: np.ndarray) -> np.ndarray:
        return np.minimum(self.HALF_X - np.abs(xz[..., 0]), self.HALF_Z - np.abs(xz[..., 1]))


def pillar(x: float = 0.0, z: float = 0.0, radius: float = 0.25) -> Cylinder:
    return Cylinder((x, 1.2, z), radius, 2.4)


@pytest.fixture(scope="module")
def round_a_pillar() -> FreeArea:
    return free_area(Room(pillar()))


def centres(area: FreeArea) -> np.ndarray:
    x, z = np.indices(area.clearance.shape)
    return np.stack([x, z], axis=-1) * area.cell + area.origin


def test_clearance_is_the_horizontal_distance_to_the_nearest_obstacle(round_a_pillar: FreeArea) -> None:
    at = centres(round_a_pillar)
    true = np.minimum(Room().wall_distance(at), np.linalg.norm(at, axis=-1) - 0.25)
    open_floor = true > 0
    error = (round_a_pillar.clearance - true)[open_floor]
    assert np.abs(error).max() < 0.01
    assert (round_a_pillar.clearance[~open_floor] <= 1e-6).all()
    assert round_a_pillar.floor == 0.2


def test_between_cells_clearance_is_interpolated(round_a_pillar: FreeArea) -> None:
    points = np.random.default_rng(0).uniform([-1.9, -1.4], [1.9, 1.4], size=(500, 2))
    true = np.minimum(Room().wall_distance(points), np.linalg.norm(points, axis=-1) - 0.25)
    near = np.abs(round_a_pillar.clearance_at(points) - true)[true > 0.05]
    assert near.max() < 0.03  # cells are 5 cm and ridges between obstacles are flattened


def test_rugs_and_what_hangs_high_are_no_obstacles_but_beams_are() -> None:
    def middle(thing: Box, height: float) -> float:
        return float(free_area(Room(thing), height=height, cell=0.1).clearance_at(np.zeros(2)))

    rug, lamp = Box((0.0, 0.22, 0.0), (1.0, 0.04, 1.0)), Box((0.0, 2.2, 0.0), (0.5, 0.3, 0.5))
    beam = Box((0.0, 1.8, 0.0), (0.3, 0.3, 3.0))  # its underside is 1.45 m above the floor
    assert middle(rug, 1.8) > 1.4 and middle(lamp, 1.8) > 1.4
    assert middle(Box((0.0, 0.24, 0.0), (1.0, 0.08, 1.0)), 1.8) > 1.4  # a step of 8 cm; and one of 12 cm:
    assert middle(Box((0.0, 0.26, 0.0), (1.0, 0.12, 1.0)), 1.8) == pytest.approx(0.5, abs=0.06)  # is stood on, and ends
    assert middle(beam, 1.8) <= 0.0 and middle(beam, 1.4) > 1.4


@pytest.mark.parametrize("thickness", [0.01, 0.04])
def test_thin_things_are_never_missed(thickness: float) -> None:
    board = Box((0.013, 0.9, 0.017), (0.5, thickness, 0.5))
    pole = Capsule((1.013, 0.2, 0.512), (1.013, 2.0, 0.512), thickness / 2)
    area = free_area(Room(board, pole))
    assert area.clearance_at(np.array([0.0, 0.0])) < 0.05
    assert area.clearance_at(np.array([1.0, 0.5])) < 0.05
    assert area.clearance_at(np.array([1.0, -0.1])) == pytest.approx(0.61 - thickness / 2, abs=0.02)


def test_there_is_nothing_free_where_no_floor_is() -> None:
    islands = csg("union", Box((0.0, -0.05, 0.0), (2.0, 0.1, 2.0)), Box((4.0, -0.05, 0.0), (2.0, 0.1, 2.0)))
    scene = Scene([islands], resolution=64, cache=None)
    area = free_area(scene, radius=0.2)
    assert scene.floor.found
    assert area.contains(np.array([[0.0, 0.0], [4.0, 0.0], [2.0, 0.0], [9.0, 0.0]])).tolist() == [
        True,
        True,
        False,
        False,
    ]
    with pytest.raises(UserError, match="they are on separate parts of the floor"):
        area.path((0, 0), (4, 0))


def test_an_empty_scene_is_free_everywhere() -> None:
    area = free_area(Scene.empty(floor=-1.0), cell=0.5)
    border = (np.abs(area.bounds - centres(area)[..., None, :])).min(axis=(-1, -2))
    assert area.clearance == pytest.approx(np.minimum(border, OPEN)) and area.floor == -1.0  # its border is an edge
    assert path_length(area.path((-5, -5), (5, 5))) == pytest.approx(10 * math.sqrt(2))


def test_batches_equal_loops(round_a_pillar: FreeArea) -> None:
    points = np.random.default_rng(1).uniform(-2.5, 2.5, size=(4, 5, 2))
    one_by_one = [[bool(round_a_pillar.contains(p)) for p in row] for row in points]
    assert round_a_pillar.contains(points).tolist() == one_by_one
    assert round_a_pillar.contains(points, radius=0.6).sum() < round_a_pillar.contains(points).sum()


@pytest.mark.parametrize("sizes", [{"radius": 0.0}, {"height": 0.1}, {"cell": -1.0}, {"height": math.nan}])
def test_senseless_sizes_are_refused(sizes: dict[str, float]) -> None:
    with pytest.raises(UserError, match=f"{next(iter(sizes))} is .* give more than"):
        free_area(Scene.empty(), **sizes)


def test_a_map_too_large_is_refused() -> None:
    with pytest.raises(UserError, match=r"use a cell larger than 0\.001 m"):
        free_area(Scene.empty(), cell=0.001)


# --- places and paths ----------------------------------------------------------------------------------------------


def test_places_are_free_uniform_and_repeatable(round_a_pillar: FreeArea) -> None:
    places = round_a_pillar.sample(4000, np.random.default_rng(3), radius=0.5)
    assert places.shape == (4000, 2) and round_a_pillar.contains(places, 0.5).all()
    assert np.array_equal(places, round_a_pillar.sample(4000, np.random.default_rng(3), radius=0.5))
    assert np.abs(places.mean(axis=0)).max() < 0.05  # the room is symmetric
    outer = (Room.HALF_X - 0.5) * 2 * (Room.HALF_Z - 0.5) * 2 - math.pi * 0.75**2
    quarter = 1.5 * 1.0 - math.pi * 0.75**2 / 4
    assert (places > 0).all(axis=1).mean() == pytest.approx(quarter / outer, abs=0.03)


def test_no_place_for_giants(round_a_pillar: FreeArea) -> None:
    with pytest.raises(UserError, match=r"radius 3 m .* use a smaller radius"):
        round_a_pillar.sample(1, np.random.default_rng(0), radius=3.0)


def test_the_path_round_a_pillar_is_short_clear_and_even(round_a_pillar: FreeArea) -> None:
    start, goal = np.array([-1.5, 0.0]), np.array([1.5, 0.0])
    path = round_a_pillar.path(start, goal)
    rope = 0.25 + RADIUS  # the shortest way is a rope pulled tight round a disc of this radius
    shortest = 2 * math.sqrt(1.5**2 - rope**2) + rope * (math.pi - 2 * math.acos(rope / 1.5))
    assert shortest - 0.01 <= path_length(path) <= 1.08 * shortest
    assert np.array_equal(path[[0, -1]][:, [0, 2]], np.stack([start, goal]))
    assert (path[:, 1] == 0.2).all()
    assert np.linalg.norm(np.diff(path, axis=0), axis=1).max() <= SPACING + 1e-9
    flat = path[:, [0, 2]]
    assert min((np.linalg.norm(flat, axis=1) - 0.25).min(), Room().wall_distance(flat).min()) >= RADIUS - 0.005
    turns = np.diff(np.unwrap(np.arctan2(*np.diff(flat, axis=0).T)))
    assert np.abs(turns).max() < math.radians(12)  # no corner that a walker would have to stop for


def test_a_clear_way_is_a_straight_line() -> None:
    path = free_area(Room(), cell=0.1).path((-1.0, -0.5), (1.0, 0.3))
    assert path_length(path) == pytest.approx(math.hypot(2.0, 0.8), rel=1e-6)


def test_paths_join_random_places_and_keep_clear() -> None:
    room = Room(pillar(-0.9, 0.3), pillar(0.5, -0.4), Box((0.2, 0.5, 1.2), (0.6, 0.6, 0.6)))
    area = free_area(room)
    rng = np.random.default_rng(0)
    for a, b in area.sample(16, rng).reshape(8, 2, 2):
        path = area.path(a, b)
        points = np.repeat(path, 4, axis=0) + np.tile(
            [[0, 0.31, 0], [0, 0.6, 0], [0, 1.0, 0], [0, 1.6, 0]], (len(path), 1)
        )
        assert room.distance_exact(points).min() >= RADIUS - 0.02
        assert np.linalg.norm(b - a) - 1e-9 <= path_length(path) < 8.0


def test_corners_are_not_cut() -> None:
    block = Box((0.65, 1.2, 0.4), (2.7, 2.4, 2.2))  # leaves an L of 0.7 and 0.8 m around the corner (-0.7, -0.7)
    room = Room(block, Box((-1.7, 1.2, 0.0), (0.6, 2.4, 3.0)))
    path = free_area(room).path((-1.05, 1.1), (1.6, -1.1))
    assert room.distance_exact(path + np.array([0.0, 1.0, 0.0])).min() >= RADIUS - 0.005


def test_a_narrow_gap_stops_the_wide_and_says_who_passes() -> None:
    gap = [Box((0.0, 1.2, s * 0.875), (0.2, 2.4, 1.25)) for s in (-1, 1)]  # 0.5 m wide
    area = free_area(Room(*gap))
    with pytest.raises(UserError, match=r"no way .* is 0.3 m clear .* a radius of 0.2[2-5] m would pass"):
        area.path((-1, 0), (1, 0))
    assert 0.22 <= area.widest((-1, 0), (1, 0)) <= 0.25  # cells of 5 cm straddle the middle
    assert path_length(area.path((-1, 0), (1, 0), radius=0.2)) == pytest.approx(2.0, rel=0.02)


def test_a_wall_all_across_separates() -> None:
    area = free_area(Room(Box((0.0, 1.2, 0.0), (0.1, 2.4, 3.0))), cell=0.1)
    with pytest.raises(UserError, match="separate parts of the floor"):
        area.path((-1, 0), (1, 0))


def test_ends_that_are_not_free_are_named_with_the_nearest_place(round_a_pillar: FreeArea) -> None:
    with pytest.raises(UserError, match=r"path start \(0.50, 0.00\) is not free: .* 0.25 m away .* nearest free"):
        round_a_pillar.path((0.5, 0.0), (1.5, 0.0))
    with pytest.raises(UserError, match=r"path goal \(9.00, 0.00\) is not free"):
        round_a_pillar.path((1.5, 0.0), (9.0, 0.0))
    with pytest.raises(UserError, match="give x and z"):
        round_a_pillar.path((0.5, 0.0, 1.0, 0.0), (1.5, 0.0))
    with pytest.raises(UserError, match="no place on this floor"):
        round_a_pillar.path((0.5, 0.0), (1.5, 0.0), radius=2.0)


def test_start_and_goal_may_coincide(round_a_pillar: FreeArea) -> None:
    path = round_a_pillar.path((1.2, 0.3), (1.2, 0.3))
    assert path_length(path) == pytest.approx(0.0, abs=1e-9) and len(path) >= 2
