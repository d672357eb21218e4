"""All formats: polygons, what follows the data, and files that end too early."""

from __future__ import annotations

import struct
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import trimesh
from hypothesis import given, settings, strategies as st

from scenes.errors import UserError
from scenes.mesh.mesh import load_mesh
from scenes.mesh.reading import FORMATS

DOORWAY = np.array([[0, 0], [2.4, 0], [2.4, 2.1], [3.6, 2.1], [3.6, 0], [6, 0], [6, 3], [0, 3.0]])
WALL = np.column_stack([DOORWAY, np.full(8, 3.0)])
FLOOR = np.array([[0, 0, 0], [6, 0, 0], [6, 0, 6], [0, 0, 6.0]])
VERTICES, RINGS = np.vstack([WALL, FLOOR]), [[1, 2, 3, 4, 5, 6, 7, 0], [8, 11, 10, 9], [8, 9, 10]]
AREA = 18 - 1.2 * 2.1 + 36 + 18


def obj(vertices: np.ndarray, rings: list[list[int]]) -> bytes:
    lines = ["v " + " ".join(map(repr, map(float, v))) for v in vertices]
    return "\n".join(lines + ["f " + " ".join(str(i + 1) for i in ring) for ring in rings]).encode() + b"\n"


def off(vertices: np.ndarray, rings: list[list[int]]) -> bytes:
    lines = [
        "OFF # a comment",
        f"{len(vertices)} {len(rings)} 0",
        *(" ".join(map(repr, map(float, v))) for v in vertices),
    ]
    return "\n".join(lines + [f"{len(ring)} " + " ".join(map(str, ring)) for ring in rings]).encode() + b"\n"


def header(form: str, vertices: np.ndarray, rings: list[list[int]], kind: str = "double") -> bytes:
    return (
        f"ply\nformat {form} 1.0\ncomment by hand\nelement vertex {len(vertices)}\nproperty {kind} x\n"
        f"property {kind} y\nproperty {kind} z\nproperty uchar red\n"
        f"element face {len(rings)}\nproperty list uchar int vertex_indices\n"
        "property float quality\nproperty list uchar float texcoord\nend_header\n"
    ).encode()


def ply_text(vertices: np.ndarray, rings: list[list[int]]) -> bytes:
    lines = [" ".join(map(repr, map(float, v))) + " 7" for v in vertices]
    lines += [f"{len(ring)} {' '.join(map(str, ring))} 0.5 2 0.1 0.2" for ring in rings]
    return header("ascii", vertices, rings) + "\n".join(lines).encode() + b"\n"


def ply_binary(vertices: np.ndarray, rings: list[list[int]], order: str = "<") -> bytes:
    form = {"<": "binary_little_endian", ">": "binary_big_endian"}[order]
    rows = [struct.pack(f"{order}3dB", *v, 7) for v in vertices]
    rows += [struct.pack(f"{order}B{len(ring)}ifBff", len(ring), *ring, 0.5, 2, 0.1, 0.2) for ring in rings]
    return header(form, vertices, rings) + b"".join(rows)


WRITERS: dict[str, tuple[str, Callable[[np.ndarray, list[list[int]]], bytes]]] = {
    "obj": ("obj", obj),
    "off": ("off", off),
    "ply text": ("ply", ply_text),
    "ply": ("ply", ply_binary),
    "ply, big end first": ("ply", lambda vertices, rings: ply_binary(vertices, rings, ">")),
}


def area(triangles: np.ndarray) -> float:
    a, b, c = np.moveaxis(triangles, 1, 0)
    return float(np.linalg.norm(np.cross(b - a, c - a), axis=1).sum() / 2)


def read(folder: Path, ending: str, data: bytes) -> np.ndarray:
    path = folder / f"a.{ending}"
    path.write_bytes(data)
    return load_mesh(path).triangles


@pytest.mark.parametrize("name", WRITERS)
def test_a_door_in_a_polygon_stays_open(tmp_path: Path, name: str) -> None:
    ending, write = WRITERS[name]
    triangles = read(tmp_path, ending, write(VERTICES, RINGS))
    assert area(triangles) == pytest.approx(AREA, rel=1e-9) and len(triangles) == 6 + 2 + 1


@settings(max_examples=40, deadline=None)
@given(st.sampled_from(sorted(WRITERS)), st.integers(0, 10**6))
def test_polygons_of_any_sizes_come_back_to_the_last_bit(
    tmp_path_factory: pytest.TempPathFactory, name: str, seed: int
) -> None:
    ending, write = WRITERS[name]
    rng = np.random.default_rng(seed)
    vertices = rng.uniform(-10, 10, (12, 3)) + np.array([4_500_000.0, 0.0, 500_000.0])
    rings = [rng.choice(12, rng.choice([3, 3, 4, 7]), replace=False).tolist() for _ in range(rng.integers(1, 9))]
    path = tmp_path_factory.mktemp("a") / f"a.{ending}"
    path.write_bytes(write(vertices, rings))
    mesh = load_mesh(path)
    assert np.array_equal(mesh.vertices, vertices)
    assert len(mesh.faces) == sum(len(ring) - 2 for ring in rings)
    triples = {frozenset(face) for face in mesh.faces.tolist()}
    assert all(frozenset(ring) in triples for ring in rings if len(ring) == 3)


@pytest.mark.parametrize("word", ["COFF", "NOFF", "STOFF", "CNOFF", "coff"])
def test_off_rows_may_carry_more(tmp_path: Path, word: str) -> None:
    data = off(VERTICES, RINGS).decode().replace("OFF # a comment", word)
    more = "\n".join(
        line + " 0.1 0.2 0.3" if line.count(" ") >= 2 and "." in line else line for line in data.split("\n")
    )
    assert area(read(tmp_path, "off", more.encode())) == pytest.approx(AREA)
    assert area(read(tmp_path, "off", ("\ufeff" + data.replace("\n", "\r\n")).encode())) == pytest.approx(AREA)
    assert area(read(tmp_path, "off", data.replace(f"{word}\n", f"{word} ").encode())) == pytest.approx(AREA)
    with pytest.raises(UserError, match="binary OFF"):
        read(tmp_path, "off", b"OFF BINARY\n\0\0\0\0")


@pytest.mark.parametrize("end", ["\r\n", "\r", "\n"])
def test_ply_headers_of_any_line_ends(tmp_path: Path, end: str) -> None:
    data = ply_binary(VERTICES, RINGS)
    head, body = data.split(b"end_header\n")
    written = head.replace(b"\n", end.encode()) + b"end_header" + end.encode() + body
    assert area(read(tmp_path, "ply", written)) == pytest.approx(AREA)


def test_a_list_before_the_faces_and_an_element_between(tmp_path: Path) -> None:
    text = (
        "ply\nformat ascii 1.0\nelement vertex 3\nproperty list uchar int near\nproperty float x\nproperty float y\n"
        "property float z\nelement edge 2\nproperty int a\nelement face 1\nproperty list uchar uint vertex_index\n"
        "end_header\n0 0 0 0\n2 5 6 1 0 0\n1 9 0 1 0\n4\n5\n3 0 1 2\n"
    )
    assert area(read(tmp_path, "ply", text.encode())) == pytest.approx(0.5)


def box_stl(count: int | None = None, head: bytes = b"solid by some CAD tool") -> bytes:
    box = trimesh.creation.box(extents=[1, 2, 3])
    rows = b"".join(struct.pack("<12fH", *[0.0] * 3, *triangle.reshape(-1), 0) for triangle in box.triangles)
    return head.ljust(80, b" ") + struct.pack("<I", 12 if count is None else count) + rows


STRIPS = [[0, 1, 2, 3, 4], [0, 1, 2, -1, 3, 4, 5, 6, -1, -1, 1, 2], [7, 6, 5], [], [-1], [2, 3, 3, 4, 5]]
UNROLLED = [
    [0, 1, 2], [1, 3, 2], [2, 3, 4], [0, 1, 2], [3, 4, 5], [4, 6, 5], [7, 6, 5], [2, 3, 3], [3, 4, 3], [3, 4, 5],
]  # fmt: skip


@pytest.mark.parametrize("form", ["ascii", "binary_little_endian", "binary_big_endian"])
@pytest.mark.parametrize("rows", [STRIPS, STRIPS[1:2]], ids=["several", "one"])
def test_strips_of_a_ply_are_unrolled(tmp_path: Path, form: str, rows: list[list[int]]) -> None:
    text = header(form, VERTICES, rows).replace(b"element face", b"element tristrips").partition(b"property float qu")
    data, order = text[0].replace(b"uchar int", b"int int") + b"end_header\n", "<" if "little" in form else ">"
    if form == "ascii":
        lines = [" ".join(map(repr, map(float, v))) + " 7" for v in VERTICES]
        data += "\n".join(lines + [" ".join(map(str, [len(row), *row])) for row in rows]).encode()
    else:
        data += b"".join(struct.pack(f"{order}3dB", *v, 7) for v in VERTICES)
        data += b"".join(struct.pack(f"{order}{len(row) + 1}i", len(row), *row) for row in rows)
    expected = UNROLLED if len(rows) > 1 else UNROLLED[3:6]
    assert np.array_equal(read(tmp_path, "ply", data), VERTICES[expected])
    with pytest.raises(UserError, match="vertices beyond"):
        read(
            tmp_path,
            "ply",
            data.replace(struct.pack(order + "i", 6), struct.pack(order + "i", -2)).replace(b" 6 ", b" -2 "),
        )


@pytest.mark.parametrize("tail", [b"", b"\0", b"\n", b"a footer of some tool", bytes(500), b"solid"])
@pytest.mark.parametrize("head", [b"solid x", b"", b"\0\0", b"binary stl"])
def test_bytes_after_a_binary_stl_are_passed_over(tmp_path: Path, tail: bytes, head: bytes) -> None:
    assert area(read(tmp_path, "stl", box_stl(head=head) + tail)) == pytest.approx(22.0)


def test_stl_as_text_may_have_several_solids_and_any_case(tmp_path: Path) -> None:
    text = str(trimesh.creation.box(extents=[1, 2, 3]).export(file_type="stl_ascii"))
    assert area(read(tmp_path, "stl", (text + "\n" + text).encode())) == pytest.approx(44.0)
    assert area(read(tmp_path, "stl", text.encode() + b"\nfooter\0\xff\x1a")) == pytest.approx(22.0)
    assert area(read(tmp_path, "stl", text.upper().replace("\n", "\r\n").encode())) == pytest.approx(22.0)


def whole(ending: str) -> bytes:
    box = trimesh.creation.box(extents=[1, 2, 3])
    if ending == "gltf":
        from tests.scenes.mesh.test_gltf import boxes

        return boxes_in_text(boxes())
    return bytes(box.export(file_type=ending)) if ending in ("glb", "stl") else WRITERS[ending][1](VERTICES, RINGS)


def boxes_in_text(file: object) -> bytes:
    import base64
    import json

    uri = "data:application/octet-stream;base64," + base64.b64encode(file.binary).decode()  # type: ignore[attr-defined]
    return json.dumps({**file.facts, "buffers": [{"byteLength": len(file.binary), "uri": uri}]}).encode()  # type: ignore[attr-defined]


@pytest.mark.parametrize("kind", [*FORMATS, "ply text", "stl text"])
def test_a_file_that_ends_too_early_is_called_that(tmp_path: Path, kind: str) -> None:
    ending = kind.split()[0]
    data = whole(kind) if kind != "stl text" else trimesh.creation.box().export(file_type="stl_ascii").encode()
    assert len(read(tmp_path, ending, data)) > 0
    text = kind in ("obj", "off", "ply text")
    counted = kind != "obj"
    for length in range(0, len(data.rstrip()) - (3 if text else 1), max(len(data) // 150, 1)):
        (tmp_path / f"a.{ending}").write_bytes(data[:length])
        try:
            mesh = load_mesh(tmp_path / f"a.{ending}")
        except UserError as error:
            assert "\n" not in str(error) and "Error" not in str(error)
            if length > 10 and counted:
                assert "cut off" in str(error), (length, error)
        else:  # an OBJ counts nothing: what is left of it may be whole
            assert not counted, length
            assert mesh.doubts or len(mesh.faces) > 0


@pytest.mark.parametrize("ending", FORMATS)
@pytest.mark.parametrize(
    "noise", [b"", b"\0", b"\xff" * 200, b"plain words, nothing else\n" * 9, b"<html></html>", b"{}"]
)
def test_foreign_files_are_one_sentence(tmp_path: Path, ending: str, noise: bytes) -> None:
    (tmp_path / f"a.{ending}").write_bytes(noise)
    with pytest.raises(UserError) as told:
        load_mesh(tmp_path / f"a.{ending}")
    assert "\n" not in str(told.value) and f"a.{ending}" in str(told.value)


@pytest.mark.parametrize("ending", ["glb", "obj", "off", "ply", "ply text"])
def test_another_format_under_the_name_of_stl_is_not_called_cut_off(tmp_path: Path, ending: str) -> None:
    with pytest.raises(UserError, match="is no STL and cannot be read"):
        read(tmp_path, "stl", whole(ending))
    with pytest.raises(UserError, match="it holds 134 of 50000084 bytes"):
        read(tmp_path, "stl", bytes(80) + struct.pack("<I", 10**6) + bytes(50))


@settings(max_examples=60, deadline=None)
@given(st.sampled_from(["glb", "stl", "ply", "obj", "off", "ply text"]), st.integers(0, 10**6))
def test_damaged_files_are_read_or_one_sentence(tmp_path_factory: pytest.TempPathFactory, kind: str, seed: int) -> None:
    rng = np.random.default_rng(seed)
    data = bytearray(whole(kind))
    for place in rng.integers(0, len(data), 4):
        data[place] = rng.integers(0, 256)
    path = tmp_path_factory.mktemp("a") / f"a.{kind.split()[0]}"
    path.write_bytes(bytes(data))
    try:
        load_mesh(path)
    except UserError as error:
        assert "\n" not in str(error)
