"""Blocks against the dense grid they stand for: distances, signs, continuity, gradients, files."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import torch
import trimesh

from scenes.errors import UserError
from scenes.mesh.csg import csg
from scenes.mesh.mesh import Mesh
from scenes.mesh.primitives import Box, Capsule, Cylinder, Sphere
from scenes.mesh.surface import Surface
from scenes.sdf.bake import bake, sided
from scenes.sdf.bake_blocks import bake_blocks
from scenes.sdf.blocks import SdfBlocks
from scenes.sdf.lattice import Lattice
from scenes.world.scene import Scene

SPACING = 0.02


def joined(*meshes: Mesh) -> Mesh:
    starts = np.cumsum([0] + [len(mesh.vertices) for mesh in meshes])
    faces = [mesh.faces + start for mesh, start in zip(meshes, starts, strict=False)]
    return Mesh(np.concatenate([mesh.vertices for mesh in meshes]), np.concatenate(faces), "joined")


ROOM = Box((0.0, 0.6, 0.0), (2.4, 1.2, 2.0)).mesh()
INSIDE_OUT = Mesh(ROOM.vertices, ROOM.faces[:, ::-1], "room")


def torn(mesh: Mesh, size: float, share: float) -> Mesh:
    """The same surface in small triangles with cracks all round, as game levels have them."""
    fine = trimesh.Trimesh(mesh.vertices, mesh.faces).subdivide_to_size(size)
    centre = fine.triangles.mean(axis=1, keepdims=True)
    corners = centre + share * (fine.triangles - centre)
    return Mesh(corners.reshape(-1, 3), np.arange(3 * len(corners)).reshape(-1, 3), "torn")


MESHES = {
    "solid": csg("difference", Box((0, 0.5, 0), (1.3, 1.0, 0.9), yaw=0.3), Sphere((0.3, 0.9, 0.2), 0.4)),
    "room": joined(
        INSIDE_OUT, Box((0.4, 0.3, 0.2), (0.5, 0.6, 0.4), yaw=0.5).mesh(), Cylinder((-0.6, 0.4, 0), 0.2, 0.8).mesh()
    ),
    "thin wall": joined(
        Box((0, 0.5, 0), (0.04, 1.0, 1.4), yaw=0.2).mesh(), Capsule((0.6, 0.3, 0), (0.6, 0.8, 0.1), 0.1).mesh()
    ),
    "torn": torn(Box((0.4, 0.3, 0.2), (1.1, 0.8, 0.9)).mesh(), 0.2, 0.97),
}


@pytest.fixture(scope="module")
def baked() -> dict[str, SdfBlocks]:
    return {name: bake_blocks(mesh, SPACING, cache=None).grid for name, mesh in MESHES.items()}


def near(mesh: Mesh, reach: float, n: int = 3000, seed: int = 0) -> np.ndarray:
    rng = np.random.default_rng(seed)
    corners = mesh.triangles[rng.integers(0, len(mesh.faces), n)]
    return np.einsum("nk,nkc->nc", rng.dirichlet(np.ones(3), n), corners) + rng.uniform(-reach, reach, (n, 3))


def inside(field: SdfBlocks, points: np.ndarray) -> np.ndarray:
    low, high = field.bounds
    return points[((points > low) & (points < high)).all(axis=1)]


@pytest.mark.parametrize("name", MESHES)
def test_near_surfaces_blocks_are_the_dense_grid(name: str, baked: dict[str, SdfBlocks]) -> None:
    field, mesh = baked[name], MESHES[name]
    corner = field.bounds[0]
    lattice = Lattice(tuple(corner.tolist()), SPACING, field.shape)
    dense = bake(mesh, cache=None, lattice=lattice).grid
    points = torch.from_numpy(inside(field, near(mesh, 2 * SPACING)))
    found, expected = field.distance(points), dense.distance(points)
    error = (found - expected).abs() / SPACING
    close = expected.abs() < 2 * SPACING
    # The tolerance at the nodes, and more in a few cells beside coarser ones, which rule on the faces they share.
    assert error[close].mean() < 0.06 and error[close].quantile(0.99) < 0.6
    clear = expected.abs() > 0.3 * SPACING
    assert ((found > 0) == (expected > 0))[clear].float().mean() > 0.9995
    exact = sided(mesh, "auto", lattice).surface.unsigned_distance(points.numpy())  # none under what stands on a floor
    assert np.abs(np.abs(found.numpy()) - exact)[exact < 2 * SPACING].mean() < 0.1 * SPACING


@pytest.mark.parametrize("name", MESHES)
def test_far_from_surfaces_signs_hold_and_distances_are_those_of_coarse_nodes(
    name: str, baked: dict[str, SdfBlocks]
) -> None:
    field, mesh = baked[name], MESHES[name]
    points = np.random.default_rng(1).uniform(*field.bounds, (4000, 3))
    exact = Surface.of(mesh).unsigned_distance(points)
    found = field.distance(torch.from_numpy(points)).numpy()
    assert np.abs(np.abs(found) - exact).max() < 8 * SPACING
    dense = bake(mesh, cache=None, lattice=Lattice(tuple(field.bounds[0].tolist()), SPACING, field.shape)).grid
    sign = dense.distance(torch.from_numpy(points)).numpy() > 0
    assert (sign == (found > 0))[exact > SPACING].mean() > 0.9995


def test_the_interpolant_is_continuous_across_all_borders(baked: dict[str, SdfBlocks]) -> None:
    for field in baked.values():
        rng = np.random.default_rng(2)
        cells = np.array(field.index.shape)
        border = rng.uniform(0, cells, (20_000, 3))
        axis = rng.integers(0, 3, len(border))
        rows = np.arange(len(border))
        border[rows, axis] = rng.integers(1, cells[axis])  # on the face between two coarse cells
        step = np.zeros_like(border)
        step[rows, axis] = 1e-7
        width = 8 * field.spacing
        sides = [torch.from_numpy(field.bounds[0] + width * (border + sign * step)) for sign in (1, -1)]
        jump = (field.distance(sides[0]) - field.distance(sides[1])).abs()
        assert jump.max() < 2.5e-3 * field.spacing  # the step of what is stored is 1/1024 voxel


def test_gradients_are_exact_and_come_once(baked: dict[str, SdfBlocks]) -> None:
    field = baked["thin wall"]
    points = torch.from_numpy(near(MESHES["thin wall"], 0.3, 60)).requires_grad_()
    assert torch.autograd.gradcheck(field.distance, (points,), eps=1e-7, atol=1e-5)
    (first,) = torch.autograd.grad(field.distance(points).sum(), points, create_graph=True)
    with pytest.raises(RuntimeError, match="cannot be differentiated again"):
        first.sum().backward()
    value, gradient = field.value_and_gradient(points)
    assert torch.equal(value, field.distance(points)) and torch.equal(gradient, first)


def test_any_batch_type_and_number_of_threads(baked: dict[str, SdfBlocks], monkeypatch: pytest.MonkeyPatch) -> None:
    field = baked["room"]
    points = torch.from_numpy(near(MESHES["room"], 0.4, 240))
    whole = field.distance(points)
    assert torch.equal(field.distance(points.reshape(4, 6, 10, 3)).reshape(-1), whole)
    torch.testing.assert_close(field.distance(points.float()), whole.float(), atol=1e-5, rtol=1e-5)
    loop = torch.stack([field.distance(point) for point in points[:20]])
    assert torch.equal(loop, whole[:20])
    assert field.distance(points[:0]).shape == (0,)
    monkeypatch.setattr("scenes.sdf.grid.ENOUGH", 10)
    monkeypatch.setattr(torch, "get_num_threads", lambda: 5)
    assert torch.equal(field.distance(points), whole)
    strange = torch.tensor([[float("nan"), 0, 0], [float("inf"), 0, 0], [1e30, 0, 0]])
    assert not torch.isfinite(field.distance(strange)[:2]).any()


def test_the_slope_bound_holds_between_any_two_points(baked: dict[str, SdfBlocks]) -> None:
    for name, field in baked.items():
        a = torch.from_numpy(near(MESHES[name], 0.2, 5000))
        b = a + 0.01 * torch.nn.functional.normalize(torch.from_numpy(near(MESHES[name], 1.0, 5000, seed=4)), dim=-1)
        slope = (field.distance(a) - field.distance(b)).abs() / 0.01
        assert 0.9 < slope.max() <= field.lipschitz


def test_outside_it_is_what_a_dense_grid_gives_for_the_same_border(baked: dict[str, SdfBlocks]) -> None:
    for name in ("solid", "room"):
        field = baked[name]
        low, high = torch.from_numpy(field.bounds)
        points = torch.from_numpy(np.random.default_rng(3).uniform(low - 3, high + 3, (2000, 3)))
        nearest = points.clamp(low, high)
        away, v = (points - nearest).norm(dim=-1), field.distance(nearest)
        free = (v > 0) & (field.beyond > 0)
        beside = 2 * field.outer_margin * (points - nearest).abs().sum(-1)
        expected = torch.where(free, (away.square() + v.square() + beside).sqrt(), v + field.beyond * away)
        assert field.outer_margin == pytest.approx(0.1, abs=0.3) if field.beyond > 0 else field.outer_margin == 0
        torch.testing.assert_close(field.distance(points), expected, atol=1e-9, rtol=0)
        p = points[:50].clone().requires_grad_()
        assert torch.autograd.gradcheck(field.distance, (p,), eps=1e-7, atol=1e-5)


def test_threads_do_not_change_a_bit() -> None:
    for name in ("room", "torn"):
        one, many = (bake_blocks(MESHES[name], 0.05, cache=None, threads=n).grid.arrays() for n in (1, 3))
        assert all(np.array_equal(one[key], many[key]) for key in one)


def test_files_and_cache_return_the_same_blocks(tmp_path: Path, baked: dict[str, SdfBlocks]) -> None:
    field = baked["solid"]
    field.save(tmp_path / "a.npz")
    again = SdfBlocks.load(tmp_path / "a.npz")
    points = torch.from_numpy(near(MESHES["solid"], 0.3, 100))
    assert torch.equal(again.distance(points), field.distance(points))
    first = bake_blocks(MESHES["solid"], 0.05, cache=tmp_path / "cache")
    (path,) = (tmp_path / "cache").iterdir()
    content = path.read_bytes()
    second = bake_blocks(MESHES["solid"], 0.05, cache=tmp_path / "cache")
    assert torch.equal(first.grid.distance(points), second.grid.distance(points)) and first.summary == second.summary
    path.write_bytes(content[: len(content) // 2])
    bake_blocks(MESHES["solid"], 0.05, cache=tmp_path / "cache")
    assert path.read_bytes() == content


@pytest.mark.parametrize("damage", ["missing", "index", "nan", "cut", "pickle"])
def test_unsound_files_are_refused(damage: str, tmp_path: Path, baked: dict[str, SdfBlocks]) -> None:
    arrays = baked["solid"].arrays()
    if damage == "index":
        arrays["index"] = arrays["index"] + 3_000_000  # would read far beyond the blocks
    elif damage == "nan":
        arrays["coarse"] = np.full_like(arrays["coarse"], np.nan)
    elif damage == "pickle":
        arrays["origin"] = np.array([{}], dtype=object)
    path = tmp_path / "field.npz"
    if damage != "missing":
        np.savez(path, **arrays)
    if damage == "cut":
        path.write_bytes(path.read_bytes()[:1000])
    with pytest.raises(UserError, match=r"does not exist|do not exist|bake again"):
        SdfBlocks.load(path)


def test_scenes_of_a_stated_spacing(monkeypatch: pytest.MonkeyPatch) -> None:
    mesh = MESHES["solid"]
    dense = Scene([mesh], spacing=0.05, cache=None)
    assert dense.bakes[0].grid.spacing == pytest.approx(0.05) and not isinstance(dense.bakes[0].grid, SdfBlocks)
    monkeypatch.setattr("scenes.world.scene.DENSE", 1000)
    large = Scene([mesh], spacing=0.05, cache=None)
    assert isinstance(large.bakes[0].grid, SdfBlocks) and large.digest == dense.digest
    points = torch.from_numpy(near(mesh, 0.1, 400))
    assert (large.distance(points) - dense.distance(points)).abs().mean() < 0.01
    with pytest.raises(UserError, match="too large for walls to be given a thickness"):
        _ = Scene([mesh], spacing=0.05, thickness=0.1, cache=None).bakes
    with pytest.raises(UserError, match="spacing is -1"):
        Scene([mesh], spacing=-1)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"spacing": 0.0}, "spacing is 0"),
        ({"spacing": float("nan")}, "spacing is nan"),
        ({"spacing": 1e-4}, "GB without its details; give"),
        ({"spacing": 0.1, "tolerance": 2.0}, "tolerance is 2.0; give 0 to 1"),
        ({"spacing": 0.1, "free_space": "insid"}, "unknown free-space rule"),
    ],
)
def test_bad_arguments_are_one_sentence(arguments: dict[str, object], message: str) -> None:
    with pytest.raises(UserError, match=message):
        bake_blocks(MESHES["solid"], cache=None, **arguments)  # type: ignore[arg-type]
