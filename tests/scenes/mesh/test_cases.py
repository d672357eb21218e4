"""The reported files on import, as they came: each was read wrongly or refused without a reason."""

from __future__ import annotations

import importlib.util
from pathlib import Path

import numpy as np
import pytest

from scenes.errors import UserError
from scenes.mesh.mesh import Mesh, load_mesh, load_parts


@pytest.fixture(scope="module")
def cases(shared: Path) -> Path:
    folder = shared / "cases" / "geometry"
    if not folder.is_dir():
        pytest.skip(f"needs the reported cases in {folder}, which are not here")
    return folder


def area(mesh: Mesh) -> float:
    a, b, c = np.moveaxis(mesh.triangles, 1, 0)
    return float(np.linalg.norm(np.cross(b - a, c - a), axis=1).sum() / 2)


@pytest.mark.parametrize(
    ("file", "bounds"),
    [
        ("glb_instancing/inst_req.glb", [[0, 0, 0], [7, 1, 1]]),
        ("glb_quantized_normalized/quant8.glb", [[-1, -1, -1], [1, 1, 1]]),
        ("glb_sparse/sparse.glb", [[0, 0, 0], [1, 3, 1]]),
        ("obj_negative_interleaved/neg2.obj", [[0, 0, 0], [6, 2, 2]]),
        ("obj_tabs_bom/tabs.obj", [[0, 0, 0], [2, 2, 2]]),
        ("obj_tabs_bom/bom.obj", [[0, 0, 0], [2, 2, 2]]),
    ],
)
def test_everything_is_where_it_stands(cases: Path, file: str, bounds: list[list[float]]) -> None:
    mesh = load_mesh(cases / file)
    assert mesh.bounds.tolist() == bounds and mesh.doubts == ()


@pytest.mark.parametrize(
    ("file", "extension"),
    [
        ("glb_draco_mixed/draco_mix.glb", "KHR_draco_mesh_compression"),
        ("glb_meshopt/meshopt.glb", "EXT_meshopt_compression"),
    ],
)
def test_compression_without_data_is_named(cases: Path, file: str, extension: str) -> None:
    library = {"KHR_draco_mesh_compression": "DracoPy", "EXT_meshopt_compression": "meshopt"}[extension]
    sentence = "damaged" if importlib.util.find_spec(library) else r"install 'scenectl\[compressed\]'"
    for load in (load_mesh, load_parts):
        with pytest.raises(UserError, match=f"compressed with {extension}.*{sentence}"):
            load(cases / file)


def test_parts_without_material(cases: Path) -> None:
    parts = load_parts(cases / "glb_parts_no_material" / "prims.glb")
    assert {name: len(part.faces) for name, part in parts.items()} == {"two prims": 24}


def test_the_door_is_open(cases: Path) -> None:
    mesh = load_mesh(cases / "ngon_doorway" / "wall.obj")
    assert area(mesh) == pytest.approx(6 * 3 - 1.2 * 2.1 + 36)
    from scenes.world.scene import Scene

    scene = Scene([mesh])
    assert scene.distance_exact(np.array([[3.0, 1.05, 3.0]]))[0] == pytest.approx(0.6, abs=1e-6)
