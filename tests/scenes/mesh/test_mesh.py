"""Reading meshes: every format, units, axes, and one sentence for each way a file can be bad."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import trimesh

from scenes.errors import UserError
from scenes.mesh.mesh import Mesh, load_mesh, load_parts
from scenes.mesh.reading import FORMATS
from scenes.mesh.scale import UNITS


def wedge() -> trimesh.Trimesh:
    """A tetrahedron without any symmetry, 1 x 2 x 3, so that swapped or mirrored axes show."""
    vertices = np.array([[0.0, 0, 0], [1, 0, 0], [0, 2, 0], [0, 0, 3]])
    return trimesh.Trimesh(vertices, [[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]], process=False)


def volume(mesh: Mesh) -> float:
    a, b, c = np.moveaxis(mesh.triangles, 1, 0)
    return float((a * np.cross(b, c)).sum() / 6)


@pytest.mark.parametrize("ending", FORMATS)
def test_every_format_keeps_size_and_orientation(ending: str, tmp_path: Path) -> None:
    path = tmp_path / f"wedge.{ending}"
    if ending == "gltf":
        for name, content in trimesh.exchange.gltf.export_gltf(trimesh.Scene(wedge())).items():
            (tmp_path / name).write_bytes(content)
        path = tmp_path / "model.gltf"
    else:
        wedge().export(path)
    mesh = load_mesh(path)
    assert np.allclose(mesh.bounds, [[0, 0, 0], [1, 2, 3]], atol=1e-6)
    assert volume(mesh) == pytest.approx(1.0, abs=1e-5)  # positive: the faces still look outward
    assert mesh.source == str(path) and len(mesh.digest) == 64


@pytest.mark.parametrize("unit", UNITS)
def test_units_become_metres(unit: str, tmp_path: Path) -> None:
    wedge().apply_scale(1 / UNITS[unit]).export(tmp_path / "a.stl")
    mesh = load_mesh(tmp_path / "a.stl", unit=unit)
    assert np.allclose(mesh.bounds[1], [1, 2, 3], rtol=1e-5)
    assert mesh.unit == unit


@pytest.mark.parametrize(("up", "extents"), [("x", (2, 1, 3)), ("y", (1, 2, 3)), ("z", (1, 3, 2))])
def test_the_stated_axis_turns_to_y_without_mirroring(up: str, extents: tuple[float, ...], tmp_path: Path) -> None:
    wedge().export(tmp_path / "a.ply")
    mesh = load_mesh(tmp_path / "a.ply", up=up)
    assert np.allclose(np.ptp(mesh.bounds, axis=0), extents)
    assert volume(mesh) == pytest.approx(1.0, abs=1e-5)
    tip = {"x": 1.0, "y": 2.0, "z": 3.0}[up]
    assert mesh.bounds[1, 1] == pytest.approx(tip)  # what was up stays up, and not down


def test_comments_may_state_unit_and_axis_and_arguments_win(tmp_path: Path) -> None:
    text = "# units: mm\n# Z-up\nv 0 0 0\nv 1000 0 0\nv 0 2000 0\nv 0 0 3000\nf 1 2 3\nf 1 3 4\n"
    (tmp_path / "a.obj").write_text(text)
    mesh = load_mesh(tmp_path / "a.obj")
    assert (mesh.unit, mesh.up) == ("mm", "z")
    assert np.allclose(np.ptp(mesh.bounds, axis=0), [1, 3, 2])
    assert np.allclose(np.ptp(load_mesh(tmp_path / "a.obj", "cm", "y").bounds, axis=0), [10, 20, 30])


def test_parts_of_a_scene_are_placed_and_joined(tmp_path: Path) -> None:
    scene = trimesh.Scene()
    for x in (0.0, 5.0):
        scene.add_geometry(wedge(), transform=trimesh.transformations.translation_matrix([x, 0, 0]))
    scene.export(tmp_path / "two.glb")
    mesh = load_mesh(tmp_path / "two.glb")
    assert len(mesh.faces) == 8 and np.allclose(mesh.bounds, [[0, 0, 0], [6, 2, 3]])


def test_digest_tells_geometry_apart_and_cannot_go_stale() -> None:
    a = Mesh(wedge().vertices, wedge().faces)
    assert a.digest == Mesh(wedge().vertices, wedge().faces, name="other").digest
    assert a.digest != Mesh(wedge().vertices + 1e-9, wedge().faces).digest
    assert a.digest != Mesh(wedge().vertices, wedge().faces[::-1]).digest
    with pytest.raises(ValueError, match="read-only"):
        a.vertices[0] = 1.0


def test_bad_files_are_one_sentence(tmp_path: Path) -> None:
    def refused(name: str, content: bytes, *words: str, **arguments: str) -> None:
        (tmp_path / name).write_bytes(content)
        with pytest.raises(UserError) as caught:
            load_mesh(tmp_path / name, **arguments)
        text = str(caught.value)
        assert "\n" not in text and all(word in text for word in words), text

    with pytest.raises(UserError, match="does not exist"):
        load_mesh(tmp_path / "none.glb")
    (tmp_path / "folder.glb").mkdir()
    with pytest.raises(UserError, match=r"folder.glb' is a folder; give a file in it"):
        load_mesh(tmp_path / "folder.glb")
    refused("a.plx", b"", "unknown format 'plx'", "did you mean 'ply'")
    refused("a.glb", b"not a mesh at all", "cannot be read")
    refused("b.ply", b"ply\nformat ascii 1.0\nelement vertex 9\n", "b.ply")
    refused("empty.stl", b"", "empty.stl")
    refused("empty.obj", b"", "empty.obj")
    points = (
        b"ply\nformat ascii 1.0\nelement vertex 2\nproperty float x\nproperty float y\nproperty float z\nend_header\n"
    )
    refused("points.ply", points + b"0 0 0\n1 1 1\n", "no triangles")
    refused("nan.obj", b"v nan 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n", "NaN")
    triangle = b"v 0 0 0\nv %d 0 0\nv 0 %d 0\nf 1 2 3\n"
    refused("far.obj", triangle % (4000, 3000), "4e+03 m", "did you mean unit='mm'")
    refused("tiny.obj", b"v 0 0 0\nv 0.004 0 0\nv 0 0.003 0\nf 1 2 3\n", "0.004 m", unit="m")
    refused("u.obj", triangle % (1, 1), "unknown unit 'metre'", unit="metre")
    refused("up.obj", triangle % (1, 1), "unknown up axis 'w'", up="w")


def test_bad_arrays_are_one_sentence() -> None:
    corners = np.eye(3)
    for vertices, faces, word in [
        (corners[:, :2], [[0, 1, 2]], "give"),
        (corners, np.zeros((0, 3), int), "no triangles"),
        (corners, [[0, 1, 3]], "beyond its 3"),
        (np.where(corners == 1, np.inf, 0), [[0, 1, 2]], "infinite"),
    ]:
        with pytest.raises(UserError, match=word):
            Mesh(np.asarray(vertices), np.asarray(faces))


def test_vertices_no_triangle_uses_do_not_matter() -> None:
    mesh = Mesh(np.vstack([wedge().vertices, [[np.nan, 1e9, 0]]]), wedge().faces)
    assert np.allclose(mesh.bounds, [[0, 0, 0], [1, 2, 3]])


def test_parts_of_a_glb_are_its_nodes_where_they_stand(tmp_path: Path) -> None:
    turn = trimesh.transformations.rotation_matrix(0.5, (0, 1, 0), (1, 0, 0))
    scene = trimesh.Scene()
    scene.add_geometry(wedge(), node_name="chair_left", geom_name="chair")
    scene.add_geometry(wedge(), node_name="chair_right", geom_name="chair", transform=turn)
    scene.export(tmp_path / "a.glb")
    parts = load_parts(tmp_path / "a.glb")
    assert set(parts) == {"chair_left", "chair_right"}
    assert np.allclose(parts["chair_right"].bounds, wedge().apply_transform(turn).bounds, atol=1e-6)
    assert sum(len(part.faces) for part in parts.values()) == len(load_mesh(tmp_path / "a.glb").faces)


def test_parts_of_an_obj_keep_their_materials_together_and_state_units(tmp_path: Path) -> None:
    (tmp_path / "a.obj").write_text(
        "# unit: cm\n# up: z\no chair\nv 0 0 0\nv 100 0 0\nv 0 100 0\nv 0 0 200\nusemtl a\nf 1 2 3\nusemtl b\nf 1 2 4\n"
        "o vase\nv 500 0 0\nv 502 0 0\nv 500 1 0\nf 5 6 7\n"
    )
    parts = load_parts(tmp_path / "a.obj")
    assert {name: len(part.faces) for name, part in parts.items()} == {"chair": 2, "vase": 1}
    assert np.allclose(parts["chair"].bounds, [[0, 0, -1], [1, 2, 0]])
    assert np.ptp(parts["vase"].bounds, axis=0).max() == pytest.approx(0.02)  # smaller than any scene, and yet a part


def test_bounds_ignore_vertices_without_triangles() -> None:
    vertices = np.array([[0.0, 0, 0], [1, 0, 0], [0, 2, 0], [np.nan, 50, 50]])
    mesh = Mesh(vertices, np.array([[0, 1, 2]]))
    assert np.array_equal(mesh.bounds, [[0, 0, 0], [1, 2, 0]])
    with pytest.raises(UserError, match="1 vertices with NaN"):
        Mesh(vertices, np.array([[0, 1, 3]]))
