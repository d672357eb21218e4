"""Doubts on unit and axis: told where a scene contradicts them, and nowhere else."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import trimesh

from scenes.mesh.mesh import load_mesh, load_parts
from scenes.mesh.scale import TO_Y_UP, UNITS, doubts
from scenes.world.scene import BUNDLED, bundled_names

ROOMS = sorted(bundled_names())
SCALED = [unit for unit in UNITS if unit in ("cm", "in")]  # rooms in mm are refused, and in feet they are halls


def room(length: float, height: float, width: float, ceiling: bool = True) -> np.ndarray:
    """Triangles of a room that faces inward, y up."""
    box = trimesh.creation.box(extents=[length, height, width])
    keep = np.ones(12, bool) if ceiling else box.face_normals[:, 1] < 0.5
    return np.asarray(box.triangles[keep][:, ::-1])


def lying(triangles: np.ndarray, up: str) -> np.ndarray:
    """What is y up as a file with another axis up holds it."""
    return triangles @ TO_Y_UP[up]


def test_a_vast_room_is_doubted_in_one_sentence() -> None:
    (doubt,) = doubts("'a.obj'", lying(room(400, 260, 350), "z"), None, None)
    assert doubt == (
        "'a.obj' is 400 x 350 x 260 m along x, y and z as read: centimetres, z up? "
        'state unit = "cm", up = "z", or unit = "m", up = "y" if that is so'
    )


@pytest.mark.parametrize("name", ROOMS)
@pytest.mark.parametrize("unit", ["m", *SCALED])
@pytest.mark.parametrize("up", ["y", "z"])
def test_bundled_rooms_are_doubted_only_as_something_else(name: str, unit: str, up: str) -> None:
    triangles = lying(load_mesh(BUNDLED / f"{name}.glb").triangles, up) / UNITS[unit]
    found = doubts("it", triangles, None, None)
    if (unit, up) == ("m", "y"):
        assert not found
        return
    (doubt,) = found
    assert (f'state unit = "{unit}"' in doubt) == (unit != "m")
    assert ('up = "z"' in doubt) == (up == "z")
    assert 'up = "x"' not in doubt
    assert not doubts("it", triangles, unit, up)  # what is stated is not doubted
    assert all("unit" not in doubt for doubt in doubts("it", triangles, unit, None))
    assert all("up =" not in doubt for doubt in doubts("it", triangles, None, up))


@pytest.mark.parametrize("size", [(5, 2.6, 4), (3.3, 2.4, 5.5), (12, 2.8, 8), (4, 2.5, 3)])
@pytest.mark.parametrize("ceiling", [True, False])
@pytest.mark.parametrize("up", ["x", "y", "z"])
def test_rooms_on_their_side_are_doubted(size: tuple[float, float, float], ceiling: bool, up: str) -> None:
    triangles = lying(room(*size, ceiling), up)
    found = doubts("it", triangles, None, None)
    assert (f'state up = "{up}"' in "".join(found)) == (up != "y") and len(found) == (up != "y")


@pytest.mark.parametrize(
    "size",
    [
        (20, 6, 15), (300, 20, 300), (60, 12, 40), (2000, 30, 1500), (30, 60, 30), (10, 9, 8), (1, 1, 1),
        (2, 2, 0.1), (0.4, 0.9, 0.5), (100, 0, 100), (50, 35, 60),
    ],
)  # fmt: skip
def test_halls_yards_towers_and_things_are_not(size: tuple[float, float, float]) -> None:
    assert not doubts("it", room(*size), None, None)


@pytest.mark.parametrize("side", range(6))
def test_a_wall_that_faces_the_other_way_says_nothing_of_axes(side: int) -> None:
    box = trimesh.creation.box(extents=(5, 2.6, 4))
    turned = np.abs(box.face_normals @ np.repeat(np.eye(3), 2, axis=0)[side] - (-1) ** side) < 1e-6
    assert turned.sum() == 2
    assert not doubts("it", np.where(turned[:, None, None], box.triangles, box.triangles[:, ::-1]), None, None)


def test_a_wall_on_its_own_stands_as_it_was_read() -> None:
    for thickness in (0.0, 0.2):
        wall = trimesh.creation.box(extents=[6, 3, thickness]).triangles
        assert not doubts("it", wall[:2] if thickness else wall, None, None)
    front = trimesh.creation.box(extents=[6, 3, 1])
    assert not doubts("it", front.triangles[front.face_normals[:, 2] > 0.5], None, None)


def test_scans_and_examples_are_not_doubted(shared: Path) -> None:
    for path in (shared / "data" / "meshes").glob("*.ply"):
        assert load_mesh(path).doubts == ()
    office = load_mesh(shared / "data" / "meshes" / "office_large.ply")
    assert 'state up = "z"' in doubts("it", lying(office.triangles, "z"), None, None)[0]
    assert load_mesh(Path(__file__).parents[3] / "examples" / "tasks" / "cart.glb").doubts == ()


def test_files_are_doubted_where_nothing_is_stated(tmp_path: Path) -> None:
    triangles = lying(room(400, 260, 350), "z")
    mesh = trimesh.Trimesh(triangles.reshape(-1, 3), np.arange(36).reshape(-1, 3), process=False)
    for ending in ("glb", "obj", "ply", "stl"):
        mesh.export(tmp_path / f"a.{ending}")
        (doubt,) = load_mesh(tmp_path / f"a.{ending}").doubts
        assert f"'a.{ending}' is" in doubt and 'unit = "cm", up = "z"' in doubt
        assert next(iter(load_parts(tmp_path / f"a.{ending}").values())).doubts == (doubt,)
        assert load_mesh(tmp_path / f"a.{ending}", "cm", "z").doubts == ()
    text = "# units: cm\n# z up\n" + (tmp_path / "a.obj").read_text()
    (tmp_path / "a.obj").write_text(text)
    assert load_mesh(tmp_path / "a.obj").doubts == ()
