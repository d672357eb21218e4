"""Assemblies: edits leave no trace, distances hold what a bake promises, and what was handed out stays as it was."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
import torch
from hypothesis import given, settings, strategies as st

import scenes.world.assembly
from scenes.errors import UserError
from scenes.mesh.mesh import Mesh
from scenes.mesh.primitives import Box, Capsule, Cylinder, Sphere
from scenes.sdf.bake import bake
from scenes.sdf.distances import BAND, FAR_ERROR
from scenes.sdf.lattice import Lattice
from scenes.world.assembly import Assembly

LATTICE = Lattice((-2.2, -0.2, -1.7), 0.1, (45, 30, 35))


@pytest.fixture(autouse=True, scope="module")
def _small_tiles() -> Iterator[None]:
    """Tiles so small that most of a small lattice's are passed over."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(scenes.world.assembly, "TILE", 4)
        yield


def inverted(mesh: Mesh) -> Mesh:
    return Mesh(mesh.vertices, mesh.faces[:, ::-1], mesh.name)


def soup() -> Mesh:
    rng = np.random.default_rng(3)
    corners = rng.uniform(-0.5, 0.5, (12, 1, 3)) + rng.uniform(-0.3, 0.3, (12, 3, 3))
    return Mesh(corners.reshape(-1, 3), np.arange(36).reshape(-1, 3), "soup")


ROOM = inverted(Box((0, 1.25, 0), (4.0, 2.5, 3.0)).mesh())
SHAPES = {
    "box": Box((0, 0, 0), (0.5, 0.4, 0.8)).mesh(),
    "ball": Sphere((0, 0, 0), 0.4).mesh(),
    "rod": Capsule((0, 0, 0), (0.4, 0.8, -0.3), 0.07).mesh(),
    "plate": Box((0, 0, 0), (1.1, 0.01, 0.6)).mesh(),  # thinner than a voxel
    "soup": soup(),
    "long": Cylinder((0, 0, 0), 0.2, 2.6).mesh(),  # longer than half the lattice
}


def pose(x: float = 0.0, y: float = 0.0, z: float = 0.0, turn: float = 0.0, tilt: float = 0.0) -> np.ndarray:
    c, s, cc, ss = np.cos(turn), np.sin(turn), np.cos(tilt), np.sin(tilt)
    matrix = np.eye(4)
    matrix[:3, :3] = np.array([[c, 0, s], [0, 1, 0], [-s, 0, c]]) @ np.array([[1, 0, 0], [0, cc, -ss], [0, ss, cc]])
    matrix[:3, 3] = x, y, z
    return matrix


def bits(assembly: Assembly) -> np.ndarray:
    return assembly.grid.values.numpy().view(np.int32).copy()


def nodes(lattice: Lattice) -> np.ndarray:
    return lattice.nodes(np.stack(np.meshgrid(*map(np.arange, lattice.shape), indexing="ij"), axis=-1))


WHOLE = st.integers(-12, 12).map(lambda n: n * LATTICE.spacing)
PLACE = st.one_of(
    st.builds(pose, WHOLE, WHOLE, WHOLE),  # by whole voxels: the tie of every tie
    st.builds(pose, *[st.floats(-2.5, 2.5)] * 3, st.floats(-4, 4), st.floats(-4, 4)),  # also beyond the lattice
)
EDIT = st.tuples(st.sampled_from(["add", "move", "move", "remove"]), st.sampled_from(list(SHAPES)), PLACE)


@settings(max_examples=15, deadline=None)
@given(st.booleans(), st.lists(EDIT, min_size=1, max_size=7))
def test_edits_leave_no_trace(indoors: bool, edits: list[tuple[str, str, np.ndarray]]) -> None:
    scene = Assembly({"room": ROOM} if indoors else {"post": SHAPES["rod"]}, LATTICE)
    before = bits(scene)
    for what, name, where in edits:
        if what == "add" and name not in scene.names:
            box = scene.add(name, SHAPES[name], where)
        elif what == "move" and name in scene.names:
            box = scene.move(name, where)
        elif what == "remove" and name in scene.names:
            box = scene.remove(name)
        else:
            continue
        after = bits(scene)
        changed = np.argwhere(after != before)
        assert (changed >= box[0]).all() and (changed < box[1]).all()
        before = after
    assert np.array_equal(before, bits(scene.full()))


def test_the_only_object_may_move_and_the_first_may_go() -> None:
    scene = Assembly({"ball": SHAPES["ball"]}, LATTICE)
    scene.move("ball", pose(0.3, 1.0, 0.2))
    assert np.array_equal(bits(scene), bits(scene.full()))
    scene.add("room", ROOM)
    scene.remove("ball")
    assert scene.names == ("room",)
    assert np.array_equal(bits(scene), bits(Assembly({"room": ROOM}, LATTICE)))


def test_order_and_threads_do_not_change_a_bit() -> None:
    placed = {"room": ROOM, **SHAPES}
    backwards = dict(reversed(placed.items()))
    assert np.array_equal(bits(Assembly(placed, LATTICE, threads=1)), bits(Assembly(backwards, LATTICE, threads=3)))


def assert_distances(found: np.ndarray, exact: np.ndarray, spacing: float) -> None:
    error = np.abs(found) - np.abs(exact)
    close = np.abs(exact) <= BAND * spacing
    assert close.any() and np.abs(error[close]).max() < 1e-5
    assert error.min() > -1e-5
    assert error.max() <= FAR_ERROR * spacing
    assert (np.sign(found) == np.sign(exact))[np.abs(exact) > 1e-5].all()


def test_outdoors_every_node_is_as_good_as_a_bakes() -> None:
    shapes = [
        Box((-1.5, 0.3, -1.0), (0.4, 0.6, 0.5), yaw=0.3),
        Box((1.6, 2.2, 1.2), (0.3, 0.2, 0.3)),
        Box((3.5, 0.5, 0.0), (0.5, 0.5, 0.5), yaw=1.0),  # beyond the lattice, and felt on it
    ]
    scene = Assembly({str(i): shape.mesh() for i, shape in enumerate(shapes)}, LATTICE)
    points = torch.from_numpy(nodes(LATTICE))
    exact = torch.stack([shape.distance(points) for shape in shapes])
    assert [(exact.argmin(dim=0) == i).any() for i in range(3)] == [True] * 3
    assert_distances(scene.grid.values.numpy(), exact.amin(dim=0).numpy(), LATTICE.spacing)
    assert scene.grid.beyond == 1


def test_indoors_walls_and_furniture_are_solid() -> None:
    room, shelf = Box((0, 1.25, 0), (4.0, 2.5, 3.0)), Box((-1.0, 0.7, 0.5), (0.8, 0.4, 0.6), yaw=0.2)
    scene = Assembly({"room": inverted(room.mesh()), "shelf": Box((0, 0, 0), (0.8, 0.4, 0.6)).mesh()}, LATTICE)
    scene.move("shelf", pose(-1.0, 0.7, 0.5, turn=0.2))
    points = torch.from_numpy(nodes(LATTICE))
    exact = torch.minimum(-room.distance(points), shelf.distance(points)).numpy()
    assert_distances(scene.grid.values.numpy(), exact, LATTICE.spacing)
    assert scene.grid.beyond == -1
    assert np.allclose(scene.mesh("shelf").bounds, shelf.mesh().bounds)
    assert np.array_equal(scene.pose("room"), np.eye(4))


def test_one_object_is_its_own_bake() -> None:
    scene = Assembly({"long": SHAPES["long"]}, 40)
    assert scene.lattice == Lattice.around(SHAPES["long"].bounds, 40, 0.1)
    inside = bake(SHAPES["long"], 40, cache=None).grid.values
    assert (scene.grid.values - inside).abs().max() <= FAR_ERROR * scene.lattice.spacing
    near = inside.abs() <= BAND * scene.lattice.spacing
    assert torch.allclose(scene.grid.values[near], inside[near], atol=1e-6)


def test_a_grid_that_was_handed_out_stays_as_it_was() -> None:
    scene = Assembly({"room": ROOM, "box": SHAPES["box"]}, LATTICE)
    held = scene.grid
    before = held.values.clone()
    scene.move("box", pose(0.5, 0.9, 0.4))
    assert torch.equal(held.values, before)
    assert not torch.equal(scene.grid.values, before)


def test_a_seed_applies_to_the_objects_that_hold_it() -> None:
    room = Box((0, 1.25, 0), (4.0, 2.5, 3.0)).mesh()  # faces outward: its air is free only because the seed says so
    scene = Assembly({"room": room, "box": SHAPES["box"]}, LATTICE, free_space=(1.5, 1.0, 0.5))
    at = torch.tensor([[1.5, 1.0, 0.5], [0.0, 0.1, 0.0]])
    assert [d > 0 for d in scene.grid.distance(at).tolist()] == [True, False]


def test_a_cache_holds_single_objects(tmp_path: Path) -> None:
    first = Assembly({"room": ROOM, "box": SHAPES["box"]}, LATTICE, cache=tmp_path)
    assert len(list(tmp_path.glob("*.npz"))) == 2
    assert np.array_equal(bits(first), bits(Assembly({"room": ROOM, "box": SHAPES["box"]}, LATTICE, cache=tmp_path)))


@pytest.mark.parametrize(
    ("edit", "message"),
    [
        (lambda scene: scene.move("bux", pose()), "no object 'bux'; did you mean 'box'?"),
        (lambda scene: scene.add("box", SHAPES["ball"]), "already has an object 'box'"),
        (lambda scene: scene.move("box", 2 * pose()), "scales, shears or mirrors"),
        (lambda scene: scene.move("box", np.diag([1.0, 1.0, -1.0, 1.0])), "scales, shears or mirrors"),
        (lambda scene: scene.move("box", np.eye(3)), "shape \\(3, 3\\)"),
        (lambda scene: scene.move("box", pose(np.nan)), "finite"),
        (lambda scene: scene.add("flat", Mesh(np.zeros((3, 3)), np.array([[0, 1, 2]]))), "triangles without area"),
        (lambda scene: (scene.remove("room"), scene.remove("box")), "last object"),
    ],
)
def test_what_cannot_be_done_is_said_and_changes_nothing(edit, message: str) -> None:  # type: ignore[no-untyped-def]
    scene = Assembly({"room": ROOM, "box": SHAPES["box"]}, LATTICE)
    with pytest.raises(UserError, match=message):
        edit(scene)
    assert np.array_equal(bits(scene), bits(scene.full()))


def test_an_assembly_of_nothing_is_refused() -> None:
    with pytest.raises(UserError, match="no objects"):
        Assembly({}, LATTICE)
