"""`scenectl bake` says how high the floors lie, or why there is none."""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from scenes.mesh.mesh import Mesh
from tests.scenes.world.floor.grounds import room, storeys

Run = Callable[..., Any]


def baked(scenectl: Run, mesh: Mesh, folder: Path) -> str:
    import trimesh

    trimesh.Trimesh(mesh.vertices, mesh.faces, process=False).export(folder / "mesh.ply")
    said = scenectl("bake", folder / "mesh.ply", "--resolution", 96)
    assert said.status == 0, said
    return " ".join(said.out.split())


def test_a_grid_is_not_written_to_a_device_and_that_is_told_before_the_bake(scenectl: Run, tmp_path: Path) -> None:
    for option in ("-o", "--png"):
        said = scenectl("bake", tmp_path / "none.ply", option, os.devnull)
        assert said.status == 2 and f"cannot write '{os.devnull}': it is a device; give the path of a file" in said.err


def test_storeys_are_named_with_their_areas(scenectl: Run, tmp_path: Path) -> None:
    said = baked(scenectl, storeys().meshes[0], tmp_path)
    assert "floor: 0.000 m (found in the mesh); floors: 0.000 m (18.9 m²), 2.720 m (18." in said


FOUND = "floor: 0.000 m (found in the mesh); done"


@pytest.mark.parametrize(("height", "words"), [(2.6, FOUND), (1.0, "has 1.00 m of free space above it")])
def test_one_floor_or_none(scenectl: Run, tmp_path: Path, height: float, words: str) -> None:
    assert words in baked(scenectl, room(height=height), tmp_path)
