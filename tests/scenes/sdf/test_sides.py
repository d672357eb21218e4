"""One truth for signs: the grid, the scorer and the seed agree with the shape, whichever way triangles are wound."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import torch
from hypothesis import assume, given, settings, strategies as st

from scenes.errors import UserError
from scenes.mesh.content import joined
from scenes.mesh.csg import csg
from scenes.mesh.mesh import Mesh, load_mesh
from scenes.mesh.pieces import Pieces
from scenes.mesh.primitives import Box
from scenes.mesh.surface import Surface
from scenes.sdf.bake import bake
from scenes.sdf.exact import speakers
from scenes.world.moving import MovingObject, Trajectory
from scenes.world.scene import Scene

ROOM = Box((2.5, 1.3, 2.0), (5.0, 2.6, 4.0))
TABLE = Box((2.0, 0.5, 2.0), (1.0, 0.6, 0.7))
CRATE = Box((4.0, 0.4, 1.0), (0.8, 0.8, 0.8), yaw=0.3)
AIR = (1.0, 1.5, 1.0)
POINTS = np.random.default_rng(5).uniform((-0.09, -0.09, -0.09), (5.09, 2.69, 4.09), (400, 3))


def together(*meshes: Mesh) -> Mesh:
    return Mesh(*joined([(mesh.vertices, mesh.faces) for mesh in meshes]), "together")


def inverted(mesh: Mesh) -> Mesh:
    return Mesh(mesh.vertices, mesh.faces[:, ::-1], mesh.name)


def turned(mesh: Mesh, which: np.ndarray) -> Mesh:
    faces = mesh.faces.copy()
    faces[which] = faces[which][:, ::-1]
    return Mesh(mesh.vertices, faces, mesh.name)


def fine(box: Box, size: float = 0.5) -> Mesh:
    import trimesh

    solid = box.mesh()
    whole = trimesh.Trimesh(solid.vertices, solid.faces).subdivide_to_size(size)
    return Mesh(whole.vertices, whole.faces, "fine")


def without(mesh: Mesh, axis: int, value: float) -> Mesh:
    on = (np.abs(mesh.triangles[:, :, axis] - value) < 1e-9).all(axis=1)
    assert on.any()
    return Mesh(mesh.vertices, mesh.faces[~on], mesh.name)


def free_in(points: np.ndarray, *solids: Box, room: Box | None = ROOM) -> np.ndarray:
    """Signed distance of the analytic shapes, positive in free space."""
    where = torch.from_numpy(points)
    parts = [solid.distance(where) for solid in solids] + ([] if room is None else [-room.distance(where)])
    return torch.stack(parts).amin(0).numpy()


def assert_free(scene: Scene, expected: np.ndarray, points: np.ndarray = POINTS, clear: float = 0.06) -> None:
    """Grid and scorer say free exactly where `expected` is positive, as far as it is clear of surfaces (m)."""
    sure = np.abs(expected) > clear
    assert sure.mean() > 0.3
    grid, exact = scene.distance(torch.from_numpy(points)).numpy(), scene.distance_exact(points)
    assert ((grid > 0) == (expected > 0))[sure].all(), "grid"
    assert ((exact > 0) == (expected > 0))[np.abs(expected) > min(clear, 0.01)].all(), "scorer"


def scene_of(*meshes: Mesh, **baking: object) -> Scene:
    return Scene([together(*meshes)], cache=None, resolution=64, **baking)  # type: ignore[arg-type]


# -------------------------------------------------------------------------------------------------- windings of rooms


@given(st.integers(0, 2**32 - 1), st.floats(0.02, 0.33), st.booleans(), st.booleans())
@settings(max_examples=12, deadline=None)
def test_rooms_with_triangles_turned_at_random(seed: int, share: float, whole: bool, open_: bool) -> None:
    rng = np.random.default_rng(seed)
    room = inverted(fine(ROOM, 0.9))
    if open_:
        room = without(room, 1, 2.6)
    room = turned(room, rng.random(len(room.faces)) < share)
    table = inverted(TABLE.mesh()) if whole else turned(TABLE.mesh(), rng.permutation(12) < 12 * share)
    scene = scene_of(room, table)
    below = POINTS[:, 1] < 2.4 if open_ else np.ones(len(POINTS), dtype=bool)
    assert_free(scene, free_in(POINTS, TABLE)[below], POINTS[below])
    assert any("face against their neighbours" in doubt for doubt in scene.doubts)
    assert any("faces inward in free space" in doubt for doubt in scene.doubts) == whole


@pytest.mark.parametrize("wall", [(n,) for n in range(6)] + [(0, 1), (1, 5)])
def test_a_wall_that_shares_no_corner_may_face_either_way(wall: tuple[int, ...]) -> None:
    # walls fall short of each other by millimetres, so that no shared edge tells which way they belong
    walls = []
    for number in range(6):
        part = inverted(fine(ROOM, 0.5 + 0.37 * number))
        axis, value = number % 3, float(ROOM.mesh().bounds[number // 3, number % 3])
        on = (np.abs(part.triangles[:, :, axis] - value) < 1e-9).all(axis=1)
        middle = part.triangles[on].reshape(-1, 3).mean(axis=0)
        own = Mesh(middle + 0.999 * (part.vertices - middle), part.faces[on])
        walls.append(inverted(own) if number in wall else own)
    scene = scene_of(*walls, TABLE.mesh())
    assert_free(scene, free_in(POINTS, TABLE), clear=0.1)
    assert any("face against their neighbours" in doubt for doubt in scene.doubts)


def test_a_reversed_room_is_the_same_room_or_in_doubt() -> None:
    bare = scene_of(ROOM.mesh())
    assert bare.bakes[0].rule == "outside" and any("standing room" in doubt for doubt in bare.doubts)
    assert_free(scene_of(ROOM.mesh(), free_space=AIR), free_in(POINTS))
    assert_free(scene_of(ROOM.mesh(), inverted(TABLE.mesh()), free_space=AIR), free_in(POINTS, TABLE))
    dented = csg("difference", ROOM, Box((2.0, 0.2, 2.0), (2.5, 1.0, 1.6)))  # furniture as scans have it: of one piece
    found = scene_of(dented)
    assert found.bakes[0].inward and any("turned inside out" in doubt for doubt in found.doubts)
    assert_free(found, free_in(POINTS, Box((2.0, 0.2, 2.0), (2.5, 1.0, 1.6))))
    assert not scene_of(Box((0, 0.5, 0), (4, 1, 4)).mesh()).doubts  # a platform has no room inside


@pytest.mark.parametrize("gone", [((1, 2.6),), ((1, 2.6), (0, 0.0)), ((0, 5.0),)])
@pytest.mark.parametrize("free_space", ["auto", AIR])
def test_a_room_that_is_cut_open(gone: tuple[tuple[int, float], ...], free_space: object) -> None:
    shell = inverted(fine(ROOM))
    for axis, value in gone:
        shell = without(shell, axis, value)
    scene = scene_of(shell, TABLE.mesh(), inverted(CRATE.mesh()), free_space=free_space)
    expected = free_in(POINTS, TABLE, CRATE)
    inside = np.ones(len(POINTS), dtype=bool)
    for axis, value in gone:  # what lies before an opening may be either
        inside &= np.abs(POINTS[:, axis] - value) > 0.3
    assert_free(scene, expected[inside], POINTS[inside])


# ------------------------------------------------------------------------------------------------------------- solids


@given(
    st.lists(
        st.tuples(*[st.floats(-0.8, 0.8)] * 3, *[st.floats(0.2, 1.4)] * 3, st.floats(0, 3), st.booleans()),
        min_size=1,
        max_size=5,
    )
)
@settings(max_examples=12, deadline=None)
def test_overlapping_solids_are_their_union_however_they_face(heap: list[tuple[float, ...]]) -> None:
    boxes = [Box(values[:3], values[3:6], values[6]) for values in heap]
    corners = [torch.from_numpy(box.mesh().vertices) for box in boxes]  # one that faces inward in another is a hollow
    assume(not any((a.distance(c) < 1e-3).all() for n, a in enumerate(boxes) for m, c in enumerate(corners) if n != m))
    some = [box.mesh() if values[7] else inverted(box.mesh()) for box, values in zip(boxes, heap, strict=True)]
    some = [*some, Box((0, -3, 0), (6, 0.5, 6)).mesh()]  # they lie over a slab, so that they are no rooms
    scene = Scene([together(*some)], cache=None, resolution=24, free_space="outside")
    points = np.random.default_rng(0).uniform(-1.2, 1.2, (200, 3))
    union = Scene([csg("union", *boxes)], cache=None, resolution=24)
    exact, expected = scene.distance_exact(points), union.distance_exact(points)
    near = np.abs(expected) < 0.9  # nearer than the slab
    assert np.abs(exact - expected)[near].max() < 1e-6


@given(st.integers(0, 2**31), st.integers(1, 4), st.floats(0.02, 3.0))
def test_points_speak_for_others_on_their_side_alone(seed: int, count: int, spread: float) -> None:
    draw = np.random.default_rng(seed)
    middles, radii = draw.uniform(-1, 1, (count, 3)), draw.uniform(0.05, 0.8, count)
    points = draw.normal(0.0, spread, (300, 3))
    signed = np.linalg.norm(points[:, None] - middles, axis=-1) - radii  # spheres, whose union has a boundary
    inside, unsigned = (signed < 0).any(axis=1), np.abs(signed).min(axis=1)
    whose = speakers(points, unsigned)
    assert (inside[whose] == inside).all() and (whose[whose] == whose).all()


def test_few_points_are_asked_for_their_side() -> None:
    points = np.random.default_rng(0).uniform(-2, 2, (20_000, 3))
    unsigned = np.abs(np.linalg.norm(points, axis=1) - 1.0)
    assert len(np.unique(speakers(points, unsigned))) < 0.15 * len(points)


def test_depth_and_gradient_in_nested_solids() -> None:
    scene = Scene([together(Box((0, 0, 0), (2, 2, 2)).mesh(), Box((0, 0, 0), (0.4, 0.4, 0.4)).mesh())], cache=None)
    points = torch.tensor([[0.3, 0.1, 0.0], [0.0, 0.0, -0.6], [0.1, 0.85, 0.0]], dtype=torch.float64).requires_grad_()
    depth = scene.distance(points)
    assert depth.tolist() == pytest.approx([-0.7, -0.4, -0.15], abs=2e-3)
    (gradient,) = torch.autograd.grad(depth.sum(), points)
    assert torch.allclose(gradient, torch.tensor([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]]).double(), atol=1e-3)


def test_touching_solids_have_no_surface_between_them() -> None:
    blocks = [Box((x, 0.5, z), (1, 1, 1)).mesh() for x in range(3) for z in range(3)]
    pieces = Pieces.of(Surface.of(together(*blocks)))
    assert pieces.closed.all() and len(pieces.closed) == 9  # their corners are shared, and they are nine solids still
    scene = Scene([together(*blocks)], cache=None, resolution=64)
    assert scene.distance_exact(np.array([[1.0, 0.5, 1.0], [0.5, 0.5, 0.5]])).tolist() == pytest.approx([-0.5, -0.5])


def test_hollows_stay_hollow_and_what_lies_in_them_solid() -> None:
    outer, hollow, kernel = (Box((0, 0, 0), (size, size, size)) for size in (2.0, 1.6, 0.5))
    scene = Scene([together(outer.mesh(), inverted(hollow.mesh()), kernel.mesh())], cache=None, resolution=48)
    points = np.array([[0.0, 0, 0], [0.5, 0, 0], [0.9, 0, 0], [1.05, 0, 0]])
    assert scene.distance_exact(points).tolist() == pytest.approx([-0.25, 0.25, -0.1, 0.05])
    assert np.sign(scene.distance(torch.from_numpy(points)).numpy()).tolist() == [-1, 1, -1, 1]


@pytest.mark.parametrize("facing", [1, -1])
def test_furniture_on_a_floor_with_walls_is_solid(facing: int) -> None:
    # In the corner of a floor and two walls the winding number is -0.6, which a solid's own 1 does not lift over 1/2.
    shell = inverted(fine(ROOM))
    for axis, value in ((1, 2.6), (0, 5.0), (2, 4.0)):
        shell = without(shell, axis, value)
    corner = Box((0.6, 0.5, 0.6), (0.8, 0.8, 0.8)).mesh()
    scene = scene_of(shell, corner if facing > 0 else inverted(corner))
    assert scene.bakes[0].rule == "outside"
    where = np.array([[0.6, 0.5, 0.6], [0.6, 1.5, 0.6]])
    assert np.sign(scene.distance_exact(where)).tolist() == [-1, 1]
    assert np.sign(scene.distance(torch.from_numpy(where)).numpy()).tolist() == [-1, 1]


def test_furniture_of_a_file_of_its_own_is_no_room() -> None:
    scene = Scene([inverted(ROOM.mesh()), inverted(TABLE.mesh())], cache=None, resolution=48)
    assert_free(scene, free_in(POINTS, TABLE), clear=0.12)


def test_a_moving_thing_turned_inside_out_is_solid() -> None:
    way = Trajectory((0.0,), ((0.0, 0.0, 0.0),))
    things = [MovingObject(mesh, way, cache=None) for mesh in (CRATE.mesh(), inverted(CRATE.mesh()))]
    points = np.random.default_rng(1).uniform((3, -0.2, 0), (5, 1, 2), (200, 3))
    assert np.allclose(*(thing.distance_exact(points) for thing in things))
    assert things[0].distance_exact(np.array([CRATE.center]))[0] == pytest.approx(-0.4)


def test_what_stands_on_the_floor_or_sticks_in_a_wall_has_no_surface_there() -> None:
    standing, stuck = Box((2.0, 0.4, 2.0), (1.0, 0.8, 1.0)), Box((0.0, 1.0, 1.0), (1.0, 0.8, 0.8))
    for facing in (Mesh, inverted):
        parts = [box.mesh() if facing is Mesh else inverted(box.mesh()) for box in (standing, stuck)]
        scene = scene_of(inverted(ROOM.mesh()), *parts)
        where = np.array([[2.0, 0.05, 2.0], [0.1, 1.0, 1.0], [0.45, 1.0, 1.0], [1.2, 0.3, 2.0]])
        assert scene.distance_exact(where).tolist() == pytest.approx([-0.5, -0.4, -0.05, 0.3])
        assert_free(scene, free_in(POINTS, standing, stuck))


def test_a_shell_turned_inside_out_keeps_its_hollow() -> None:
    hollow = together(Box((0, 0, 0), (2, 2, 2)).mesh(), inverted(Box((0, 0, 0), (1.6, 1.6, 1.6)).mesh()))
    where = np.array([[0.0, 0, 0], [0.9, 0, 0], [1.2, 0, 0]])
    for mesh in (hollow, inverted(hollow)):
        scene = Scene([mesh], cache=None, resolution=32, free_space="outside")
        assert np.sign(scene.distance_exact(where)).tolist() == [1, -1, 1]


@pytest.mark.parametrize("degrees", [8, 11, 15, 35])
def test_a_tilted_block_is_no_room(degrees: float) -> None:
    import trimesh

    turn = trimesh.transformations.rotation_matrix(np.radians(degrees), (0, 0, 1))[:3, :3]
    block = Box((0, 0, 0), (5, 5, 5)).mesh()
    assert bake(Mesh(block.vertices @ turn.T, block.faces, "block"), 24, cache=None).rule == "outside"


def test_closed_and_open_rooms_in_one_mesh_are_free_both() -> None:
    open_room = without(inverted(fine(ROOM)), 1, 2.6)
    beside = Box((9.0, 1.3, 2.0), (5.0, 2.6, 4.0))
    scene = scene_of(open_room, inverted(fine(beside)))
    where = np.array([[2.5, 1.0, 2.0], [9.0, 1.0, 2.0], [2.5, -0.08, 2.0], [9.0, -0.08, 2.0]])
    assert np.sign(scene.distance(torch.from_numpy(where)).numpy()).tolist() == [1, 1, -1, -1]
    assert np.sign(scene.distance_exact(where)).tolist() == [1, 1, -1, -1]


@pytest.mark.parametrize("seed", range(4))
def test_the_scorer_takes_sides_as_the_grid_does_in_soups(seed: int) -> None:
    # Where triangles lie anyhow, winding numbers and rays contradict each other at one point in ten.
    rng = np.random.default_rng(seed)
    corners = rng.uniform(-1, 1, (150, 1, 3)) + rng.uniform(-0.4, 0.4, (150, 3, 3))
    torn = fine(Box((0, 0, 0), (1.2, 1.2, 1.2)), 0.3)
    torn = Mesh(torn.vertices, torn.faces[rng.random(len(torn.faces)) > 0.3])
    soup = together(Mesh(corners.reshape(-1, 3), np.arange(450).reshape(-1, 3)), torn)
    scene = Scene([soup], cache=None, resolution=64)
    points = rng.uniform(-1.2, 1.2, (2000, 3))
    grid, exact = scene.distance(torch.from_numpy(points)).numpy(), scene.distance_exact(points)
    far, near = np.abs(exact) > 2 * scene.bakes[0].grid.spacing, np.abs(exact) > 0.5 * scene.bakes[0].grid.spacing
    assert (np.sign(grid) == np.sign(exact))[far].all() and (np.sign(grid) == np.sign(exact))[near].mean() > 0.97


# -------------------------------------------------------------------------------------------------------------- seeds


def test_a_seed_in_a_room_within_a_solid_frees_that_room_only() -> None:
    outer, room = Box((0, 0, 0), (6, 6, 6)), Box((1, 0, 0), (3, 3, 3))
    scene = Scene([together(outer.mesh(), room.mesh())], cache=None, resolution=48, free_space=(1.0, 0.2, 0.1))
    where = np.array([[1.0, 0, 0], [-1.5, 0, 0], [3.05, 0, 0]])
    assert np.sign(scene.distance_exact(where)).tolist() == [1, -1, -1]
    assert np.sign(scene.distance(torch.from_numpy(where)).numpy()).tolist() == [1, -1, -1]


def test_a_seed_is_free_against_the_rays_too() -> None:
    # A tube that is open at both ends: two of three rays say that its inside is solid.
    tube = without(without(fine(Box((0, 0, 0), (1, 1, 1)), 0.2), 1, 0.5), 1, -0.5)
    scene = Scene([tube], cache=None, resolution=48, free_space=(0.1, 0.05, -0.1))
    assert float(scene.distance(torch.tensor([0.1, 0.05, -0.1]))) > 0
    assert scene.distance_exact(np.array([[0.1, 0.05, -0.1]]))[0] > 0


def anything(rng: np.random.Generator) -> Mesh:
    """A soup, a torn box, a heap of boxes that face anyhow, or a room full of holes."""
    kind = rng.integers(4)
    if kind == 0:
        corners = rng.uniform(-1, 1, (60, 1, 3)) + rng.uniform(-0.6, 0.6, (60, 3, 3))
        return Mesh(corners.reshape(-1, 3), np.arange(180).reshape(-1, 3))
    if kind == 1:
        torn = fine(Box((0, 0, 0), tuple(rng.uniform(0.5, 3, 3))), 0.4)
        kept = rng.random(len(torn.faces)) > rng.uniform(0, 0.5)
        return Mesh(torn.vertices, torn.faces[kept][:, :: rng.choice([1, -1])])
    if kind == 2:
        boxes = [Box(rng.uniform(-1, 1, 3).tolist(), rng.uniform(0.3, 2, 3).tolist(), k) for k in range(4)]
        return together(*(box.mesh() if rng.random() < 0.5 else inverted(box.mesh()) for box in boxes))
    room = inverted(fine(ROOM, 0.9))
    holes = Mesh(room.vertices, room.faces[rng.random(len(room.faces)) > rng.uniform(0, 0.4)])
    return together(holes, TABLE.mesh(), inverted(CRATE.mesh()))


@given(st.integers(0, 2**32 - 1))
@settings(max_examples=40, deadline=None)
def test_a_seed_is_always_free(seed: int) -> None:
    rng = np.random.default_rng(seed)
    mesh = anything(rng)
    point = rng.uniform(*mesh.bounds)
    try:
        scene = Scene([mesh], cache=None, resolution=32, free_space=tuple(point))
        exact = scene.distance_exact(point[None])[0]
    except UserError as error:
        assert "lies on a surface" in str(error)
        return
    assert exact > 0
    if exact > scene.bakes[0].grid.spacing:
        assert float(scene.distance(torch.from_numpy(point))) > 0


def test_a_mesh_that_leaves_nothing_free_is_refused_and_one_without_inside_is_in_doubt() -> None:
    floor = without(without(inverted(fine(ROOM)), 1, 2.6), 0, 5.0)
    for axis, value in ((0, 0.0), (2, 0.0), (2, 4.0)):
        floor = without(floor, axis, value)
    assert any("encloses nothing" in doubt for doubt in bake(floor, 32, cache=None).doubts)
    small = inverted(fine(Box((0, 0, 0), (0.3, 0.3, 0.3)), 0.04))
    with pytest.raises(UserError, match="leaves no free space"):
        bake(Mesh(small.vertices, small.faces[1:]), 8, padding=2.0, cache=None)


@pytest.mark.parametrize("facing", [1, -1])
def test_solids_alone_are_solid_whichever_way_they_face(facing: int) -> None:
    chair = [Box((0, 0.45, 0), (0.5, 0.06, 0.5)), Box((0, 0.8, -0.22), (0.5, 0.7, 0.05))]
    slab, walls = Box((0, -0.1, 0), (6, 0.2, 6)), [Box((x, 1.3, 0), (0.3, 2.6, 6)) for x in (-3, 3)]
    for boxes in (chair, [*chair, slab], [slab, *walls]):
        for turned_ in range(1, len(boxes) + 1):
            parts = [box.mesh() if facing > 0 or n >= turned_ else inverted(box.mesh()) for n, box in enumerate(boxes)]
            scene = Scene([together(*parts)], cache=None, resolution=48)
            points = np.random.default_rng(2).uniform((-3.1, -0.15, -3.1), (3.1, 2.7, 3.1), (300, 3))
            expected = free_in(points, *boxes, room=None)
            exact = scene.distance_exact(points)
            assert ((exact > 0) == (expected > 0))[np.abs(expected) > 1e-3].all()
            assert scene.bakes[0].rule == "outside" and bool(scene.doubts) >= (facing < 0)


@pytest.mark.parametrize("facing", [1, -1])
def test_a_house_with_thick_walls_may_be_turned_as_a_whole(facing: int) -> None:
    outer, inner = Box((2.5, 1.3, 2.0), (5.4, 3.0, 4.4)), ROOM
    house = together(outer.mesh(), inverted(inner.mesh()), TABLE.mesh())
    scene = Scene([house if facing > 0 else inverted(house)], cache=None, resolution=64)
    where = torch.from_numpy(POINTS)
    expected = torch.minimum(
        torch.maximum(outer.distance(where), -inner.distance(where)), TABLE.distance(where)
    ).numpy()
    assert_free(scene, expected, clear=0.1)


def test_pieces_that_share_a_corner_or_an_edge_are_told_apart() -> None:
    room = inverted(fine(ROOM, 2.0))
    for cupboard in (Box((0.3, 1.0, 0.5), (0.6, 2.0, 1.0)), Box((0.3, 1.0, 2.5), (0.6, 2.0, 1.0))):
        assert_free(scene_of(room, inverted(cupboard.mesh())), free_in(POINTS, cupboard))
    crates = [Box((0.5, 0.5, 0.5), (1, 1, 1)), Box((1.5, 0.5, 1.5), (1, 1, 1)), Box((0, -0.1, 0), (8, 0.2, 8))]
    scene = scene_of(crates[0].mesh(), inverted(crates[1].mesh()), crates[2].mesh())
    assert_free(scene, free_in(POINTS, *crates, room=None))


@pytest.mark.parametrize("parts", [1, 60])
def test_a_cut_away_room_is_the_same_however_finely_it_is_cut(parts: int) -> None:
    shell = without(without(inverted(fine(ROOM, 5.5 / parts)), 1, 2.6), 2, 0.0)
    scene = Scene([shell], cache=None, resolution=48)
    assert scene.bakes[0].signs.kind == "open"
    where = torch.tensor([[2.5, 1.0, 2.0], [2.5, 3.4, 2.0], [2.5, 1.0, -0.5], [2.5, -0.05, 2.0], [-0.05, 1.0, 2.0]])
    assert scene.distance(where).sign().tolist() == [1, 1, 1, -1, -1]


def test_rooms_keep_their_floor_above_large_patches_and_on_open_ground() -> None:
    patch = Mesh(np.array([[-10.0, 0, -10], [-10, 0, 14], [15, 0, 14], [15, 0, -10]]), np.array([[0, 1, 2], [0, 2, 3]]))
    room = inverted(fine(ROOM))
    air, around = torch.tensor([[2.5, 1.0, 2.0]]), torch.tensor([[10.0, 1.0, 2.0]])
    for height in (-1.5, 4.0):
        scene = scene_of(room, Mesh(patch.vertices + np.array([0, height, 0]), patch.faces))
        assert scene.bakes[0].inward and float(scene.distance(air)) > 0 and scene.floor.height == pytest.approx(0.0)
    scene = scene_of(room, patch)
    assert float(scene.distance(air)) > 0 and float(scene.distance(around)) > 0
    assert any("encloses nothing" in doubt for doubt in scene.doubts)


def test_what_has_two_sides_encloses_as_with_one() -> None:
    room, table = inverted(fine(ROOM)), fine(TABLE, 0.3)
    for parts in ((room, inverted(room), TABLE.mesh()), (room, table, inverted(table))):
        assert_free(scene_of(*parts), free_in(POINTS, TABLE))


def test_a_second_room_that_faces_outward_is_told() -> None:
    beside = Box((9.0, 1.3, 2.0), (3.0, 2.6, 4.0))
    assert any("outward beside rooms" in doubt for doubt in scene_of(inverted(ROOM.mesh()), beside.mesh()).doubts)


# ------------------------------------------------------------------------------------------------------- shared cases


def test_shared_cases_of_signs(shared: Path) -> None:
    cases = shared / "cases" / "geometry"
    nested = Scene([load_mesh(cases / "overlapping_solids/nested.ply")], cache=None)
    points = np.array([[1, 1, 1.0], [1, 1, 0.8], [1, 1, 0.4]])
    assert nested.distance_exact(points).tolist() == pytest.approx([-1, -0.8, -0.4], abs=1e-6)
    assert nested.distance(torch.from_numpy(points)).tolist() == pytest.approx([-1, -0.8, -0.4], abs=0.01)
    flipped = Scene([load_mesh(cases / "flipped_wall_oracle/wallflip.ply")], cache=None, resolution=64)
    assert_free(flipped, free_in(POINTS))
    for rule in ("auto", (2.5, 1.0, 2.0)):
        dollhouse = Scene([load_mesh(cases / "dollhouse/dollhouse.ply")], cache=None, free_space=rule)
        where = np.array([[2.5, 1.0, 2.0], [4.9, 0.1, 0.1], [2.5, -0.05, 2.0]])
        assert np.sign(dollhouse.distance_exact(where)).tolist() == [1, 1, -1]
        assert np.sign(dollhouse.distance(torch.from_numpy(where)).numpy()).tolist() == [1, 1, -1]
    backward = load_mesh(cases / "reversed_room/reversed.ply")
    assert any("standing room" in doubt for doubt in bake(backward, 64, cache=None).doubts)
    assert_free(Scene([backward], cache=None, resolution=64, free_space=(2.5, 1.3, 2.0)), free_in(POINTS))


@pytest.mark.parametrize("name", ["living_room", "office_large"])
def test_scans_are_the_same_room_whichever_way_they_face(shared: Path, name: str) -> None:
    mesh = load_mesh(shared / "data" / "meshes" / f"{name}.ply")
    ceiling = mesh.triangles[:, :, 1].mean(axis=1) > mesh.bounds[1, 1] - 0.3
    wall = mesh.triangles[:, :, 0].mean(axis=1) < mesh.bounds[0, 0] + 0.25
    plain = Scene([mesh], cache=None, resolution=96)
    points = np.random.default_rng(0).uniform(mesh.bounds[0], mesh.bounds[1] - [0, 0.6, 0], (400, 3))
    expected = plain.distance_exact(points)
    cut = Mesh(mesh.vertices, mesh.faces[~ceiling], name)
    for variant in (inverted(mesh), turned(mesh, wall), cut, inverted(cut)):
        scene = Scene([variant], cache=None, resolution=96)
        sure = np.abs(expected) > 2 * scene.bakes[0].grid.spacing
        assert (np.sign(scene.distance_exact(points)) == np.sign(expected))[sure].mean() > 0.99
        assert (np.sign(scene.distance(torch.from_numpy(points)).numpy()) == np.sign(expected))[sure].mean() > 0.99
