"""Characters from glTF and robots from URDF: frames, parts and scales as stated; what is broken is told."""

from __future__ import annotations

import base64
import contextlib
import json
import math
import zipfile
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from scenes.body.gltf import read_rig
from scenes.body.urdf import read_urdf
from scenes.errors import UserError
from scenes.motion.frames import rigid, transform
from scenes.motion.skeleton import HUMANML3D, tree_order
from tests.scenes.body.rigs import ROBOT, Gltf, arm, humanoid, robot, standing


@pytest.mark.parametrize("scale", [1.0, 0.01])
def test_an_arm_comes_with_its_joints_and_parts_in_metres(tmp_path: Path, scale: float) -> None:
    rig = read_rig(arm(scale).save(tmp_path / "arm.glb"))
    assert (rig.name, rig.links, rig.parents) == ("arm", ("upper", "lower"), (-1, 0))
    np.testing.assert_allclose(rig.origins, [[0, 0, 0], [0.3, 0, 0]], atol=1e-6)
    np.testing.assert_allclose(rig.frames[:, :3, :3], np.tile(np.eye(3), (2, 1, 1)), atol=1e-6)
    assert [part.link for part in rig.parts] == ["upper", "lower"]
    for part, low, high in zip(
        rig.parts, ([-0.06] * 3, [-0.04] * 3), ([0.36, 0.06, 0.06], [0.29, 0.04, 0.04]), strict=True
    ):
        np.testing.assert_allclose(part.vertices.min(axis=0), low, atol=1e-6)  # in the joint's own frame
        np.testing.assert_allclose(part.vertices.max(axis=0), high, atol=1e-6)
    assert rig.triangles.reshape(-1, 3).max(axis=0)[0] == pytest.approx(0.59, abs=1e-6)


def test_a_bent_pose_carries_each_part_with_its_joint_and_leaves_it_as_it_is_bound(tmp_path: Path) -> None:
    straight = read_rig(arm().save(tmp_path / "straight.glb"))
    bent = arm()
    half = math.sqrt(0.5)
    bent.facts["nodes"][2]["rotation"] = [0.0, 0.0, half, half]  # a quarter turn about z at the elbow
    bent.facts["nodes"][0]["translation"] = [0.0, 5.0, 0.0]
    rig = read_rig(bent.save(tmp_path / "bent.glb"))
    for a, b in zip(straight.parts, rig.parts, strict=True):
        order_a, order_b = (np.lexsort(p.vertices.round(5).T) for p in (a, b))
        np.testing.assert_allclose(a.vertices[order_a], b.vertices[order_b], atol=1e-5)
    assert rig.parts[1].placed.max(axis=0) == pytest.approx([0.34, 5.29, 0.04], abs=1e-5)


def test_a_triangle_belongs_to_the_joint_with_the_most_weight_on_it(tmp_path: Path) -> None:
    file = arm()
    rows = np.zeros((3, 4))
    rows[:, 0], rows[:, 1] = [0.9, 0.3, 0.2], [0.1, 0.7, 0.8]  # 1.4 against 1.6, though 0.9 is the largest
    vertices = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0]])
    file.facts["nodes"][-1]["mesh"] = file.mesh(vertices, np.array([[0, 1, 2]]), np.tile([0, 1, 0, 0], (3, 1)), rows)
    assert [part.link for part in read_rig(file.save(tmp_path / "a.glb")).parts] == ["lower"]
    rows[:, :2] = [[0.2, 0.8], [0.8, 0.2], [0.7, 0.3]]  # 1.7 against 1.3
    file.facts["nodes"][-1]["mesh"] = file.mesh(vertices, np.array([[0, 1, 2]]), np.tile([0, 1, 0, 0], (3, 1)), rows)
    assert [part.link for part in read_rig(file.save(tmp_path / "b.glb")).parts] == ["upper"]


def test_strips_fans_bytes_and_meshes_that_hang_on_joints(tmp_path: Path) -> None:
    file = arm()
    square = file.add(np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [1, 1, 0]]))
    around = file.add(np.array([[0.0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]]))
    file.facts["meshes"].append(
        {
            "primitives": [
                {"attributes": {"POSITION": square}, "mode": 5},
                {"attributes": {"POSITION": around}, "mode": 6},
            ]
        }
    )
    file.facts["nodes"][2]["children"] = [len(file.facts["nodes"])]
    file.facts["nodes"].append({"name": "held", "mesh": 1, "scale": [2.0, 2.0, 2.0]})
    del file.facts["nodes"][3]["mesh"]
    rig = read_rig(file.save(tmp_path / "held.glb"))
    assert [part.link for part in rig.parts] == ["lower"] and len(rig.parts[0].faces) == 4
    corners = rig.parts[0].vertices[rig.parts[0].faces]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    np.testing.assert_allclose(normals, np.tile([0, 0, 4.0], (4, 1)), atol=1e-6)  # the front side stays the front side


def test_plain_gltf_reads_the_same_with_its_buffer_inside_or_beside(tmp_path: Path) -> None:
    file = arm()
    whole = read_rig(file.save(tmp_path / "arm.glb"))
    (tmp_path / "my arm.bin").write_bytes(file.binary)
    inside = "data:application/octet-stream;base64," + base64.b64encode(file.binary).decode()
    for uri in (inside, "my%20arm.bin"):
        facts = {**file.facts, "buffers": [{"byteLength": len(file.binary), "uri": uri}]}
        (tmp_path / "arm.gltf").write_text(json.dumps(facts))
        np.testing.assert_array_equal(read_rig(tmp_path / "arm.gltf").triangles, whole.triangles)


def test_clothes_share_their_joints_and_strangers_do_not(tmp_path: Path) -> None:
    file = arm()
    file.facts["skins"].append({"joints": [2], "inverseBindMatrices": file.add(np.eye(4).reshape(1, 16))})
    assert read_rig(file.save(tmp_path / "a.glb")).links == ("upper", "lower")
    file.facts["nodes"].append({"name": "stranger"})
    file.facts["skins"][1]["joints"] = [len(file.facts["nodes"]) - 1]
    with pytest.raises(UserError, match="2 skins, 1 of them without a joint in common"):
        read_rig(file.save(tmp_path / "b.glb"))


def test_a_humanoid_stands_where_its_joints_are(tmp_path: Path) -> None:
    rig = read_rig(humanoid().save(tmp_path / "person.glb"))
    place = dict(zip(HUMANML3D.names, standing(), strict=True))
    np.testing.assert_allclose(rig.origins, [place[link] for link in rig.links], atol=1e-6)
    assert len(rig.parts) == 22 and rig.triangles[..., 1].min() == pytest.approx(0.0, abs=0.01)


def no_skin(file: Gltf) -> None:
    file.facts["skins"] = []


def sparse(file: Gltf) -> None:
    places = {"bufferView": 0, "componentType": 5125}
    file.facts["accessors"][1]["sparse"] = {"count": 1, "indices": places, "values": {"bufferView": 99}}


def compressed(file: Gltf) -> None:
    attributes = file.facts["meshes"][0]["primitives"][0]["attributes"]
    del file.facts["accessors"][attributes["POSITION"]]["bufferView"]
    packed = {"bufferView": 0, "attributes": dict.fromkeys(attributes, 0)}
    file.facts["meshes"][0]["primitives"][0]["extensions"] = {"KHR_draco_mesh_compression": packed}
    file.facts["extensionsRequired"] = ["KHR_draco_mesh_compression"]


def ring(file: Gltf) -> None:
    file.facts["nodes"][2]["children"] = [1]
    file.facts["nodes"][0]["children"] = []


def bad_joint(file: Gltf) -> None:
    file.facts["skins"][0]["joints"] = [1, -1]


def nan_weight(file: Gltf) -> None:
    kinds = file.facts["meshes"][0]["primitives"][0]["attributes"]
    count = file.facts["accessors"][kinds["WEIGHTS_0"]]["count"]
    kinds["WEIGHTS_0"] = file.add(np.full((count, 4), np.nan))


def few_weights(file: Gltf) -> None:
    file.facts["meshes"][0]["primitives"][0]["attributes"]["WEIGHTS_0"] = file.add(np.ones((3, 4)))


def beyond_skin(file: Gltf) -> None:
    file.facts["skins"][0]["joints"] = [1]


def beyond_buffer(file: Gltf) -> None:
    file.facts["bufferViews"][1]["byteLength"] = 10**9


def negative(file: Gltf) -> None:
    file.facts["accessors"][1]["byteOffset"] = -8


def overlapping(file: Gltf) -> None:
    file.facts["bufferViews"][1]["byteStride"] = 4


def nan_vertex(file: Gltf) -> None:
    file.facts["nodes"][1]["translation"] = [math.nan, 0, 0]


def lines(file: Gltf) -> None:
    file.facts["meshes"][0]["primitives"][0]["mode"] = 1


@pytest.mark.parametrize(
    ("harm", "sentence"),
    [
        (no_skin, "has no skin"),
        (sparse, "no buffer view 99"),
        (compressed, "compressed with KHR_draco_mesh_compression"),
        (ring, "not well-formed glTF"),
        (bad_joint, "there is no joint -1"),
        (nan_weight, "weights are NaN"),
        (few_weights, r"weights; export|and 3 weights"),
        (beyond_skin, "weights name joints beyond the 1"),
        (beyond_buffer, "is cut off"),
        (negative, "no whole numbers"),
        (overlapping, "overlap"),
        (nan_vertex, "not finite"),
        (lines, "no triangles"),
    ],
)
def test_broken_characters_are_told_in_one_sentence(
    tmp_path: Path, harm: Callable[[Gltf], None], sentence: str
) -> None:
    file = arm()
    harm(file)
    path = file.save(tmp_path / "arm.glb")
    with pytest.raises(UserError, match=sentence) as told:
        read_rig(path)
    assert str(path) in str(told.value) and "\n" not in str(told.value)


def test_cut_off_and_foreign_files_are_told_wherever_they_end(tmp_path: Path) -> None:
    path, data = tmp_path / "arm.glb", arm().bytes()
    for length in [*range(0, 64, 7), 500, 2000, len(data) // 2, len(data) - 1]:
        path.write_bytes(data[:length])
        with pytest.raises(UserError):
            read_rig(path)
    for noise in (b"[]", b"{}", b"solid", b"glTF" + b"\xff" * 60, b'{"asset": 3}', b'{"asset": {"version": "1.0"}}'):
        path.write_bytes(noise)
        with pytest.raises(UserError):
            read_rig(path)
    with pytest.raises(UserError, match="does not exist"):
        read_rig(tmp_path / "nowhere.glb")


@pytest.mark.parametrize("seed", range(30))
def test_files_with_random_bytes_in_their_facts_are_read_or_told(tmp_path: Path, seed: int) -> None:
    """No traceback, whatever the JSON says."""
    rng = np.random.default_rng(seed)
    file = arm()
    places: list[tuple[object, object]] = []

    def walk(value: object) -> None:
        for key, inner in value.items() if isinstance(value, dict) else enumerate(value):  # type: ignore[arg-type]
            places.append((value, key))
            if isinstance(inner, dict | list):
                walk(inner)

    walk(file.facts)
    junk = [None, -1, 7, 10**9, 0.5, "x", [], {}, [1, 2], True, 1e308]
    for _ in range(20):
        holder, key = places[rng.integers(len(places))]
        before = holder[key]  # type: ignore[index]
        holder[key] = junk[rng.integers(len(junk))]  # type: ignore[index]
        with contextlib.suppress(UserError):
            read_rig(file.save(tmp_path / "arm.glb"))
        holder[key] = before  # type: ignore[index]


def test_a_robot_stands_y_up_with_its_shapes_in_their_links(tmp_path: Path) -> None:
    rig = read_urdf(robot(tmp_path))
    assert rig.links == ("base", "arm", "forearm", "bulb", "tip") and rig.parents == (-1, 0, 1, 2, 3)
    c, s = math.cos(0.5), math.sin(0.5)
    elbow, bulb = np.array([0, 0, 0.5]), np.array([0.3 * c, 0.3 * s, 0.5])
    forward_up = [[p[1], p[2], p[0]] for p in (elbow, bulb)]  # x forward, z up becomes z forward, y up
    np.testing.assert_allclose(rig.origins[2:4], forward_up, atol=1e-12)
    parts = {part.link: part for part in rig.parts}
    assert set(parts) == {"base", "arm", "forearm", "bulb"}
    bounds = {link: (part.vertices.min(axis=0), part.vertices.max(axis=0)) for link, part in parts.items()}
    np.testing.assert_allclose(bounds["base"], [[-0.15, -0.15, 0], [0.15, 0.15, 0.1]], atol=1e-9)  # no 9 m visual
    np.testing.assert_allclose(bounds["arm"], [[-0.03, -0.04, 0], [0.03, 0.04, 0.4]], atol=1e-9)
    np.testing.assert_allclose(bounds["forearm"], [[0, -0.02, -0.02], [0.2, 0.02, 0.02]], atol=1e-6)  # mm, turned
    assert parts["base"].placed[:, 1].min() == pytest.approx(0.0, abs=1e-9)


def test_roll_pitch_and_yaw_turn_about_fixed_axes_in_that_order(tmp_path: Path) -> None:
    box = '<collision><origin rpy="0.3 -0.7 1.9"/><geometry><box size="2 4 6"/></geometry></collision>'
    from scipy.spatial.transform import Rotation

    angles = [0.3, -0.7, 1.9]
    rig = read_urdf(robot(tmp_path, f'<robot name="r"><link name="l">{box}</link></robot>'))
    corners = (
        np.array([[x, y, z] for x in (-1, 1) for y in (-2, 2) for z in (-3, 3)])
        @ Rotation.from_euler("xyz", angles).as_matrix().T
    )
    found = rig.parts[0].vertices
    assert all(np.linalg.norm(found - corner, axis=1).min() < 1e-9 for corner in corners)


def test_a_mirroring_scale_keeps_triangles_facing_outward(tmp_path: Path) -> None:
    plain = read_urdf(robot(tmp_path)).parts[2]
    turned = read_urdf(robot(tmp_path, ROBOT.replace('scale="0.001 0.001', 'scale="-0.001 0.001'))).parts[2]
    for part in (plain, turned):
        a, b, c = np.moveaxis(part.vertices[part.faces], 1, 0)
        assert (a * np.cross(b, c)).sum() > 0


@pytest.mark.parametrize(
    ("old", "new", "sentence"),
    [
        ('<?xml version="1.0"?>', '<!DOCTYPE r [<!ENTITY a "b">]>', "has a DOCTYPE"),
        ("</robot>", "", "not valid XML"),
        ("robot", "model", "root is <model>"),
        ('<child link="tip"/>', '<child link="tipp"/>', "no link 'tipp', the child of joint 'j3'"),
        ('<child link="tip"/>', '<child link="arm"/>', "two parents"),
        ('<parent link="base"/><child link="arm"/>', '<parent link="bulb"/><child link="arm"/>', "ring"),
        ('radius="0.05"', 'radius="-1"', "radius='-1' for the sphere of link 'bulb'; give positive metres"),
        ('radius="0.05"', "", "radius=nothing"),
        ('size="0.06 0.08 0.4"', 'size="0.06 0.08"', "give 3 numbers"),
        ('xyz="0 0 0.2"', 'xyz="0 0 nan"', "xyz='0 0 nan'"),
        ('xyz="0 0 0.2"', 'xyz="0 0 1e308"', "xyz='0 0 1e308'"),
        ('xyz="0 0 0.2"', 'xyz="0 0 3000"', "reaches over 2000 m"),
        ('radius="0.05"', 'radius="1e300"', "radius='1e300' for the sphere"),
        ('radius="0.05"', 'radius="3000"', "to 2000"),
        ('radius="0.05"', 'radius="1e-300"', "give metres from 1e-06"),
        ("rod.stl", "../../etc/archive.zip", "not beside it"),
        ("rod.stl", "rope.stl", "rope.stl' of link 'forearm', which is not beside it"),
        ("<box size", "<cone size", "unknown shape <cone>"),
        ('<link name="tip"/>', '<link name="bulb"/>', "two links of one name"),
        ('<link name="tip"/>', "<link/>", "no name"),
    ],
)
def test_broken_robots_are_told_in_one_sentence(tmp_path: Path, old: str, new: str, sentence: str) -> None:
    assert old in ROBOT
    with pytest.raises(UserError, match=sentence) as told:
        read_urdf(robot(tmp_path, ROBOT.replace(old, new)))
    assert "lamp.urdf" in str(told.value) and "\n" not in str(told.value)


@pytest.mark.parametrize("scale", ["1e300 1e300 1e300", "1e150 1 1", "1e6 1e6 1e6", "-1e300 1 1"])
def test_shapes_that_are_scaled_beyond_any_scene_are_told_before_a_hull_is_made(tmp_path: Path, scale: str) -> None:
    text = ROBOT.replace('scale="0.001 0.001 0.001"', f'scale="{scale}"')
    with pytest.raises(UserError, match=r"at most 1e\+09|reaches over 2000 m") as told:
        read_urdf(robot(tmp_path, text))
    assert "lamp.urdf" in str(told.value)


@pytest.mark.parametrize("scale", ["0 0 0", "0.001 0 0.001", "-0.0 1 1"])
def test_a_scale_that_leaves_nothing_of_a_mesh_is_told(tmp_path: Path, scale: str) -> None:
    with pytest.raises(UserError, match=r"lamp\.urdf.*scale='.*give numbers other than 0"):
        read_urdf(robot(tmp_path, ROBOT.replace('scale="0.001 0.001 0.001"', f'scale="{scale}"')))


@pytest.mark.parametrize("size", [1e12, 1e30, 1e150, 1e300, math.inf, math.nan])
@pytest.mark.parametrize("node", [0, 1])
def test_characters_of_any_size_but_a_persons_are_told(tmp_path: Path, size: float, node: int) -> None:
    for key, value in (("translation", [0, size, 0]), ("matrix", [size, *[0] * 4, size, *[0] * 4, size, *[0] * 4, 1])):
        file = arm()
        for turn in ("translation", "rotation", "scale"):
            file.facts["nodes"][node].pop(turn, None)
        file.facts["nodes"][node][key] = value
        with pytest.raises(UserError, match=r"arm\.glb") as told:
            read_rig(file.save(tmp_path / "arm.glb"))
        assert "\n" not in str(told.value)


def test_archives_and_pipes_are_no_meshes_whatever_they_are_called(tmp_path: Path) -> None:
    path = robot(tmp_path)
    mesh = tmp_path / "meshes" / "rod.stl"
    for name in ("rod.zip", "rod.zae", "rod.gz", "rod.dae"):
        with zipfile.ZipFile(mesh.with_name(name), "w", zipfile.ZIP_DEFLATED) as archive:
            archive.writestr("bomb.dae", b"\0" * 10_000_000)
        path.write_text(ROBOT.replace("rod.stl", name))
        with pytest.raises(UserError, match="unknown format" if name != "rod.dae" else "UTF-8"):
            read_urdf(path)


def test_meshes_that_cannot_be_read_and_hidden_doctypes_are_told(tmp_path: Path) -> None:
    path = robot(tmp_path)
    (tmp_path / "meshes" / "rod.stl").write_bytes(b"not a mesh")
    with pytest.raises(UserError, match=r"cannot be read|no triangles"):
        read_urdf(path)
    path.write_bytes(ROBOT.replace('<?xml version="1.0"?>', '<!DOCTYPE r [<!ENTITY a "b">]>').encode("utf-16"))
    with pytest.raises(UserError, match="UTF-8"):
        read_urdf(path)


BENCH = """<robot name="bench"><link name="body">
  <visual name="top"><origin xyz="0 0 0.45"/><geometry><box size="1.2 0.4 0.04"/></geometry></visual>
  <visual><origin xyz="-0.5 0 0.22"/><geometry><box size="0.05 0.35 0.44"/></geometry></visual>
  <visual name="leg"><origin xyz="0.5 0 0.22"/><geometry><box size="0.05 0.35 0.44"/></geometry></visual>
  <collision><origin xyz="0 0 0.45"/><geometry><box size="1.2 0.4 0.04"/></geometry></collision>
</link></robot>"""


def test_visual_shapes_beyond_collision_shapes_are_a_doubt(tmp_path: Path) -> None:
    rig = read_urdf(robot(tmp_path, BENCH))
    (doubt,) = rig.doubts
    assert "2 of 3 visual shapes of link 'body' (box 2, leg) reach up to 0.43 m beyond" in doubt
    assert doubt.count(", 0.00) m in the link's frame") == 1  # the feet
    assert len(rig.parts[0].faces) == 12  # what collides stays what the file says
    hull = '<collision><origin xyz="0 0 0.235"/><geometry><box size="1.2 0.4 0.475"/></geometry></collision>'
    whole = BENCH[: BENCH.index("<collision>")] + hull + "</link></robot>"
    assert read_urdf(robot(tmp_path, whole)).doubts == ()
    overlapping = BENCH.replace("</link>", hull + "</link>")  # inside several shapes is inside too
    assert read_urdf(robot(tmp_path, overlapping)).doubts == ()
    lost = BENCH.replace('<box size="0.05 0.35 0.44"/>', '<mesh filename="leg.dae"/>', 1)
    (doubt,) = read_urdf(robot(tmp_path, lost)).doubts
    assert "not compared" in doubt and "'leg.dae'" in doubt and str(tmp_path) in doubt
    assert "\n" not in doubt


def dae(unit: str = "1", transform: str = "<translate>0 0 2</translate>", end: int | None = None) -> str:
    """An L of six corners as one polygon, in the plane z = 0."""
    outline = "0 0 0 3 0 0 3 1 0 1 1 0 1 3 0 0 3 0"
    text = f"""<?xml version="1.0"?>
<COLLADA xmlns="http://www.collada.org/2005/11/COLLADASchema" version="1.4.1">
<asset><unit meter="{unit}"/><up_axis>Y_UP</up_axis></asset>
<library_geometries><geometry id="l"><mesh>
<source id="p"><float_array id="a" count="18">{outline}</float_array><technique_common>
<accessor source="#a" count="6" stride="3"><param name="X" type="float"/><param name="Y" type="float"/>
<param name="Z" type="float"/></accessor></technique_common></source>
<vertices id="v"><input semantic="POSITION" source="#p"/></vertices>
<polylist count="1"><input semantic="VERTEX" source="#v" offset="0"/><vcount>6</vcount><p>1 2 3 4 5 0</p></polylist>
</mesh></geometry></library_geometries>
<library_visual_scenes><visual_scene id="s"><node>{transform}<instance_geometry url="#l"/></node></visual_scene>
</library_visual_scenes><scene><instance_visual_scene url="#s"/></scene></COLLADA>"""
    return text[:end]


def test_collada_meshes_are_read_with_their_unit_and_their_polygons_cut_properly(tmp_path: Path) -> None:
    text = ROBOT.replace("rod.stl", "rod.dae").replace(' scale="0.001 0.001 0.001"', "")
    path = robot(tmp_path, text)

    def forearm(content: str) -> np.ndarray:
        (tmp_path / "meshes" / "rod.dae").write_text(content)
        part = read_urdf(path).parts[2]
        return part.vertices[part.faces]

    for content, scale, up in (
        (dae(), 1.0, 1.0),
        (dae("0.01"), 0.01, 1.0),
        (dae(transform="<scale>1 1 -1</scale><translate>0 0 -2</translate>"), 1.0, -1.0),
    ):
        triangles = forearm(content)
        a, b, c = np.moveaxis(triangles, 1, 0)
        normals = np.cross(b - a, c - a) / 2
        assert np.linalg.norm(normals, axis=1).sum() == pytest.approx(5 * scale**2, rel=1e-5)
        assert normals.sum(axis=0)[0] == pytest.approx(up * 5 * scale**2, rel=1e-5)  # turned about y by the file
        assert triangles[..., 0] == pytest.approx(0.1 + 2 * scale, rel=1e-5)
    for length in range(0, len(dae()), 60):
        with pytest.raises(UserError, match=r"cut off|is empty"):
            forearm(dae(end=length))
    with pytest.raises(UserError, match="DOCTYPE"):
        forearm(dae().replace("<COLLADA", '<!DOCTYPE r [<!ENTITY a "b">]><COLLADA'))
    with pytest.raises(UserError, match="unknown format 'daee'"):
        read_urdf(robot_with(tmp_path, "rod.daee"))


def robot_with(folder: Path, mesh: str) -> Path:
    (folder / "meshes").mkdir(exist_ok=True)
    (folder / "meshes" / mesh).write_text("x")
    return robot(folder, ROBOT.replace("rod.stl", mesh))


def test_trees_are_put_in_order_and_rings_refused() -> None:
    parents = [3, 0, 0, -1, -1]
    order = tree_order(parents)
    assert sorted(order) == [0, 1, 2, 3, 4]
    assert all(parents[j] < 0 or order.index(parents[j]) < order.index(j) for j in order)
    with pytest.raises(ValueError, match="each other"):
        tree_order([1, 0, -1])


def test_the_nearest_rigid_transform_is_a_rotation() -> None:
    turn = rigid(np.diag([0.5, 2.0, 3.0, 1.0]))
    np.testing.assert_allclose(turn, np.eye(4), atol=1e-12)
    mirrored = rigid(np.array([[0.0, -2, 0, 1], [1, 0, 0, 2], [0, 0, -1, 3], [0, 0, 0, 1]]))
    assert np.linalg.det(mirrored[:3, :3]) == pytest.approx(1.0)
    assert transform(mirrored, np.zeros(3)) == pytest.approx([1, 2, 3])
