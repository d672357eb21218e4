"""Stray triangles: what is a speck far from all else goes, with a sentence; what may be meant stays."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest
import trimesh
from hypothesis import given, settings, strategies as st

from scenes.mesh.mesh import Mesh, joined, load_mesh, load_parts
from scenes.mesh.primitives import Box, Capsule, Sphere
from scenes.mesh.stray import without_strays
from scenes.world.scene import Scene, bundled, bundled_names

Piece = tuple[np.ndarray, np.ndarray]


def piece(mesh: Mesh) -> Piece:
    return mesh.vertices, mesh.faces


def speck(*place: float, size: float = 0.05) -> Piece:
    return np.array(place) + size * np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0]]), np.array([[0, 1, 2]])


ROOM = piece(Box((0.0, 1.3, 0.0), (6.0, 2.6, 5.0)).mesh())
TABLE = piece(Box((1.0, 0.4, 0.0), (0.8, 0.8, 1.2)).mesh())
BALL = piece(Sphere((-1.5, 0.5, 1.0), 0.5).mesh())
PEOPLED = joined([ROOM, TABLE, BALL])
FINE = piece(Mesh(*trimesh.remesh.subdivide(*trimesh.remesh.subdivide(*trimesh.remesh.subdivide(*PEOPLED)))))
SCENES = {"few triangles": ROOM, "furniture": PEOPLED, "so many that quantiles decide": FINE}

FAR = {
    "one": [speck(60, 0, 0)],
    "below": [speck(0, -40, 0, size=0.3)],
    "one on each side of each axis": [speck(*(s * d * e)) for d, s in ((40, 1), (70, -1)) for e in np.eye(3)],
    "one behind another": [speck(10.0 * 3**k, 1, 0) for k in range(1, 6)],
    "a cloud": [speck(x, y, z) for x in (-80, 30, 50) for y in (-30, 90) for z in (-100, 20, 40)],
    "a crumb of many triangles": [piece(Sphere((-50.0, 20, 0), 0.03).mesh())],
    "without any area": [(np.full((3, 3), 77.0), np.array([[0, 1, 2]]))],
    "at the origin of a world far away": [speck(-500_000, 0, -4_500_000)],
}
NOT_FAR = {
    "beside the room": [speck(4, 0, 0)],
    "less than half a room away": [speck(5.9, 0, 0)],
    "a chain that leads there": [speck(4 + 2.0 * k, 0, 0) for k in range(30)],
}
LAMP = [piece(Capsule((25, 0, 0), (25, 4, 0), 0.01).mesh()), piece(Sphere((25, 4.3, 0), 0.1).mesh())]
MEANT = {
    "a lamp post and its bulb": LAMP,
    "a tree in a game level": [piece(Capsule((60, 0, 60), (60, 2, 60), 0.03).mesh())],
    "a hut": [piece(Box((30, 1, 0), (1, 2, 1)).mesh())],
}


@pytest.mark.parametrize("kind", FAR)
@pytest.mark.parametrize("scene", SCENES)
def test_strays_are_left_out_and_told(scene: str, kind: str) -> None:
    clean, strays = SCENES[scene], FAR[kind]
    vertices, faces, doubts = without_strays(*joined([clean, *strays]), "scan")
    assert np.array_equal(vertices[faces], clean[0][clean[1]]) and len(vertices) == len(clean[0])
    (doubt,) = doubts
    x, y, z = (strays[0][0].min(axis=0) + strays[0][0].max(axis=0)) / 2
    count = sum(len(f) for _, f in strays)
    assert doubt.startswith(f"mesh 'scan': {count} stray triangle{'s' * (count > 1)} at [")
    assert f"[{x:.2f}, {y:.2f}, {z:.2f}]" in doubt or "more places" in doubt
    assert "the mesh is 6 m long" in doubt and "state it as a primitive" in doubt


@pytest.mark.parametrize("scene", SCENES)
@pytest.mark.parametrize("kind", NOT_FAR)
def test_what_is_not_far_stays_without_a_word(scene: str, kind: str) -> None:
    given = joined([SCENES[scene], *NOT_FAR[kind]])
    vertices, faces, doubts = without_strays(*given, "scan")
    assert vertices is given[0] and faces is given[1] and doubts == ()


@pytest.mark.parametrize("kind", MEANT)
def test_what_may_be_meant_stays_and_its_price_is_told(kind: str) -> None:
    given = joined([PEOPLED, *MEANT[kind]])
    vertices, faces, doubts = without_strays(*given, "level")
    assert np.array_equal(vertices[faces], given[0][given[1]])
    assert all("stray" not in doubt for doubt in doubts)
    assert [d for d in doubts if "little and far" in d and "state a 'spacing'" in d] == list(doubts)
    assert doubts or kind == "a hut"  # whose area is no little of the room's


def test_both_kinds_beside_each_other() -> None:
    given = joined([PEOPLED, *LAMP, speck(0, 0, 900)])
    vertices, faces, doubts = without_strays(*given, "level")
    assert np.array_equal(vertices[faces], given[0][given[1][:-1]])
    assert "1 stray triangle at [0.03, 0.03, 900.00]" in doubts[0] and "little and far" in doubts[1]


def test_many_specks_are_no_strays() -> None:
    """What is a part of the area worth mentioning is kept: a scan of leaves, say."""
    leaves = [speck(*p, size=0.08) for p in np.random.default_rng(0).uniform(30, 60, (100, 3))]
    _, faces, doubts = without_strays(*joined([PEOPLED, *leaves]), "leaves")
    assert len(faces) == len(PEOPLED[1]) + 100 and len(doubts) == 1 and "little and far" in doubts[0]


@settings(max_examples=40, deadline=None)
@given(
    turn=st.permutations((0, 1, 2)),
    scale=st.floats(0.1, 30),
    by=st.tuples(*[st.floats(-1e4, 1e4)] * 3),
    kind=st.sampled_from(list(FAR)),
)
def test_where_and_how_large_a_scene_is_does_not_matter(
    turn: Sequence[int], scale: float, by: tuple[float, float, float], kind: str
) -> None:
    vertices, faces = joined([PEOPLED, *FAR[kind]])
    kept = without_strays((vertices[:, turn] * scale) + by, faces, "scan")[1]
    assert len(kept) == len(PEOPLED[1])


def test_two_of_a_kind_and_single_triangles_are_no_strays() -> None:
    twins = joined([piece(Box((0, 0, 0), (1, 1, 1)).mesh()), piece(Box((50, 0, 0), (1, 1, 1)).mesh())])
    for vertices, faces in (twins, speck(0, 0, 0), joined([speck(0, 0, 0), speck(9, 9, 9)])):
        assert without_strays(vertices, faces, "few")[2] == ()
    points = np.zeros((9, 3)), np.arange(9).reshape(3, 3)
    assert without_strays(*points, "points")[1] is points[1]


def test_files_are_read_without_strays_and_scenes_say_so(tmp_path: Path) -> None:
    clean, stray = tmp_path / "clean.ply", tmp_path / "stray.ply"
    for path, parts in ((clean, [ROOM, TABLE]), (stray, [ROOM, TABLE, speck(60_000, 0, 0)])):  # 60 km: no scene is
        trimesh.Trimesh(*joined(parts), process=False).export(path)
    one, other = load_mesh(clean), load_mesh(stray)
    assert other.digest == one.digest and np.array_equal(other.bounds, one.bounds)
    assert one.doubts == () and len(other.doubts) == 1
    assert Scene([other], resolution=16, cache=None).doubts[0] == other.doubts[0]
    (part,) = load_parts(stray).values()
    assert np.array_equal(part.bounds, one.bounds) and len(part.doubts) == 1
    scaled = load_mesh(stray, unit="cm", up="z")  # sentences are in metres, y up, as everything after reading
    assert "[600.00, 0.00, -0.00]" in scaled.doubts[0]


def test_no_bundled_scene_and_no_scan_has_strays(shared: Path) -> None:
    for mesh in [
        *(bundled(name).meshes[0] for name in bundled_names()),
        *map(load_mesh, shared.glob("data/meshes/*.ply")),
    ]:
        assert mesh.doubts == ()
