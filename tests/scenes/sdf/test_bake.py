"""Baking: each trap that other tools fell into, and the oracle (libigl) against every kind of mesh."""

from __future__ import annotations

import importlib
import os
from pathlib import Path

import igl
import numpy as np
import pytest
import torch
import trimesh
from hypothesis import given, settings, strategies as st

from scenes.errors import UserError
from scenes.mesh.csg import csg
from scenes.mesh.mesh import Mesh, load_mesh
from scenes.mesh.primitives import Box, Capsule, Cylinder, Sphere
from scenes.sdf.accuracy import impossible_flips, measure
from scenes.sdf.bake import Bake, bake
from scenes.sdf.distances import FAR_ERROR
from scenes.sdf.grid import SdfGrid
from scenes.sdf.lattice import Lattice
from scenes.world.scene import bundled

baking = importlib.import_module("scenes.sdf.bake")  # `import scenes.sdf.bake as` would give the function of that name


def joined(*meshes: Mesh) -> Mesh:
    starts = np.cumsum([0] + [len(mesh.vertices) for mesh in meshes])
    faces = [mesh.faces + start for mesh, start in zip(meshes, starts, strict=False)]
    return Mesh(np.concatenate([mesh.vertices for mesh in meshes]), np.concatenate(faces), "joined")


def inverted(mesh: Mesh) -> Mesh:
    return Mesh(mesh.vertices, mesh.faces[:, ::-1], f"inverted {mesh.name}")


def nodes_of(result: Bake) -> np.ndarray:
    shape = result.grid.values.shape
    return result.grid.nodes(np.stack(np.meshgrid(*map(np.arange, shape), indexing="ij"), axis=-1).reshape(-1, 3))


def values_at(result: Bake, *points: tuple[float, float, float]) -> list[float]:
    return result.grid.distance(torch.tensor(points, dtype=torch.float64)).tolist()


def raw_distance(mesh: Mesh, points: np.ndarray) -> np.ndarray:
    squared, _, _ = igl.point_mesh_squared_distance(points, mesh.vertices, mesh.faces)
    return np.sqrt(squared)


def assert_distances(values: np.ndarray, exact: np.ndarray, spacing: float, near: float) -> None:
    """Within `near` (m) up to two voxels from the surface; beyond never too small, and too large by sqrt(3) voxels.

    Beyond two voxels distances are measured in single precision.
    """
    error = np.abs(values) - np.abs(exact)
    close = np.abs(exact) <= 2 * spacing
    assert close.any() and np.abs(error[close]).max() < near
    assert error.min() > -max(near, 1e-4 * spacing)
    assert error.max() <= FAR_ERROR * spacing


def assert_alike(found: Bake, expected: Bake, near: float) -> None:
    """Two bakes of one shape: within `near` (m) up to two voxels from it; beyond, what each may differ by."""
    a, b = found.grid.values.numpy(), expected.grid.values.numpy()
    close = np.abs(b) <= 2 * expected.grid.spacing
    assert np.abs(a - b)[close].max() < near and np.abs(a - b).max() <= FAR_ERROR * expected.grid.spacing


ROOM = Box((0.3, 1.25, -0.2), (4.0, 2.5, 3.0))
TABLE = Box((1.0, 0.7, 0.0), (0.8, 0.4, 1.1))
SHELF = Cylinder((-1.0, 1.0, -0.8), 0.3, 1.3)


def room_scan() -> Mesh:
    """What a headset records: walls that face the air, furniture that faces it too."""
    return joined(inverted(ROOM.mesh()), TABLE.mesh(), SHELF.mesh())


def soup(n: int = 150, seed: int = 3) -> Mesh:
    rng = np.random.default_rng(seed)
    corners = rng.uniform(-1, 1, (n, 1, 3)) + rng.uniform(-0.3, 0.3, (n, 3, 3))
    return Mesh(corners.reshape(-1, 3), np.arange(3 * n).reshape(-1, 3), "soup")


OVERLAP = (Box((0, 0, 0), (1, 1, 1)), Box((0.4, 0.4, 0.4), (1, 1, 1), yaw=0.2))

CLOSED = {
    "box": Box((0.1, 0.2, 0.3), (1.0, 0.7, 1.3), yaw=0.4).mesh(),
    "capsule": Capsule((0, 0, 0), (0.4, 1.0, -0.3), 0.3).mesh(),
    "csg": csg("difference", Box((0, 0, 0), (1, 1, 1)), Sphere((0.3, 0.3, 0.3), 0.5), Cylinder((0, 0, 0), 0.2, 3)),
    "plate": Box((0, 0, 0), (2.0, 0.01, 1.0), yaw=0.3).mesh(),  # far thinner than a voxel
    "overlap": joined(*(box.mesh() for box in OVERLAP)),
    "hollow": joined(Box((0, 0, 0), (2, 2, 2)).mesh(), inverted(Box((0, 0, 0), (1.8, 1.8, 1.8)).mesh())),
}


@pytest.mark.parametrize("resolution", [16, 33, 50])
def test_nodes_are_where_the_grid_says_at_every_resolution(resolution: int) -> None:
    # A grid half a voxel off, or scaled by n / (n - 1), fails at once: the box's distance is known in closed form.
    box = Box((0.37, -0.11, 0.83), (1.1, 0.52, 0.77))
    result = bake(box.mesh(), resolution, cache=None)
    exact = box.distance(torch.from_numpy(nodes_of(result))).numpy()
    assert_distances(result.grid.values.numpy().reshape(-1), exact, result.grid.spacing, 1e-6)
    assert max(result.grid.values.shape) == resolution
    # Beside a face the distance is linear, which the interpolant reproduces: at any resolution, without bias.
    beside = torch.tensor([[0.37 + 0.55 + d, -0.11, 0.83] for d in (-0.09, -0.02, 0.0, 0.031, 0.08)])
    assert result.grid.distance(beside).tolist() == pytest.approx([-0.09, -0.02, 0.0, 0.031, 0.08], abs=2e-6)


def test_sphere_against_its_formula() -> None:
    mesh = trimesh.creation.icosphere(subdivisions=4, radius=0.8)
    result = bake(Mesh(mesh.vertices, mesh.faces), 24, cache=None)
    exact = Sphere((0, 0, 0), 0.8).distance(torch.from_numpy(nodes_of(result))).numpy()
    assert_distances(result.grid.values.numpy().reshape(-1), exact, result.grid.spacing, 2e-3)  # the chords' sag


def test_padding_and_cubic_voxels() -> None:
    result = bake(Box((0, 0, 0), (2.0, 1.0, 0.5)).mesh(), 23, padding=0.1, cache=None)
    assert result.grid.spacing == pytest.approx(2.2 / 22)
    low, high = result.grid.bounds
    assert (low <= np.array([-1.1, -0.6, -0.35]) + 1e-9).all() and (high >= np.array([1.1, 0.6, 0.35]) - 1e-9).all()
    assert np.allclose(low, -high)


@pytest.mark.parametrize("name", CLOSED)
def test_closed_meshes_agree_with_the_oracle_at_every_node(name: str) -> None:
    mesh = CLOSED[name]
    result = bake(mesh, 24, cache=None)
    points, values = nodes_of(result), result.grid.values.numpy().reshape(-1)
    boundary = csg("union", *OVERLAP) if name == "overlap" else mesh
    exact = raw_distance(boundary, points)
    assert_distances(values, exact, result.grid.spacing, 1e-5 * result.grid.spacing)
    solid = igl.winding_number(mesh.vertices, mesh.faces, points) > 0.5
    clear = exact > 1e-6
    assert ((values < 0) == solid)[clear].all()
    assert impossible_flips(result.grid) == 0
    assert result.closed and result.boundary_edges == 0 and result.rule == "outside" and not result.inward


@given(
    st.lists(st.tuples(*[st.floats(-1, 1)] * 3, *[st.floats(0.05, 0.9)] * 3, st.floats(0, 3)), min_size=1, max_size=4)
)
@settings(max_examples=15, deadline=None)
def test_any_heap_of_boxes_is_its_union(heap: list[tuple[float, ...]]) -> None:
    boxes = [Box(values[:3], values[3:6], values[6]) for values in heap]
    result = bake(joined(*(box.mesh() for box in boxes)), 12, cache=None)
    points = torch.from_numpy(nodes_of(result))
    union = torch.stack([box.distance(points) for box in boxes]).amin(0).numpy()
    values = result.grid.values.numpy().reshape(-1)
    clear = np.abs(union) > 1e-5
    assert ((values > 0) == (union > 0))[clear].all()
    exact = raw_distance(csg("union", *boxes), points.numpy())  # depth in the union, not to surfaces within it
    assert_distances(values, exact, result.grid.spacing, 1e-5)
    assert impossible_flips(result.grid) == 0


def test_the_air_of_a_room_scan_is_free_and_all_else_is_solid() -> None:
    mesh = room_scan()
    result = bake(mesh, 40, cache=None)
    assert (result.rule, result.inward, result.closed) == ("inside", True, True)
    assert "faces inward" in result.message and "\n" not in result.message
    points = torch.from_numpy(nodes_of(result))
    room = torch.minimum(-ROOM.distance(points), torch.minimum(TABLE.distance(points), SHELF.distance(points)))
    values = result.grid.values.numpy().reshape(-1)
    clear = room.abs().numpy() > 0.01
    assert ((values > 0) == (room.numpy() > 0))[clear].all()
    assert_distances(values[room.numpy() > 0], room.numpy()[room.numpy() > 0], result.grid.spacing, 5e-3)
    assert impossible_flips(result.grid) == 0


def test_beyond_the_grid_a_room_stays_solid_and_an_object_free() -> None:
    outside = [(9.0, 1.0, 0.0), (0.0, -4.0, 0.0), (30.0, 30.0, 30.0)]
    assert all(value < -1 for value in values_at(bake(room_scan(), 16, cache=None), *outside))
    assert all(value > 1 for value in values_at(bake(ROOM.mesh(), 16, cache=None), *outside))


def test_a_room_with_a_few_holes_keeps_its_air() -> None:
    wall = trimesh.Trimesh(ROOM.mesh().vertices, ROOM.mesh().faces).subdivide_to_size(0.25)
    mesh = inverted(Mesh(wall.vertices, np.delete(wall.faces, [10, 200, 700], axis=0), "leaky"))
    result = bake(mesh, 40, cache=None)
    assert result.rule == "inside" and not result.closed and result.boundary_edges == 9
    assert "nearly closed, 9 boundary edges" in result.message
    exact = ROOM.distance(torch.from_numpy(nodes_of(result))).numpy()
    values = result.grid.values.numpy().reshape(-1)
    clear = np.abs(exact) > 0.3  # in a hole itself both answers are right
    assert ((values > 0) == (exact < 0))[clear].all()


def test_an_open_room_without_ceiling_is_free_inside() -> None:
    walls = inverted(ROOM.mesh())
    ceiling = (walls.triangles[:, :, 1] > 2.4).all(axis=1)
    assert ceiling.sum() == 2
    result = bake(Mesh(walls.vertices, walls.faces[~ceiling]), 24, cache=None)
    assert result.rule == "inside"
    inside, below, beside = values_at(result, (0.3, 1.0, -0.2), (0.3, -0.09, -0.2), (2.39, 1.0, -0.2))
    assert inside > 0 > max(below, beside)


@pytest.mark.parametrize("facing", [1, -1])
def test_single_sheets_are_never_solid(facing: int) -> None:
    corners = np.array([[-2.0, 0, -2], [2, 0, -2], [2, 0, 2], [-2, 0, 2]])
    floor = Mesh(corners, np.array([[0, 2, 1], [0, 3, 2]])[:, ::facing], "floor")
    wall = Mesh(corners[:, [1, 0, 2]] + [-2.0, 2.0, 0], np.array([[0, 1, 2], [0, 2, 3]])[:, ::facing], "wall")
    for mesh in (floor, joined(floor, wall)):
        result = bake(mesh, 16, padding=0.5, cache=None)
        assert result.rule == "outside" and not result.closed
        values = result.grid.values.numpy().reshape(-1)
        points = nodes_of(result)
        exact = raw_distance(mesh, points)
        assert_distances(values, exact, result.grid.spacing, 1e-5)
        assert (values[exact > 1e-6] > 0).all()  # not even behind the corner, where the winding number exceeds 1/2


def test_distances_on_a_soup_are_exact_and_its_signs_never_contradict_them() -> None:
    # Distances of libigl's fast winding number are up to two voxels off on soups; point-to-mesh distances are not.
    mesh = soup()
    result = bake(mesh, 24, cache=None)
    points, values = nodes_of(result), result.grid.values.numpy().reshape(-1)
    assert_distances(values, raw_distance(mesh, points), result.grid.spacing, 1e-5)
    winding = igl.winding_number(mesh.vertices, mesh.faces, points)
    follow = Bake(
        SdfGrid(
            torch.from_numpy(np.where(winding > 0.5, -1, 1) * np.abs(values)).reshape(result.grid.values.shape).float(),
            result.grid.origin,
            result.grid.spacing,
        ),
        result.rule,
        result.signs,
        False,
        "",
    )
    assert impossible_flips(result.grid) < impossible_flips(follow.grid) / 2
    assert result.signs.confidence is not None and result.signs.confidence.shape == tuple(result.grid.values.shape)
    assert "uncertain" in result.summary


def test_a_torn_box_stays_solid_inside() -> None:
    # Every triangle apart, with cracks all round and a whole triangle missing: what game levels are like.
    box = trimesh.Trimesh(TABLE.mesh().vertices, TABLE.mesh().faces).subdivide_to_size(0.2)
    centre = box.triangles.mean(axis=1, keepdims=True)
    corners = (centre + 0.97 * (box.triangles - centre))[1:]
    mesh = Mesh(corners.reshape(-1, 3), np.arange(3 * len(corners)).reshape(-1, 3), "torn")
    result = bake(mesh, 48, cache=None)
    exact = TABLE.distance(torch.from_numpy(nodes_of(result))).numpy()
    values = result.grid.values.numpy().reshape(-1)
    clear = np.abs(exact) > 0.1
    assert ((values > 0) == (exact > 0))[clear].all()


def test_rays_count_the_winding_number_of_closed_meshes_however_nodes_meet_edges() -> None:
    # Faces, edges and corners on the very lines of nodes: a ray that counted an edge twice or not at all would show.
    heap = joined(Box((0.5, 0.5, 0.5), (1, 1, 1)).mesh(), Box((1.0, 0.5, 0.5), (1, 1, 1)).mesh())
    lattice = Lattice((-0.25, -0.25, -0.25), 0.125, (21, 13, 13))
    result = bake(heap, cache=None, lattice=lattice)
    points, values = nodes_of(result), result.grid.values.numpy().reshape(-1)
    inside = ((points > 0) & (points < [1.5, 1, 1])).all(axis=1)
    clear = np.abs(values) > 1e-6
    assert ((values < 0) == inside)[clear].all() and clear.mean() > 0.5


@pytest.mark.parametrize("threads", [1, 2, 5])
def test_threads_do_not_change_a_bit(threads: int) -> None:
    for mesh in (room_scan(), soup()):
        assert torch.equal(
            bake(mesh, 30, cache=None, threads=threads).grid.values, bake(mesh, 30, cache=None).grid.values
        )


@pytest.mark.parametrize("scale", [1e-3, 1.0, 1e4])
def test_any_scale_and_rotation(scale: float) -> None:
    turn = trimesh.transformations.random_rotation_matrix(np.array([0.3, 0.8, 0.1]))[:3, :3]
    mesh = Mesh(scale * CLOSED["csg"].vertices @ turn.T, CLOSED["csg"].faces, "turned")
    result = bake(mesh, 24, cache=None, lattice=Lattice.around(mesh.bounds, 24, 0.1 * scale))
    points, values = nodes_of(result), result.grid.values.numpy().reshape(-1)
    exact = raw_distance(mesh, points)
    assert_distances(values, exact, result.grid.spacing, 1e-4 * result.grid.spacing)
    solid = igl.winding_number(mesh.vertices, mesh.faces, points) > 0.5
    assert ((values < 0) == solid)[exact > 1e-5 * scale].all()


def test_a_single_triangle_is_exact_and_encloses_nothing() -> None:
    mesh = Mesh(np.array([[0.0, 0, 0], [1, 0, 0.2], [0.1, 0.9, 0]]), np.array([[0, 1, 2]]), "one")
    result = bake(mesh, 20, cache=None)
    values = result.grid.values.numpy().reshape(-1)
    assert_distances(values, raw_distance(mesh, nodes_of(result)), result.grid.spacing, 1e-6)
    assert (values >= 0).mean() > 0.97


@pytest.mark.parametrize("facing", [1, -1])
def test_walls_without_thickness_can_be_given_one(facing: int) -> None:
    corners = np.array([[0.0, 0, -1], [0, 0, 1], [0, 2, 1], [0, 2, -1]])
    wall = Mesh(corners, np.array([[0, 1, 2], [0, 2, 3]])[:, ::facing], "wall")
    both = joined(wall, inverted(wall))
    thin, block = Box((0, 1, 0), (0.02, 2, 2)).mesh(), Box((0.0, 1.0, 0.0), (0.6, 2.0, 2.0)).mesh()
    for mesh in (wall, both, thin):
        result = bake(mesh, 40, padding=0.3, cache=None, thickness=0.2, free_space="outside")
        middle, beside = values_at(result, (0.0, 1.0, 0.0), (0.2, 1.0, 0.0))
        assert middle == pytest.approx(-0.1, abs=result.grid.spacing / 2 + 1e-6)  # the wall may lie between two nodes
        assert beside == pytest.approx(0.1 - mesh.bounds[1, 0], abs=1e-6)
    plain = bake(block, 40, cache=None)
    assert torch.equal(bake(block, 40, cache=None, thickness=0.2).grid.values, plain.grid.values)


def test_a_lattice_that_misses_the_mesh_is_refused() -> None:
    with pytest.raises(UserError, match="reaches beyond the lattice"):
        bake(Box((0, 0, 0), (1, 1, 1)).mesh(), cache=None, lattice=Lattice((0.0, 0.0, 0.0), 0.1, (9, 9, 9)))


def test_solids_are_not_inflated() -> None:
    # Recipes that thicken the surface turn a hollow shell solid and a room's air negative.
    shell = bake(CLOSED["hollow"], 40, cache=None)
    assert values_at(shell, (0, 0, 0))[0] == pytest.approx(0.9, abs=shell.grid.spacing)
    solid = (shell.grid.values.numpy() < 0).mean() * np.prod(np.array(shell.grid.values.shape) - 1)
    assert solid * shell.grid.spacing**3 == pytest.approx(2.0**3 - 1.8**3, rel=0.25)
    plate = bake(CLOSED["plate"], 32, cache=None)
    assert (plate.grid.values > 0).float().mean() > 0.95


def test_rules_for_an_object_that_faces_inward() -> None:
    mesh = inverted(Box((0, 0, 0), (1, 1, 1)).mesh())
    centre, corner = (0.0, 0.0, 0.0), (0.58, 0.58, 0.58)
    for rule, signs, name in [
        ("auto", (-1, 1), "outside"),  # nobody fits in, so that it is no room
        ("outside", (-1, 1), "outside"),
        (corner, (-1, 1), "seed"),
        (centre, (1, -1), "seed"),
    ]:
        result = bake(mesh, 16, free_space=rule, cache=None)
        assert result.rule == name, rule
        assert np.sign(values_at(result, centre, corner)).tolist() == list(signs)
        assert name in ("inside", "outside") or "seed" in result.message
    assert bake(inverted(Box((0, 0, 0), (1.5, 1.2, 1.5)).mesh()), 16, cache=None).rule == "inside"


def test_a_seed_frees_the_air_of_a_room_drawn_with_outward_walls() -> None:
    # Winding numbers: 1 in the air, 2 in the furniture, 0 outside.
    mesh = joined(ROOM.mesh(), TABLE.mesh())
    air, inside_table, outside = (-1.0, 1.0, 0.5), (1.0, 0.7, 0.0), (0.3, 2.58, 0.0)
    result = bake(mesh, 24, free_space=air, cache=None)
    assert np.sign(values_at(result, air, inside_table, outside)).tolist() == [1, -1, -1]
    assert result.grid.beyond == -1
    result = bake(mesh, 24, free_space="auto", cache=None)
    assert np.sign(values_at(result, air, inside_table, outside)).tolist() == [-1, -1, 1]


def test_repeated_and_collapsed_triangles_change_nothing() -> None:
    clean = CLOSED["csg"]
    rng = np.random.default_rng(0)
    copies = clean.faces[rng.integers(0, len(clean.faces), 50)]
    turned = np.roll(clean.faces[:20], 1, axis=1)
    points = np.repeat(clean.faces[:10, :1], 3, axis=1)
    lines = clean.faces[:10][:, [0, 1, 1]]
    middle = len(clean.vertices) + np.arange(len(clean.faces))
    slivers = np.stack([clean.faces[:, 0], clean.faces[:, 1], middle], axis=1)  # no area: between an edge's ends
    centres = clean.triangles[:, :2].mean(axis=1)
    apart = Mesh(  # and every triangle with corners of its own, as STL files have them
        clean.triangles.reshape(-1, 3), np.arange(3 * len(clean.faces)).reshape(-1, 3)
    )
    dirty = Mesh(
        np.concatenate([clean.vertices, centres]),
        np.concatenate([clean.faces, copies, turned, points, lines, slivers]),
        "dirty",
    )
    expected = bake(clean, 24, cache=None)
    for mesh in (dirty, apart):
        found = bake(mesh, 24, cache=None)
        assert_alike(found, expected, 1e-6)
        assert torch.equal(found.grid.values > 0, expected.grid.values > 0)
    assert bake(apart, 8, cache=None).closed


def test_a_mesh_far_from_the_origin_is_as_exact() -> None:
    shift = np.array([4e5, 12.0, -3e6])
    near, far = CLOSED["csg"], Mesh(CLOSED["csg"].vertices + shift, CLOSED["csg"].faces)
    a, b = bake(near, 24, cache=None), bake(far, 24, cache=None)
    assert_alike(b, a, 1e-5)
    assert np.allclose(b.grid.origin.numpy() - shift, a.grid.origin.numpy(), atol=1e-6)


@pytest.mark.parametrize("name", ["living_room", "office_large"])
def test_real_scans_meet_the_oracle(shared: Path, name: str) -> None:
    mesh = load_mesh(shared / "data" / "meshes" / f"{name}.ply")
    result = bake(mesh, 64, cache=None)
    found = measure(result, mesh, samples=1500)
    assert found.near_error_voxels < 0.01 and found.far_error_voxels < FAR_ERROR
    assert found.sign_errors == 0 and found.impossible_flips == 0
    assert result.rule == "inside" and result.boundary_edges == {"living_room": 15, "office_large": 0}[name]
    middle = mesh.bounds.mean(axis=0)
    middle[1] = mesh.bounds[1, 1] - 0.4  # under the ceiling there is no furniture
    above = middle + np.array([0, 3.0, 0])
    inside, outside = values_at(result, tuple(middle), tuple(above))
    assert inside > 0 > outside


# ------------------------------------------------------------------------------------------------------ input errors


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"resolution": 7}, "resolution is 7; give a whole number of nodes from 8 to 512"),
        ({"resolution": 513}, "resolution is 513"),
        ({"padding": -0.1}, "padding is -0.1"),
        ({"padding": float("nan")}, "padding is nan"),
        ({"free_space": "outsid"}, "did you mean 'outside'"),
        ({"free_space": (0.0, 0.0)}, "give three numbers"),
        ({"free_space": (0.0, float("nan"), 0.0)}, "finite"),
        ({"free_space": (0.0, 5.0, 0.0)}, r"seed \(0, 5, 0\) lies outside mesh"),
        ({"free_space": (0.5, 0.1, 0.2)}, "lies on a surface"),
    ],
)
def test_bad_arguments_are_one_sentence(arguments: dict[str, object], message: str) -> None:
    with pytest.raises(UserError, match=message) as caught:
        bake(Box((0, 0, 0), (1, 1, 1)).mesh(), **{"resolution": 8, "cache": None, **arguments})  # type: ignore[arg-type]
    assert "\n" not in str(caught.value)


def test_a_mesh_without_area_is_refused() -> None:
    line = Mesh(np.array([[0.0, 0, 0], [1, 0, 0], [2, 0, 0]]), np.array([[0, 1, 2]]), "line")
    with pytest.raises(UserError, match="mesh 'line' has only triangles without area"):
        bake(line, 8, cache=None)


# ------------------------------------------------------------------------------------------------------------- cache


def no_baking(monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(*_: object) -> np.ndarray:
        raise AssertionError("baked again")

    monkeypatch.setattr(baking, "unsigned", refuse)


def test_the_cache_returns_the_same_bake(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    mesh = room_scan()
    first = bake(mesh, 12, cache=tmp_path)
    no_baking(monkeypatch)
    again = bake(mesh, 12, cache=tmp_path)
    assert torch.equal(first.grid.values, again.grid.values) and torch.equal(first.grid.origin, again.grid.origin)
    for name in ("rule", "closed", "boundary_edges", "inward", "message", "doubts"):
        assert getattr(first, name) == getattr(again, name)
    assert (first.grid.spacing, first.grid.beyond) == (again.grid.spacing, again.grid.beyond)


@pytest.mark.parametrize(
    "change", [{"resolution": 13}, {"padding": 0.2}, {"free_space": "outside"}, {"mesh": TABLE.mesh()}]
)
def test_whatever_changes_the_result_changes_the_key(
    change: dict[str, object], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    arguments = {"mesh": room_scan(), "resolution": 12, "cache": tmp_path}
    bake(**arguments)  # type: ignore[arg-type]
    no_baking(monkeypatch)
    with pytest.raises(AssertionError, match="baked again"):
        bake(**{**arguments, **change})  # type: ignore[arg-type]


@pytest.mark.parametrize("damage", ["cut", "flipped", "empty", "pickle", "other key", "nan"])
def test_damaged_cache_files_are_baked_again_and_replaced(damage: str, tmp_path: Path) -> None:
    mesh = TABLE.mesh()
    good = bake(mesh, 12, cache=tmp_path)
    (path,) = tmp_path.iterdir()
    content = path.read_bytes()
    with np.load(path) as data:
        arrays = dict(data)
    if damage == "cut":
        path.write_bytes(content[: len(content) // 2])
    elif damage == "flipped":
        middle = content.index(b"values.npy") + 600
        path.write_bytes(content[:middle] + bytes([content[middle] ^ 0x55]) + content[middle + 1 :])
    elif damage == "empty":
        path.write_bytes(b"")
    else:
        wrong = {"pickle": {"values": np.array([{}], dtype=object)}, "other key": {"key": np.array("x")}}
        nan = {"values": np.full_like(arrays["values"], np.nan)}
        np.savez(path, **{**arrays, **wrong.get(damage, nan)})
    again = bake(mesh, 12, cache=tmp_path)
    assert torch.equal(again.grid.values, good.grid.values)
    assert path.read_bytes() == content and list(tmp_path.iterdir()) == [path]


def test_a_cache_that_cannot_be_written_costs_a_warning_only(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("in the way")
    with pytest.warns(UserWarning, match="could not be cached"):
        result = bake(TABLE.mesh(), 8, cache=tmp_path / "file")
    assert result.rule == "outside"


def test_the_default_cache_is_the_stated_folder() -> None:
    assert baking.default_cache() == Path(os.environ["SCENECTL_CACHE"]) / "bakes"
    bake(SHELF.mesh(), 8)
    assert any(baking.default_cache().glob("*.npz"))


# ---------------------------------------------------------------------------------------------------------- accuracy


def test_the_measure_sees_what_is_wrong() -> None:
    mesh = CLOSED["csg"]
    result = bake(mesh, 20, cache=None)
    found = measure(result, mesh, samples=3000)
    assert found.near_error_voxels < 1e-4 and found.sign_errors == 0 and found.impossible_flips == 0
    assert found.near_nodes > 1000 and set(found.row()) >= {"near_error_voxels", "sign_errors"}
    result.grid.values[:] += 0.05 * result.grid.spacing
    assert measure(result, mesh, samples=3000).near_error_voxels == pytest.approx(0.05, rel=0.01)
    result.grid.values[:] *= -1
    wrong = measure(result, mesh, samples=3000)
    assert wrong.sign_errors > 2000
    result.grid.values[0] *= -1
    assert measure(result, mesh, samples=100).impossible_flips > 100


def test_slivers_are_measured_as_exactly_as_any_triangle() -> None:
    """Single-precision tools are millimetres off on long thin triangles, which CAD walls with windows are full of."""
    mesh = bundled("living_room").meshes[0]
    result = bake(mesh, 128, cache=None)
    found = measure(result, mesh, samples=10_000)
    assert found.near_error_voxels < 0.01
    assert found.sign_errors == 0
    assert found.impossible_flips == 0
