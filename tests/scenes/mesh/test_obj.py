"""OBJ files: indices from both ends, any blanks, and every digit of the coordinates."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

from scenes.errors import UserError
from scenes.mesh.mesh import load_mesh, load_parts
from scenes.mesh.obj import read_obj

CORNERS = [(x, y, z) for x in (0, 2) for y in (0, 2) for z in (0, 2)]
SIDES = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]


def text(gap: str = " ", end: str = "\n", tail: str = "") -> str:
    rows = ["v" + gap + gap.join(map(str, corner)) for corner in CORNERS]
    rows += ["f" + gap + gap.join(f"{corner + 1}{tail}" for corner in side) for side in SIDES]
    return end.join(rows) + end


def read(folder: Path, content: str | bytes) -> np.ndarray:
    path = folder / "a.obj"
    path.write_bytes(content if isinstance(content, bytes) else content.encode())
    return load_mesh(path).triangles


@pytest.mark.parametrize(
    "content",
    [
        text("\t"),
        text("  \t "),
        text(end="\r\n"),
        text(end="\r"),
        text(tail="/"),
        text(tail="/1/1"),
        text(tail="//1"),
        "\ufeff" + text(),
        "\ufeff# first a comment\n" + text(),
        text().replace("f 1 2 ", "f 1 2 \\\n"),
        text().replace("f 1 2 ", "f 1 2 \\\r\n"),
        text().replace("\n", "  # said on the line\n"),
        text().replace("\n", " \n\n"),
        "mtllib nowhere.mtl\nusemtl gone\n" + text() + "l 1 2\np 3\n",
        text().replace("v 0 0 0", "v 0 0 0 1.0").replace("v 2 2 2", "v 2 2 2 0.5 0.5 0.5"),
        text().replace("v ", " v ").replace("f ", "\tf "),
        text().rstrip("\n"),
        "s off\ng walls\nvt 0 0\nvn 0 1 0\n" + text(),
    ],
)
def test_the_same_box_however_it_is_written(tmp_path: Path, content: str) -> None:
    assert np.array_equal(read(tmp_path, content), read(tmp_path, text()))


@settings(max_examples=60, deadline=None)
@given(st.integers(0, 10**6))
def test_relative_indices_mean_the_vertices_above_them(tmp_path_factory: pytest.TempPathFactory, seed: int) -> None:
    """Blocks of vertices and faces in turn; each index is written from one end or the other at random."""
    rng = np.random.default_rng(seed)
    lines, vertices, expected = [], np.zeros((0, 3)), []
    for _ in range(rng.integers(1, 6)):
        block = rng.normal(size=(rng.integers(3, 9), 3))
        vertices = np.vstack([vertices, block])
        lines += ["v " + " ".join(map(repr, map(float, row))) for row in block]
        for _ in range(rng.integers(1, 5)):
            face = rng.choice(len(vertices), 3, replace=False)
            lines.append("f " + " ".join(str(i + 1 if rng.random() < 0.5 else i - len(vertices)) for i in face))
            expected.append(vertices[face])
    found = read(tmp_path_factory.mktemp("a"), "\n".join(lines))
    assert np.array_equal(found, np.array(expected))  # to the last bit


def test_coordinates_far_away_keep_their_digits(tmp_path: Path) -> None:
    found = read(tmp_path, "v 500000.001 12.0005 4500000.0625\nv 500001 12 4500000\nv 500000 13 4500001.123\nf 1 2 3\n")
    assert found[0, 0].tolist() == [500000.001, 12.0005, 4500000.0625] and found[0, 2, 2] == 4500001.123


def test_objects_are_parts_and_names_given_twice_are_numbered(tmp_path: Path) -> None:
    blocks = [
        text(),
        *(f"o {name}\n" + text().replace("v 2", f"v {x}") for name, x in (("a b", 3), ("c", 4), ("c", 5))),
    ]
    for number, block in enumerate(blocks):  # every block names vertices of its own
        blocks[number] = "\n".join(
            "f " + " ".join(str(int(word) + 8 * number) for word in line[2:].split()) if line[:1] == "f" else line
            for line in block.splitlines()
        )
    (tmp_path / "a.obj").write_text("\n".join(blocks))
    parts = load_parts(tmp_path / "a.obj")
    assert {name: part.bounds[1, 0] for name, part in parts.items()} == {"a.obj": 2, "a b": 3, "c": 4, "c 2": 5}
    assert all(len(part.vertices) == 8 and len(part.faces) == 12 for part in parts.values())


@pytest.mark.parametrize(
    ("content", "sentence"),
    [
        (text() + "f 1 2 9\n", "vertices beyond its 8"),
        (text() + "f 1 2 -9\n", "vertices beyond its 8"),
        (text() + "f 0 1 2\n", "vertices beyond its 8"),
        (text() + "f 1 2 x\n" + text(), "line 15 is 'f 1 2 x'"),
        (text() + "f 1 2\n" + text(), "cannot be read: line 15"),
        ("v 1 2 three\n" + text(), "line 1 is 'v 1 2 three'"),
        (text() + "f 1 2", "is cut off: line 15"),
        ("v 1 2 3\nv 1 2", "is cut off: line 2"),
        (text().encode("utf-16"), "not UTF-8"),
        ("\n \n", "is empty"),
        ("v 0 0 0\nv 1 0 0\nl 1 2\n", "no triangles"),
    ],
)
def test_what_is_wrong_is_one_sentence(tmp_path: Path, content: str | bytes, sentence: str) -> None:
    with pytest.raises(UserError, match=sentence) as told:
        read(tmp_path, content)
    assert "\n" not in str(told.value) and "a.obj" in str(told.value)


def test_vertices_at_the_end_without_faces_are_a_doubt(tmp_path: Path) -> None:
    whole = text()
    (tmp_path / "a.obj").write_text(whole[: whole.index("f 5")])
    (doubt,) = load_mesh(tmp_path / "a.obj").doubts
    assert "cut off" in doubt and "the last 4 of its 8 vertices" in doubt
    (tmp_path / "a.obj").write_text(whole)
    assert read_obj(tmp_path / "a.obj").doubts == ()
    (tmp_path / "a.obj").write_text(whole + "v 9 9 9\nl 8 9\n")
    assert read_obj(tmp_path / "a.obj").doubts == ()
