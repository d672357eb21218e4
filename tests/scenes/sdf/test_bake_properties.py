"""Baking of generated meshes: whatever is drawn, distances and signs are those of closed forms or of the oracle."""

from __future__ import annotations

from functools import reduce

import igl
import numpy as np
import pytest
import torch
import trimesh
from hypothesis import given, settings, strategies as st

from scenes.errors import UserError
from scenes.mesh.csg import csg
from scenes.mesh.mesh import Mesh
from scenes.mesh.primitives import Box
from scenes.sdf.bake import Bake, bake
from scenes.sdf.distances import FAR_ERROR
from scenes.sdf.lattice import Lattice

numbers = st.floats(-1.0, 1.0, allow_nan=False)
boxes = st.builds(
    lambda centre, size, yaw: Box(centre, size, yaw),
    st.tuples(numbers, numbers, numbers),
    st.tuples(*[st.floats(0.1, 0.9)] * 3),
    st.floats(0.0, 3.0),
)
turns = st.tuples(*[st.floats(0.0, 1.0)] * 3).map(
    lambda u: np.asarray(trimesh.transformations.random_rotation_matrix(np.array(u))[:3, :3])
)
scales = st.floats(-3.0, 4.0).map(lambda power: 10.0**power)


def nodes(result: Bake) -> np.ndarray:  # type: ignore[type-arg]
    index = np.stack(np.meshgrid(*map(np.arange, result.grid.values.shape), indexing="ij"), axis=-1)
    return np.asarray(result.grid.nodes(index.reshape(-1, 3)))


def values(result: Bake) -> np.ndarray:  # type: ignore[type-arg]
    return np.asarray(result.grid.values.numpy().reshape(-1))


def check(result: Bake, unsigned: np.ndarray, solid: np.ndarray | None, size: float) -> None:  # type: ignore[type-arg]
    """Exact within two voxels, within the bound beyond, and the right sign wherever a node is off the surface."""
    found, voxel = values(result), result.grid.spacing
    error = np.abs(found) - unsigned
    near = unsigned <= 2 * voxel
    assert np.abs(error[near]).max(initial=0.0) < 1e-5 * voxel + 1e-6 * size
    assert error.min() > -1e-4 * voxel - 1e-6 * size and error.max() <= FAR_ERROR * voxel
    if solid is not None:
        clear = unsigned > 1e-4 * voxel + 1e-6 * size
        assert ((found < 0) == solid)[clear].all()


@given(st.lists(boxes, min_size=1, max_size=4), st.one_of(st.none(), boxes))
@settings(max_examples=20, deadline=None)
def test_unions_and_differences_of_boxes_follow_their_formulas(solids: list[Box], hole: Box | None) -> None:
    mesh = csg("union", *solids)
    if hole is not None:
        try:
            mesh = csg("difference", mesh, hole)
        except UserError:  # nothing is left
            return
    result = bake(mesh, 16, cache=None)
    points = torch.from_numpy(nodes(result))
    union = reduce(torch.minimum, (box.distance(points) for box in solids)).numpy()
    if hole is None:
        outside = union > 0
        found = values(result)
        assert (np.abs(found - union)[outside & (union <= 2 * result.grid.spacing)] < 1e-5).all()
        assert ((found - union)[outside] <= FAR_ERROR * result.grid.spacing).all()
        solid = union < 0
    else:
        carved = hole.distance(points).numpy()
        solid = (union < 0) & (carved > 0)
        union = np.where(np.abs(union) < np.abs(carved), union, carved)
    squared, _, _ = igl.point_mesh_squared_distance(nodes(result), mesh.vertices, mesh.faces)
    unsigned = np.sqrt(squared)
    clear = np.abs(union) > 1e-5  # a node on the plane of a face may go either way
    check(result, unsigned, None, 2.0)
    assert ((values(result) < 0) == solid)[clear & (unsigned > 1e-5)].all()


@given(st.lists(boxes, min_size=1, max_size=3), turns, scales, st.tuples(numbers, numbers, numbers))
@settings(max_examples=20, deadline=None)
def test_any_rotation_scale_and_place(
    solids: list[Box], turn: np.ndarray, scale: float, shift: tuple[float, float, float]
) -> None:
    plain = csg("union", *solids)
    mesh = Mesh(scale * (plain.vertices @ turn.T + 10 * np.array(shift)), plain.faces, "turned")
    result = bake(mesh, cache=None, lattice=Lattice.around(mesh.bounds, 14, 0.1 * scale))
    points = nodes(result)
    squared, _, _ = igl.point_mesh_squared_distance(points, mesh.vertices, mesh.faces)
    solid = igl.winding_number(mesh.vertices, mesh.faces, points) > 0.5
    check(result, np.sqrt(squared), solid, 10 * scale)
    assert result.closed


@given(st.lists(boxes, min_size=1, max_size=3), st.data())
@settings(max_examples=20, deadline=None)
def test_repeated_and_degenerate_triangles_change_nothing(solids: list[Box], data: st.DataObject) -> None:
    clean = csg("union", *solids)
    some = st.lists(st.integers(0, len(clean.faces) - 1), max_size=8)
    copies = np.roll(clean.faces[data.draw(some)], data.draw(st.integers(0, 2)), axis=1).reshape(-1, 3)
    points = np.repeat(clean.faces[data.draw(some)][:, :1], 3, axis=1).reshape(-1, 3)
    lines = clean.faces[data.draw(some)][:, [0, 1, 1]].reshape(-1, 3)
    dirty = Mesh(clean.vertices, np.concatenate([clean.faces, copies, points, lines]), "dirty")
    expected, found = bake(clean, 14, cache=None), bake(dirty, 14, cache=None)
    near = np.abs(values(expected)) <= 2 * expected.grid.spacing
    assert np.abs(values(found) - values(expected))[near].max() < 1e-6
    assert ((values(found) > 0) == (values(expected) > 0)).all() and found.closed


@given(st.tuples(*[st.tuples(numbers, numbers, numbers)] * 3), scales)
@settings(max_examples=30, deadline=None)
def test_a_single_triangle_is_exact_and_encloses_nothing(corners: tuple[tuple[float, ...], ...], scale: float) -> None:
    vertices = scale * np.array(corners)
    area = np.linalg.norm(np.cross(vertices[1] - vertices[0], vertices[2] - vertices[0])) / 2
    mesh = Mesh(vertices, np.array([[0, 1, 2]]), "one")
    if area < 1e-6 * scale**2:  # nearly a line: taken or refused, but never a traceback
        try:
            bake(mesh, cache=None, lattice=Lattice.around(mesh.bounds, 10, 0.2 * scale))
        except UserError as error:
            assert "without area" in str(error)
        return
    result = bake(mesh, cache=None, lattice=Lattice.around(mesh.bounds, 12, 0.2 * scale))
    squared, _, _ = igl.point_mesh_squared_distance(nodes(result), mesh.vertices, mesh.faces)
    check(result, np.sqrt(squared), None, scale)
    assert (values(result)[np.sqrt(squared) > 1e-4 * scale] > 0).all()


@given(st.integers(0, 7), st.integers(0, 2), st.sampled_from([np.nan, np.inf, -np.inf]))
@settings(max_examples=10, deadline=None)
def test_corners_that_are_not_finite_are_refused(vertex: int, axis: int, number: float) -> None:
    box = Box((0, 0, 0), (1, 1, 1)).mesh()
    vertices = box.vertices.copy()
    vertices[vertex, axis] = number
    with pytest.raises(UserError, match="NaN or infinite"):
        bake(Mesh(vertices, box.faces, "broken"), 8, cache=None)


def test_a_mesh_of_nothing_is_refused() -> None:
    with pytest.raises(UserError, match=r"no triangles|empty"):
        bake(Mesh(np.zeros((0, 3)), np.zeros((0, 3), dtype=int), "nothing"), 8, cache=None)
