"""The floor is found under furniture and in noise, whichever way the mesh faces."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from scenes.errors import UserError
from scenes.mesh.csg import csg
from scenes.mesh.mesh import Mesh, load_mesh
from scenes.mesh.primitives import Box
from scenes.world.floor.ground import find_floor


def furnished(noise: float = 0.0, inward: bool = False) -> Mesh:
    """A room as a closed box seen from inside or as a slab, with a table and a wardrobe, finely triangulated."""
    import trimesh

    if inward:
        shell = trimesh.creation.box(bounds=[[-2, 0, -2], [2, 2.5, 2]])
        shell.invert()
    else:
        shell = trimesh.creation.box(bounds=[[-2, -0.2, -2], [2, 0, 2]])
    table = trimesh.creation.box(bounds=[[-1, 0.7, -1], [1, 0.75, 1]])
    wardrobe = trimesh.creation.box(bounds=[[1, 0.0, 1], [2, 2.0, 2]])
    whole = trimesh.util.concatenate([part.subdivide().subdivide().subdivide() for part in (shell, table, wardrobe)])
    vertices = whole.vertices + np.random.default_rng(0).normal(scale=noise, size=whole.vertices.shape)
    return Mesh(vertices, whole.faces, "furnished")


@pytest.mark.parametrize("inward", [False, True])
def test_the_floor_is_found_below_the_furniture(inward: bool) -> None:
    found = find_floor([furnished(inward=inward)])
    assert found.found and found.height == pytest.approx(0.0, abs=1e-9)
    assert found.area == pytest.approx(16.0, rel=0.01)


def test_the_floor_is_found_in_noise() -> None:
    assert find_floor([furnished(noise=0.01, inward=True)]).height == pytest.approx(0.0, abs=0.01)


def test_a_roof_larger_than_the_floor_is_not_the_floor() -> None:
    roof = csg("union", Box((0.0, -0.05, 0.0), (4.0, 0.1, 4.0)), Box((0.0, 2.5, 0.0), (6.0, 0.1, 6.0)))
    assert find_floor([roof]).height == pytest.approx(0.0, abs=1e-9)


def test_a_small_pit_is_not_the_floor() -> None:
    pit = csg("difference", Box((0.0, -0.5, 0.0), (4.0, 1.0, 4.0)), Box((1.0, -0.2, 1.0), (0.5, 0.5, 0.5)))
    assert find_floor([pit]).height == pytest.approx(0.0, abs=1e-9)


def test_without_anything_that_faces_up_the_user_is_asked() -> None:
    wall = Mesh(np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0]]), np.array([[0, 1, 2]]), "wall")
    with pytest.raises(UserError, match=r"found no floor in 'wall'.*state its height"):
        find_floor([wall])


@pytest.mark.parametrize("scan", ["living_room", "office_large"])
def test_the_floor_of_a_scan(shared: Path, scan: str) -> None:
    mesh = load_mesh(shared / "data/meshes" / f"{scan}.ply")
    assert find_floor([mesh]).height == pytest.approx(mesh.bounds[0, 1], abs=0.02)  # both lie on the ground
