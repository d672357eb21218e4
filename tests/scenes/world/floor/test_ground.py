"""The floor is what has standing room in free space above it: under furniture, in noise, whichever way it faces."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from scenes.errors import UserError
from scenes.mesh.csg import csg
from scenes.mesh.mesh import Mesh, load_mesh
from scenes.mesh.primitives import Box
from scenes.world.floor.ground import Floor
from scenes.world.floor.planning import free_area
from scenes.world.scene import Scene
from tests.scenes.world.floor.grounds import block, joined, patch, room, storeys


def furnished(noise: float = 0.0, inward: bool = False) -> Mesh:
    """A room as a closed box seen from inside or as a slab, with a table and a wardrobe, finely triangulated."""
    import trimesh

    if inward:
        shell = trimesh.creation.box(bounds=[[-2, 0, -2], [2, 2.5, 2]])
        shell.invert()
    else:
        shell = trimesh.creation.box(bounds=[[-2, -0.2, -2], [2, 0, 2]])
    table = trimesh.creation.box(bounds=[[-1, 0.7, -1], [1, 0.75, 1]])
    wardrobe = trimesh.creation.box(bounds=[[1, 0.01, 1], [1.99, 2.0, 1.99]])
    whole = trimesh.util.concatenate([part.subdivide().subdivide().subdivide() for part in (shell, table, wardrobe)])
    vertices = whole.vertices + np.random.default_rng(0).normal(scale=noise, size=whole.vertices.shape)
    return Mesh(vertices, whole.faces, "furnished")


def floor_of(*meshes: Mesh, **baking: object) -> Floor:
    return Scene(meshes, resolution=96, cache=None, **baking).floor  # type: ignore[arg-type]


@pytest.mark.parametrize("inward", [False, True])
def test_the_floor_is_found_below_the_furniture(inward: bool) -> None:
    found = floor_of(furnished(inward=inward))
    assert found.found and found.height == pytest.approx(0.0, abs=1e-9)
    assert found.area == pytest.approx(16.0 - 4.0 - 0.98, rel=0.03)  # where one can stand: not under the table


def test_the_floor_is_found_in_noise() -> None:
    assert floor_of(furnished(noise=0.01, inward=True)).height == pytest.approx(0.0, abs=0.01)


def test_a_roof_larger_than_the_floor_is_not_the_floor() -> None:
    roof = csg("union", Box((0.0, -0.05, 0.0), (4.0, 0.1, 4.0)), Box((0.0, 2.5, 0.0), (6.0, 0.1, 6.0)))
    assert floor_of(roof).height == pytest.approx(0.0, abs=1e-9)


def test_a_small_pit_is_not_the_floor() -> None:
    pit = csg("difference", Box((0.0, -0.5, 0.0), (4.0, 1.0, 4.0)), Box((1.0, -0.2, 1.0), (0.5, 0.5, 0.5)))
    assert floor_of(pit).height == pytest.approx(0.0, abs=1e-9)


@pytest.mark.parametrize(
    ("level", "side"), [(-2.6, 3.0), (-2.6, 4.5), (-1.0, 4.5), (-0.5, 4.5), (0.5, 3.0), (2.0, 4.5), (3.5, 4.5)]
)
def test_a_patch_under_or_over_a_scanned_room_is_not_its_floor(level: float, side: float) -> None:
    scan = Mesh(*map(np.concatenate, zip(*_indexed(room(), patch(side, level)), strict=True)), "scan")
    scene = Scene([scan], resolution=128, cache=None)
    alone = free_area(Scene([room()], resolution=128, cache=None))
    assert scene.floor.height == pytest.approx(0.0, abs=1e-6) and len(scene.floors) <= 2
    if not 0.0 < level < 2.5:
        assert scene.floors == (scene.floor,)
        assert free_area(scene).square_metres == pytest.approx(alone.square_metres, rel=0.01)


def _indexed(*meshes: Mesh) -> list[tuple[np.ndarray, np.ndarray]]:
    """Vertices and faces of meshes that are joined one after another."""
    counts = np.cumsum([0, *(len(mesh.vertices) for mesh in meshes)])
    return [(mesh.vertices, mesh.faces + count) for mesh, count in zip(meshes, counts, strict=False)]


def test_a_floor_may_face_either_way() -> None:
    seed = (2.5, 1.3, 2.0)
    mesh = room()
    reversed_ = Mesh(mesh.vertices, mesh.faces[:, ::-1], "reversed")
    for given in (mesh, reversed_):
        scene = Scene([given], resolution=96, cache=None, free_space=seed)
        assert scene.floor.height == 0.0 and scene.floor.area == pytest.approx(20.0)
        assert free_area(scene).square_metres == pytest.approx(4.4 * 3.4, rel=0.01)


def test_storeys_are_floors_and_the_lowest_is_the_floor() -> None:
    scene = storeys()
    assert [floor.height for floor in scene.floors] == pytest.approx([0.0, 2.72], abs=1e-5)
    assert scene.floor == scene.floors[0]


def test_without_room_to_stand_the_user_is_told_why() -> None:
    wall = Mesh(np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0]]), np.array([[0, 1, 2]]), "wall")
    with pytest.raises(UserError, match=r"found no floor in 'scene' because nothing level has free.*state its height"):
        floor_of(wall)
    low = joined(block((-2.0, 2.0), (-2.0, 2.0), 0.0), block((-2.0, 2.0), (-2.0, 2.0), 9.0, 1.2))
    solid = Scene(low.meshes, resolution=96, cache=None, free_space=(0.0, 0.6, 0.0), name="crawl")
    kept = [height for height in solid.levels.heights[40, 40] if height < 5]
    assert kept == pytest.approx([0.0], abs=1e-5)
    assert solid.floor.height == pytest.approx(9.0)  # one stands on top of it


def test_too_low_a_room_says_how_high_it_is() -> None:
    box = room(height=1.2)
    with pytest.raises(UserError, match=r"height of 0.00 m, has 1.20 m of free space above it, and standing takes"):
        _ = Scene([box], resolution=96, cache=None).floor


@pytest.mark.parametrize("scan", ["living_room", "office_large"])
def test_the_floor_of_a_scan(shared: Path, scan: str) -> None:
    mesh = load_mesh(shared / "data/meshes" / f"{scan}.ply")
    assert Scene([mesh]).floor.height == pytest.approx(mesh.bounds[0, 1], abs=0.02)  # both lie on the ground
