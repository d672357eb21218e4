"""Walls thinner than a voxel: what crosses them is seen, or the bake has said that it may not be."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest
import torch
import trimesh
from hypothesis import given, settings, strategies as st
from torch import Tensor

from scenes.mesh.csg import csg
from scenes.mesh.mesh import Mesh, load_mesh
from scenes.mesh.primitives import Box, Cylinder
from scenes.sdf.bake import Bake, bake
from scenes.sdf.bake_blocks import bake_blocks
from scenes.sdf.grid import SdfGrid
from scenes.sdf.lattice import Lattice
from scenes.world.contact import swept_clearance
from scenes.world.scene import Scene, bundled, bundled_names

VOXEL = 0.05
turns = st.tuples(*[st.floats(0.0, 1.0)] * 3).map(
    lambda u: np.asarray(trimesh.transformations.random_rotation_matrix(np.array(u))[:3, :3])
)
offsets = st.tuples(*[st.floats(0.0, 1.0)] * 3).map(np.array)


def pane(thickness: float, turn: np.ndarray, shift: np.ndarray) -> Mesh:
    """A wall of 0.9 x 0.8 m across z, turned and moved by a part of a voxel."""
    box = Box((0.0, 0.0, 0.0), (0.9, 0.8, thickness)).mesh()
    return Mesh(box.vertices @ turn.T + VOXEL * shift, box.faces, "pane")


def sheet(turn: np.ndarray, shift: np.ndarray) -> Mesh:
    corners = np.array([[-0.45, -0.4, 0.0], [0.45, -0.4, 0.0], [0.45, 0.4, 0.0], [-0.45, 0.4, 0.0]])
    return Mesh(corners @ turn.T + VOXEL * shift, np.array([[0, 1, 2], [0, 2, 3]]), "sheet")


def crossed(result: Bake[SdfGrid], turn: np.ndarray, shift: np.ndarray, radius: float, seed: int = 0) -> Tensor:
    """Room that small balls have on straight ways through the middle of a wall, from either side."""
    rng = np.random.default_rng(seed)
    middle = np.concatenate([rng.uniform(-0.2, 0.2, (64, 2)), np.zeros((64, 1))], axis=1)
    way = rng.normal(size=(64, 3)) * 0.3
    way[:, 2] = rng.choice([-1.0, 1.0], 64)
    way *= 0.2 / np.linalg.norm(way, axis=1, keepdims=True)
    a, b = (torch.from_numpy((middle + sign * way) @ turn.T + VOXEL * shift) for sign in (-1, 1))
    return swept_clearance(result.grid, a, a, b, b, radius, tolerance=1e-5)


def baked(mesh: Mesh, thickness: float = 0.0) -> Bake[SdfGrid]:
    """On nodes at whole multiples of the voxel, wherever the mesh is."""
    low, high = np.floor(mesh.bounds[0] / VOXEL) - 5, np.ceil(mesh.bounds[1] / VOXEL) + 5
    shape = tuple((high - low + 1).astype(int).tolist())
    lattice = Lattice(tuple((VOXEL * low).tolist()), VOXEL, shape)  # type: ignore[arg-type]
    return bake(mesh, cache=None, lattice=lattice, thickness=thickness)


@given(st.floats(0.1, 2.0), turns, offsets)
@settings(max_examples=40, deadline=None)
def test_a_crossing_is_found_or_announced(voxels: float, turn: np.ndarray, shift: np.ndarray) -> None:
    thickness = voxels * VOXEL
    result = baked(pane(thickness, turn, shift))
    seen = crossed(result, turn, shift, radius=0.0)
    assert (seen <= max(VOXEL - thickness, 0) / 2 + 2e-5).all()  # as far as an interpolant is off within a wall
    if thickness < 0.98 * VOXEL:
        (doubt,) = result.doubts
        assert "pane" in doubt and re.search(r"wall [\d.]+ mm thick", doubt)
        unseen = float(re.findall(r"thinner than ([\d.e+]+) mm may", doubt)[0]) / 1e3
        assert (crossed(result, turn, shift, radius=0.51 * unseen + 2e-5) < 0).all()
    elif thickness > 1.02 * VOXEL:
        assert not result.doubts and (seen < 0).all()


@given(turns, offsets)
@settings(max_examples=10, deadline=None)
def test_a_sheet_is_announced_and_with_the_thickness_that_would_do_found(turn: np.ndarray, shift: np.ndarray) -> None:
    result = baked(sheet(turn, shift))
    (doubt,) = result.doubts
    assert "encloses nothing" in doubt and "state thickness" in doubt
    assert (crossed(result, turn, shift, radius=0.51 * VOXEL) < 0).all()
    again = baked(sheet(turn, shift), thickness=0.051)
    assert not again.doubts and (crossed(again, turn, shift, radius=0.0) < 0).all()


@pytest.mark.parametrize("thickness", [0.004, 0.015, 0.03])
def test_the_spacing_that_would_do_does(thickness: float) -> None:
    turn, shift = np.asarray(trimesh.transformations.euler_matrix(0.4, 1.0, 0.2)[:3, :3]), np.array([0.3, 0.1, 0.7])
    mesh = pane(thickness, turn, shift)
    scene = Scene([mesh], resolution=24, cache=None)
    (doubt,) = scene.doubts
    spacing = float(re.findall(r"state spacing = ([\d.]+)", doubt)[0])
    assert 0.8 * thickness < spacing < thickness
    if spacing > 0.01:
        fine = bake(mesh, cache=None, lattice=Lattice.spaced(mesh.bounds, spacing, 0.1))
        assert not fine.doubts and (crossed(fine, turn, shift, radius=0.0) < 0).all()
    sparse = bake_blocks(mesh, spacing, cache=None)
    assert not sparse.doubts and (crossed(sparse, turn, shift, radius=0.0) < 0).all()  # type: ignore[arg-type]
    (again,) = bake_blocks(mesh, 2 * thickness, cache=None).doubts
    assert f"{1e3 * thickness:.2g} mm thick" in again


def test_only_walls_with_air_on_both_sides_count() -> None:
    room = Box((0.0, 1.25, 0.0), (4.0, 2.5, 3.0)).mesh()
    inward = Mesh(room.vertices, room.faces[:, ::-1], "room")
    assert not bake(inward, 64, cache=None).doubts
    rug = csg("union", Box((0, 0.05, 0), (3, 0.1, 3)), Box((0.2, 0.1, 0.3), (1.5, 0.01, 1.1)))
    assert not bake(rug, 64, cache=None).doubts
    loose = [Box((0, 0.05, 0), (3, 0.1, 3)).mesh(), Box((0.2, 0.105, 0.3), (1.5, 0.01, 1.1)).mesh()]
    assert not bake(joined(*loose), 64, cache=None).doubts  # lies on it, and is no part of it
    wedge = Cylinder((0, 0.5, 0), 0.5, 1.0).mesh()
    assert not bake(wedge, 32, cache=None).doubts


def test_partitions_in_a_room_are_announced_whichever_way_they_face() -> None:
    room = Box((0.0, 1.25, 0.0), (4.0, 2.5, 3.0)).mesh()
    for turned in (1, -1):
        wall = Box((0.3, 1.0, 0.2), (0.01, 1.6, 1.9)).mesh()
        mesh = joined(Mesh(room.vertices, room.faces[:, ::-1]), Mesh(wall.vertices, wall.faces[:, ::turned]))
        (doubt,) = (doubt for doubt in bake(mesh, 64, cache=None).doubts if "unseen" in doubt)
        assert "10 mm thick" in doubt and "state spacing = 0.009" in doubt


def joined(*meshes: Mesh) -> Mesh:
    starts = np.cumsum([0] + [len(mesh.vertices) for mesh in meshes])
    faces = [mesh.faces + start for mesh, start in zip(meshes, starts, strict=False)]
    return Mesh(np.concatenate([mesh.vertices for mesh in meshes]), np.concatenate(faces), "joined")


@pytest.mark.parametrize("name", bundled_names())
def test_bundled_scenes_raise_no_doubt(name: str) -> None:
    assert not bundled(name).doubts


@pytest.mark.parametrize("name", ["living_room", "office_large"])
def test_scans_raise_no_doubt(shared: Path, name: str) -> None:
    assert not bake(load_mesh(shared / "data" / "meshes" / f"{name}.ply"), cache=None).doubts
