"""Free space as somebody finds it who starts somewhere: doors are ways, walls are none, and beyond is the way back."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest
import torch
from torch import Tensor

from scenes.mesh.mesh import Mesh, load_mesh
from scenes.mesh.primitives import Box, Plane
from scenes.world.contact import closest_point, swept_clearance
from scenes.world.moving import MovingObject, Trajectory
from scenes.world.reach import FINE, Reach
from scenes.world.scene import BUNDLED, Scene, bundled, load_scene

TALL, THIN = 2.4, 0.1
START = (-1.5, 0.0, 0.0)
"""In the western one of two rooms that are 3 x 4 m each, with a wall between them at x = 0."""


def slab(x: tuple[float, float], y: tuple[float, float], z: tuple[float, float], yaw: float = 0.0) -> Box:
    """A box by its edges, turned about the origin."""
    middle, size = np.mean([x, y, z], axis=1), np.ptp([x, y, z], axis=1)
    turned = (
        middle[0] * math.cos(yaw) + middle[2] * math.sin(yaw),
        middle[1],
        middle[2] * math.cos(yaw) - middle[0] * math.sin(yaw),
    )
    return Box(tuple(map(float, turned)), tuple(map(float, size)), yaw)


def outer(yaw: float = 0.0) -> list[Box]:
    """The walls around both rooms."""
    ends = [slab((x, x + THIN), (0, TALL), (-2.1, 2.1), yaw) for x in (-3.1, 3.0)]
    return ends + [slab((-3.1, 3.1), (0, TALL), (z, z + THIN), yaw) for z in (-2.1, 2.0)]


def between(width: float, low: float = 0.0, high: float = TALL, thick: float = THIN, yaw: float = 0.0) -> list[Box]:
    """The wall between the rooms, with an opening in its middle, from `low` to `high` m."""
    x, half = (-thick / 2, thick / 2), width / 2
    if not width:
        return [slab(x, (0, TALL), (-2, 2), yaw)]
    parts = [slab(x, (0, TALL), (-2, -half), yaw), slab(x, (0, TALL), (half, 2), yaw)]
    parts += [slab(x, (0, low), (-half, half), yaw)] if low > 0 else []
    return parts + ([slab(x, (high, TALL), (-half, half), yaw)] if high < TALL else [])


def reach_of(scene: Scene, place: Sequence[float] = START) -> Reach:
    found = scene.reached_from((place[0], place[1], place[2])).reach
    assert found is not None
    return found


def depth(scene: Scene, *points: Sequence[float]) -> list[float]:
    """The way back from points, for who starts in the western room."""
    found = scene.reached_from(START).reach
    return [0.0] * len(points) if found is None else found.depth(np.array(points)).tolist()


def spread(n: int, low: Sequence[float], high: Sequence[float]) -> Tensor:
    noise = torch.rand(n, 3, dtype=torch.float64, generator=torch.Generator().manual_seed(0))
    return torch.tensor(low, dtype=torch.float64) + noise * (torch.tensor(high) - torch.tensor(low))


def mesh_of(boxes: Sequence[Box]) -> Mesh:
    """Boxes as one mesh."""
    parts = [box.mesh() for box in boxes]
    begins = np.cumsum([0, *(len(part.vertices) for part in parts)])
    faces = [part.faces + begin for part, begin in zip(parts, begins, strict=False)]
    return Mesh(np.concatenate([part.vertices for part in parts]), np.concatenate(faces), "flat")


def building(width: float, height: float = 2.0) -> Scene:
    """Both rooms as a mesh on a floor that ends with the walls, with a door between them."""
    floor = slab((-3.1, 3.1), (-0.1, 0.0), (-2.1, 2.1))
    return Scene([mesh_of([floor, *outer(), *between(width, 0.0, height)])], resolution=96, cache=None)


@pytest.mark.parametrize(
    ("width", "low", "high", "way"),
    [
        (0.9, 0.0, 2.0, True),  # a door
        (0.6, 0.0, 2.0, True),  # a narrow one
        (0.9, 0.0, 0.8, True),  # a hatch to crawl through
        (0.9, 0.9, 2.1, True),  # a window, which one could climb through
        (0.0, 0.0, TALL, False),
        (0.05, 0.0, 2.0, False),  # a crack
        (0.9, 1.0, 1.1, False),  # a letterbox
        (0.9, 1.7, 2.3, False),  # a skylight
    ],
)
def test_doors_are_ways_and_cracks_are_none(width: float, low: float, high: float, way: bool) -> None:
    scene = Scene(primitives=[*outer(), *between(width, low, high)])
    found = reach_of(scene)
    there = found.depth(np.array([[1.5, 1.0, 0.7], [2.9, 0.2, -1.9]]))
    assert (there == 0).all() if way else (there > 1.4).all(), there
    outside = found.depth(np.array([[-4.0, 1.0, 0.0], [0.0, 1.0, 9.0], [-1.5, 1.0, -60.0]]))
    assert outside == pytest.approx([1.0, 7.0, 58.0], abs=FINE)
    assert found.depth(np.array([[-1.5, 1.0, 0.0], [-2.98, 0.02, -1.98], [-1.5, 2.6, 0.0]])).max() == 0


@pytest.mark.parametrize("thick", [0.02, 0.1, 0.3, 1.0])
def test_in_a_wall_the_way_back_is_felt_from_the_middle_on(thick: float) -> None:
    scene = Scene(primitives=[*outer(), *between(0.0, thick=thick)])
    x = torch.linspace(-thick / 2 - 0.5, thick / 2 + 0.5, 401, dtype=torch.float64)
    points = torch.stack([x, torch.full_like(x, 1.03), torch.full_like(x, 0.47)], dim=-1)
    back = x + thick / 2
    found = scene.reached_from(START).distance(points)
    assert found.numpy() == pytest.approx(-back.numpy(), abs=0.01)
    assert (found.diff() < 1e-9).all(), "the field rises again on the way through the wall"
    first = x < -0.01
    torch.testing.assert_close(found[first], scene.distance(points)[first], rtol=0, atol=0)
    exact = scene.reached_from(START).distance_exact(points.numpy())
    assert exact == pytest.approx(-back.numpy(), abs=0.01)


@pytest.mark.parametrize(("yaw", "thick"), [(0.5, 0.05), (1.0, 0.1), (-2.2, 0.1), (0.3, 0.2), (math.pi / 4, 0.4)])
def test_walls_at_any_angle_are_as_thick_as_they_are(yaw: float, thick: float) -> None:
    scene = Scene(primitives=[*outer(yaw), *between(0.0, thick=thick, yaw=yaw)])
    turn = np.array([[math.cos(yaw), 0, math.sin(yaw)], [0, 1, 0], [-math.sin(yaw), 0, math.cos(yaw)]])
    local = spread(200, (thick / 2, 0.1, -1.4), (2.4, 1.2, 1.4)).numpy()
    found = reach_of(scene, turn @ np.array(START)).depth(local @ turn.T)
    assert found == pytest.approx(local[:, 0] + thick / 2, abs=FINE / 2)
    close = spread(200, (0.01, 0.6, -0.8), (thick / 2 + 0.05, 1.2, 0.8)).numpy()
    found = reach_of(scene, turn @ np.array(START)).depth(close @ turn.T)
    assert found == pytest.approx(close[:, 0] + thick / 2, abs=0.02 if thick < 0.3 else 0.04)
    near = spread(200, (-2.9, 0.1, -1.9), (-thick / 2 - 0.01, 1.8, 1.9)).numpy()
    assert reach_of(scene, turn @ np.array(START)).depth(near @ turn.T).max() == 0


def test_a_sheet_without_thickness_is_a_wall() -> None:
    floor, walls = slab((-3.1, 3.1), (-0.1, 0.0), (-2.1, 2.1)), mesh_of(outer())
    sheet = np.array([[0, 0, -2.05], [0, 0, 2.05], [0, TALL, 2.05], [0, TALL, -2.05]], dtype=float)
    base, count = floor.mesh(), len(walls.vertices)
    vertices = np.concatenate([walls.vertices, base.vertices, sheet])
    quad = np.array([[0, 1, 2], [0, 2, 3]]) + count + len(base.vertices)
    mesh = Mesh(vertices, np.concatenate([walls.faces, base.faces + count, quad]), "sheet")
    scene = Scene([mesh], resolution=96, free_space="outside", cache=None)
    assert depth(scene, (-0.05, 1.0, 0.5), (0.1, 1.0, 0.5), (1.5, 1.0, 0.0), (-0.3, 1.0, 1.0)) == pytest.approx(
        [0.0, 0.1, 1.5, 0.0], abs=0.03
    )


def test_who_goes_back_goes_the_way_they_came() -> None:
    scene = Scene(primitives=[*outer(), *between(0.0)]).reached_from(START)
    points = spread(500, (0.0, 0.1, -1.9), (2.9, 1.8, 1.9)).requires_grad_()
    away = scene.distance(points)
    (slope,) = torch.autograd.grad(away.sum(), points)
    assert (slope.norm(dim=-1) < 1.2).all()
    there = (points - away[:, None] * slope).detach()  # Newton's step
    assert (there[:, 0] + THIN / 2).abs().median() < 0.02
    assert (scene.distance(there) > -FINE).float().mean() > 0.95


def test_distances_within_are_what_they_were_to_the_bit() -> None:
    scene = building(0.0)
    reached = scene.reached_from(START)
    points = spread(4000, (-2.999, 0.001, -1.999), (-0.051, 2.3, 1.999)).float().requires_grad_()
    before, after = scene.distance(points), reached.distance(points)
    torch.testing.assert_close(after, before, rtol=0, atol=0)
    slopes = [torch.autograd.grad(value.sum(), points)[0] for value in (before, after)]
    torch.testing.assert_close(slopes[1], slopes[0], rtol=0, atol=0)
    exact = points.detach().double().numpy()
    assert np.array_equal(scene.distance_exact(exact), reached.distance_exact(exact))
    assert reached.bakes is scene.bakes
    assert scene.reach is None


def test_batches_are_what_their_points_are() -> None:
    reached = building(0.0).reached_from(START)
    points = spread(60, (-4.0, -0.3, -3.0), (5.0, 3.5, 3.0)).reshape(3, 4, 5, 3)
    whole = reached.distance(points, torch.zeros(4, 5))
    single = torch.stack([reached.distance(point) for point in points.reshape(-1, 3)]).reshape(3, 4, 5)
    torch.testing.assert_close(whole, single, rtol=0, atol=0)


def test_a_building_without_a_ceiling_is_left_by_no_wall() -> None:
    scene = building(0.9)
    assert depth(scene, (1.5, 1.0, 0.7), (1.5, 2.6, 0.0), (-2.9, 2.3, 1.9)) == [0.0, 0.0, 0.0]
    assert depth(scene, (-4.0, 1.0, 0.0), (0.0, 1.0, 3.0), (6.0, 0.5, 0.0)) == pytest.approx([1.0, 1.0, 3.0], abs=FINE)
    assert depth(building(0.0), (1.5, 1.0, 0.0)) == pytest.approx([1.55], abs=0.02)


def test_air_without_ground_is_nowhere_even_through_an_open_door() -> None:
    floor = slab((-3.1, 3.1), (-0.1, 0.0), (-2.1, 2.1))
    walls = [wall for wall in outer() if wall.center[0] < 2]  # the eastern end is open
    scene = Scene([mesh_of([floor, *walls])], resolution=96, cache=None)
    assert depth(scene, (3.6, 1.2, 0.0), (2.9, 1.0, 0.0)) == [0.0, 0.0], "a hand may reach over the edge"
    assert min(depth(scene, (0.0, 1.0, 2.6), (6.0, 1.0, 0.0), (-4.0, 1.0, 0.0))) > 0.5


def test_who_starts_outside_finds_rooms_closed() -> None:
    scene = Scene(primitives=[*outer(), *between(0.9)])
    found = reach_of(scene, (0.0, 0.0, 5.0))
    assert found.depth(np.array([[0.0, 1.0, 30.0], [-40.0, 1.0, 0.0], [1.5, 1.0, 3.0]])).max() == 0
    assert found.depth(np.array([[1.5, 1.0, 1.0]]))[0] == pytest.approx(1.1, abs=0.02)


def test_a_swinging_door_is_no_wall_and_an_open_floor_has_no_beyond() -> None:
    leaf = MovingObject(Box((0, 1, 0), (0.05, 2.0, 0.88)), Trajectory([0.0], [[0.0, 0.0, 0.0]]))
    door = between(0.9, 0.0, 2.0)
    assert depth(Scene(primitives=[*outer(), *door], objects=[leaf]), (1.5, 1.0, 0.0)) == [0.0]
    slope = Plane((0.0, 0.0, 0.0), (0.1, 1.0, 0.0))
    for scene in (Scene.empty(), Scene(primitives=[slope]), Scene(primitives=[Box((1, 0.5, 0), (1, 1, 1))])):
        assert scene.reached_from((0.0, 0.0, 2.0)) is scene


def test_furniture_is_no_wall() -> None:
    bed = slab((-2.9, -1.0), (0.32, 0.6), (0.9, 1.95))
    legs = [slab((x, x + 0.1), (0, 0.32), (0.9, 1.0)) for x in (-2.9, -1.1)]
    wardrobe = slab((-0.7, -0.06), (0, 2.0), (-2.0, -0.8))
    counter = slab((-3.0, -0.05), (0, 1.1), (-0.8, -0.7))  # all the way across
    scene = Scene(primitives=[*outer(), *between(0.0), bed, *legs, wardrobe, counter])
    under, over = [(-2.0, 0.15, 1.5), (-1.05, 0.2, 1.9)], [(-0.4, 2.2, -1.2), (-0.08, 2.1, -1.5)]
    assert depth(scene, *under, *over, (-2.0, 1.0, -1.5)) == [0.0] * 5


@pytest.mark.parametrize("stairs", [True, False])
def test_storeys_are_joined_by_stairs(stairs: bool) -> None:
    walls = [slab((x, x + 0.1), (-0.2, 5.6), (-4.1, 4.1)) for x in (-4.1, 4.0)]
    walls += [slab((-4.1, 4.1), (-0.2, 5.6), (z, z + 0.1)) for z in (-4.1, 4.0)]
    floors = [slab((-4, 4), (-0.2, 0), (-4, 4)), slab((-4, 2), (2.8, 3), (-4, 4)), slab((2, 4), (2.8, 3), (1.5, 4))]
    steps = [slab((2.2, 3.8), (0, (k + 1) / 6), (0.28 * k - 3.6, 0.28 * k - 3.3)) for k in range(18 * stairs)]
    scene = Scene([mesh_of([*walls, *floors, *steps])], resolution=96, cache=None)
    under, above, outside = depth(scene, (0.0, 1.5, 0.0), (0.0, 4.0, 0.0), (5.0, 1.0, 0.0))
    assert under == 0.0
    assert above == (0.0 if stairs else pytest.approx(1.2, abs=0.05))
    assert outside == pytest.approx(1.0, abs=0.05)


def test_what_is_too_large_to_look_at_is_not_divided() -> None:
    rooms = [Box((0.0, 1.3, 40.0 * k), (400.0, 2.6, 0.2)) for k in range(-2, 3)]
    scene = Scene(primitives=rooms)
    assert scene.reached_from((0.0, 0.0, 3.0)) is scene


def test_only_what_one_could_be_in_is_a_part_of_its_own() -> None:
    def chest(height: float) -> list[Box]:
        """Hollow, with walls of 3 cm and a slit of 2 cm under its lid, 1 x 1.6 m."""
        x, z, y = (-2.4, -1.4), (-0.8, 0.8), (0.0, height)
        sides = [slab((x[k], x[k] + 0.03), y, z) for k in range(2)] + [
            slab(x, y, (z[k], z[k] + 0.03)) for k in range(2)
        ]
        return [*sides, slab(x, (height + 0.02, height + 0.05), z)]

    for height, apart in ((0.5, False), (2.0, True)):
        scene = Scene(primitives=[*outer(), *between(0.0), *chest(height)])
        found = reach_of(scene, (-0.8, 0.0, 1.4)).depth(np.array([[-1.9, 0.25, 0.0]]))[0]
        assert found == (pytest.approx(0.53, abs=0.05) if apart else 0.0)


def test_a_scene_far_from_the_origin_is_the_same_in_its_frame() -> None:
    move = (812.3, 0.0, -655.1)
    near, far = building(0.0), building(0.0).seen_from((-move[0], 0.0, -move[2]))
    points = spread(300, (-4.0, 0.1, -3.0), (4.0, 2.0, 3.0)).numpy()
    a = reach_of(near).depth(points)
    b = reach_of(far, (START[0] + move[0], 0.0, START[2] + move[2])).depth(points + np.array(move))
    assert a == pytest.approx(b, abs=FINE / 2)


def test_capsules_are_seen_on_their_way_through() -> None:
    scene = Scene(primitives=[*outer(), *between(0.0, thick=0.02)]).reached_from(START)
    a, b = torch.tensor([[-0.4, 1.0, 0.0]]), torch.tensor([[-0.4, 1.5, 0.0]])
    along = torch.tensor([0.8, 0.0, 0.0])
    assert float(swept_clearance(scene, a, b, a + along, b + along, 0.05)) == pytest.approx(-0.46, abs=0.02)
    assert float(swept_clearance(scene, a, b, a - along, b - along, 0.05)) == pytest.approx(0.34, abs=0.01)


def test_nearest_points_are_those_of_the_near_side() -> None:
    before = building(0.0)
    scene = before.reached_from(START)
    inside, beyond = spread(100, (-2.9, 0.1, -1.9), (-0.3, 1.8, 1.9)), spread(100, (0.2, 0.5, -1.0), (1.2, 1.2, 1.0))
    torch.testing.assert_close(closest_point(scene, inside), closest_point(before, inside))
    found = closest_point(scene, beyond)
    assert (found.points[:, 0] + THIN / 2).abs().quantile(0.9) < 0.02


def test_what_starts_in_a_wall_or_over_nothing_has_an_answer() -> None:
    scene = building(0.0)
    assert reach_of(scene, (-3.04, 0.0, 0.3)).depth(np.array([[-1.5, 1.0, 0.0]]))[0] == 0
    assert scene.reached_from((-7.0, 0.0, 0.0)).reach is None


@pytest.mark.parametrize("name", sorted(path.stem for path in BUNDLED.glob("*.glb")))
def test_bundled_scenes_are_whole(name: str) -> None:
    scene = bundled(name, cache=None, resolution=128)
    assert scene.reached_from((0.0, 0.0, 0.0)) is scene


@pytest.mark.parametrize("name", ["living_room", "office_large"])
def test_scans_are_whole(name: str, shared: Path) -> None:
    scene = load_scene(shared / "data" / "meshes" / f"{name}.ply", resolution=128)
    assert scene.reached_from((0.0, 0.0, 0.0)) is scene


def test_the_flat_that_people_tunnelled_out_of(shared: Path) -> None:
    scene = Scene([load_mesh(shared / "cases" / "tasks" / "flat.glb")], resolution=160)
    found = reach_of(scene, (1.0, 0.0, 1.8))
    furniture = [[-3.9, 0.6, -1.8], [-2.4, 1.2, 2.35], [1.9, 0.5, -0.8], [4.0, 1.5, 2.0], [-2.0, 0.2, -2.2]]
    assert found.depth(np.array([*furniture, [0.25, 1.0, 1.0]])).max() == 0
    assert found.depth(np.array([[-5.0, 1.0, -1.8], [1.0, 1.0, 3.5]])) == pytest.approx([0.5, 1.0], abs=0.02)
