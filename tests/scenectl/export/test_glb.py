"""GLB files of motions, read by a reader of the tests' own: the standard's words, without the library that wrote."""

from __future__ import annotations

import json
import struct
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from scipy.interpolate import interp1d
from scipy.spatial.transform import Rotation, Slerp

from scenectl.export.animation import Animation
from scenectl.export.export import export
from scenectl.export.glb import COLOURS, write
from scenectl.export.mannequin import Mannequin
from scenectl.export.names import PRESETS
from scenectl.export.settings import Settings
from scenectl.tasks.task import load_task
from scenes.errors import UserError
from scenes.mesh.mesh import Mesh
from scenes.mesh.primitives import Box, Capsule, Sphere
from scenes.motion.kinematics import forward
from scenes.motion.motion import Motion
from scenes.motion.skeleton import HUMANML3D, Skeleton
from scenes.motion.waypoints import Waypoints
from scenes.world.moving import MovingObject, Trajectory
from scenes.world.scene import Scene

KINDS = {5121: "<u1", 5123: "<u2", 5125: "<u4", 5126: "<f4"}
WIDTHS = {"SCALAR": 1, "VEC3": 3, "VEC4": 4, "MAT4": 16}


class File:
    """A GLB file as the specification reads."""

    def __init__(self, path: Path) -> None:
        data = path.read_bytes()
        magic, version, length, size, kind = struct.unpack_from("<4sIIII", data)
        assert (magic, version, length, kind) == (b"glTF", 2, len(data), 0x4E4F534A)
        self.facts: dict[str, Any] = json.loads(data[20 : 20 + size])
        rest, kind = struct.unpack_from("<II", data, 20 + size)
        assert kind == 0x004E4942 and 28 + size + rest == len(data) and self.facts["buffers"][0]["byteLength"] <= rest
        self.binary = data[28 + size :]
        self.nodes = self.facts["nodes"]
        self.parents = {child: k for k, node in enumerate(self.nodes) for child in node.get("children", ())}
        self.named = {node["name"]: k for k, node in reversed(list(enumerate(self.nodes)))}

    def rows(self, index: int) -> np.ndarray:
        facts = self.facts["accessors"][index]
        view = self.facts["bufferViews"][facts["bufferView"]]
        start, kind = view.get("byteOffset", 0) + facts.get("byteOffset", 0), np.dtype(KINDS[facts["componentType"]])
        count = facts["count"] * WIDTHS[facts["type"]]
        assert start % 4 == 0 and count * kind.itemsize <= view["byteLength"]
        rows = np.frombuffer(self.binary, kind, count, start).reshape(facts["count"], -1)
        if "min" in facts:
            assert facts["min"] == rows.min(axis=0).tolist() and facts["max"] == rows.max(axis=0).tolist()
        return rows

    def times(self, number: int) -> np.ndarray:
        """Times of all keys of an animation."""
        samplers = self.facts["animations"][number]["samplers"]
        return np.unique(np.concatenate([self.rows(sampler["input"])[:, 0] for sampler in samplers]))

    def world(self, node: int, number: int | None = None, time: float = 0.0) -> np.ndarray:
        """Frame of a node in the world, at rest or in an animation at a time (s)."""
        facts = self.nodes[node]
        local = {"translation": facts.get("translation", [0, 0, 0]), "rotation": facts.get("rotation", [0, 0, 0, 1])}
        for channel in self.facts["animations"][number]["channels"] if number is not None else ():
            if channel["target"]["node"] == node:
                sampler = self.facts["animations"][number]["samplers"][channel["sampler"]]
                assert sampler.get("interpolation", "LINEAR") == "LINEAR"
                times, keys = self.rows(sampler["input"])[:, 0], self.rows(sampler["output"])
                turns = channel["target"]["path"] == "rotation"
                between = interp1d(times, keys, axis=0) if not turns else Slerp(times, Rotation.from_quat(keys))
                at = between(np.clip(time, times[0], times[-1]))
                local[channel["target"]["path"]] = at.as_quat() if turns else at
        frame = np.eye(4)
        frame[:3, :3] = Rotation.from_quat(local["rotation"]).as_matrix()
        frame[:3, 3] = local["translation"]
        return frame if node not in self.parents else self.world(self.parents[node], number, time) @ frame

    def skinned(self, mesh_node: int, number: int | None = None, time: float = 0.0) -> np.ndarray:
        """Vertices of a skinned mesh in the world."""
        facts, skin = self.nodes[mesh_node], self.facts["skins"][self.nodes[mesh_node]["skin"]]
        assert mesh_node not in self.parents  # nobody else moves it
        attributes = self.facts["meshes"][facts["mesh"]]["primitives"][0]["attributes"]
        inverse = self.rows(skin["inverseBindMatrices"]).reshape(-1, 4, 4).transpose(0, 2, 1)
        frames = np.stack([self.world(joint, number, time) for joint in skin["joints"]]) @ inverse
        joints, weights = self.rows(attributes["JOINTS_0"]), self.rows(attributes["WEIGHTS_0"])
        np.testing.assert_allclose(weights.sum(axis=1), 1.0, atol=1e-6)
        held = (frames[joints] * weights[..., None, None]).sum(axis=1)
        vertices = self.rows(attributes["POSITION"])
        return (held[:, :3, :3] @ vertices[..., None])[..., 0] + held[:, :3, 3]

    def triangles(self, node: int, number: int | None = None, time: float = 0.0) -> np.ndarray:
        """Triangles of a node's mesh in the world, ``[F, 3, 3]``."""
        found, frame = [], self.world(node, number, time)
        for primitive in self.facts["meshes"][self.nodes[node]["mesh"]]["primitives"]:
            corners = self.rows(primitive["attributes"]["POSITION"])[self.rows(primitive["indices"])[:, 0]]
            normals = self.rows(primitive["attributes"]["NORMAL"])[self.rows(primitive["indices"])[:, 0]]
            flat = np.cross(corners[1::3] - corners[::3], corners[2::3] - corners[::3])
            assert ((normals[::3] * flat).sum(axis=1) > 0).all()
            found.append((corners @ frame[:3, :3].T + frame[:3, 3]).reshape(-1, 3, 3))
        return np.concatenate(found)


def motion(samples: int = 2, frames: int = 25, fps: float = 20.0, skeleton: Skeleton = HUMANML3D) -> Motion:
    """People who swing all joints along sines and walk."""
    time = torch.arange(frames, dtype=torch.float64) / fps
    generator = torch.Generator().manual_seed(3)
    axis = torch.nn.functional.normalize(
        torch.randn(samples, 1, 22, 3, generator=generator, dtype=torch.float64), dim=-1
    )
    rate = torch.rand(samples, 1, 22, 1, generator=generator, dtype=torch.float64) * 4
    angle = 0.4 * torch.sin(rate * time[:, None, None] + rate)
    quaternions = torch.cat([angle.cos(), angle.sin() * axis], dim=-1)
    roots = torch.stack([time.sin(), 0.9 + 0.1 * time.cos(), time], dim=-1).expand(samples, -1, -1)
    joints = forward(quaternions, roots, skeleton)
    return Motion(joints, fps=fps, skeleton=skeleton)


def cube(name: str, at: float) -> Mesh:
    shape = Box((at, 0.5, 0.0), (1.0, 1.0, 1.0)).mesh()
    return Mesh(shape.vertices, shape.faces, name)


def room() -> Scene:
    turning = Trajectory([0.0, 1.0, 2.0], [(0, 0, 0), (1, 0, 0), (1, 1, 0)], headings=[0.0, 2.0, -1.0])
    way = Waypoints([0.0, 2.0], [(0.0, 1.0, 0.0), (0.0, 1.0, 4.0)])
    return Scene(
        [cube("chest", 3.0)],
        [
            Box((0.0, 1.0, 5.0), (2.0, 2.0, 0.1), yaw=0.3),
            Sphere((0.0, 1.0, 0.0), 0.3, motion=way),
            Capsule((0.0, 0.0, 0.0), (0.0, 1.0, 0.0), 0.2, motion=way),
        ],
        objects=[MovingObject(cube("door", 0.5), turning)],
        floor=0.0,
    )


@pytest.fixture(scope="module")
def in_room(tmp_path_factory: pytest.TempPathFactory) -> tuple[File, Motion, Scene]:
    path, scene, people = tmp_path_factory.mktemp("glb") / "people.glb", room(), motion()
    export(people, path, scene=scene, t0=0.25)
    return File(path), people, scene


def same(a: np.ndarray, b: np.ndarray) -> None:
    """The same triangles in any order, each from any of its corners."""
    assert a.shape == b.shape

    def ordered(triangles: np.ndarray) -> np.ndarray:
        first = (triangles.round(4) + 0.0) @ [1.0, 1e-3, 1e-6]
        turned = np.take_along_axis(triangles, (first.argmin(1)[:, None] + np.arange(3))[..., None] % 3, axis=1)
        rows = turned.reshape(-1, 9)
        return rows[np.lexsort((rows.round(3) + 0.0).T)]

    np.testing.assert_allclose(ordered(a), ordered(b), atol=1e-5)


@pytest.mark.parametrize("fps", [20.0, 30.0, 60.0])
def test_joints_are_where_the_motion_has_them(fps: float, tmp_path: Path) -> None:
    people = motion()
    export(people, tmp_path / "a.glb", fps=fps)
    file = File(tmp_path / "a.glb")
    for number, one in enumerate(people.joints):
        times = file.times(number)
        assert file.facts["animations"][number]["extras"] == {"fps": fps}
        np.testing.assert_allclose(times, np.arange(len(times)) / fps, atol=1e-6)
        assert times[-1] == pytest.approx((len(one) - 1) / people.fps, abs=1 / fps)
        for frame, time in enumerate(np.arange(len(one)) / people.fps):
            if np.abs(times - time).min() > 1e-6:
                continue  # between keys, where lines and arcs differ
            for joint in (0, 4, 10, 15, 20, 21):
                place = file.world(file.named[HUMANML3D.names[joint]], number, time)[:3, 3]
                assert np.abs(place - one[frame, joint].numpy()).max() < 1e-3


def test_every_joint_of_every_frame(tmp_path: Path) -> None:
    people = motion(1, 4)
    export(people, tmp_path / "a.glb")
    file = File(tmp_path / "a.glb")
    found = [[file.world(file.named[name], 0, frame / 20.0)[:3, 3] for name in HUMANML3D.names] for frame in range(4)]
    np.testing.assert_allclose(found, people.joints[0].numpy(), atol=1e-5)


@pytest.mark.parametrize("preset", PRESETS)
@pytest.mark.parametrize("root_motion", [True, False])
def test_joints_stay_where_they_are_under_the_names_of_others(preset: str, root_motion: bool, tmp_path: Path) -> None:
    """A root that carries the pelvis, as some have it, moves it by its own track."""
    written = export(motion(1, 4), tmp_path / "a.glb", names=preset, root_motion=root_motion).animations[0]
    file = File(tmp_path / "a.glb")
    for frame in range(4):
        found = [file.world(file.named[name], 0, frame / 20.0)[:3, 3] for name in written.skeleton.names]
        np.testing.assert_allclose(found, written.joints[frame], atol=1e-5)


def test_at_rest_it_stands_in_the_t_pose_as_modelled(in_room: tuple[File, Motion, Scene]) -> None:
    file, *_ = in_room
    node = file.named["mannequin"]
    vertices, mannequin = file.skinned(node), Mannequin.bundled()
    primitive = file.facts["meshes"][file.nodes[node]["mesh"]]["primitives"][0]
    np.testing.assert_allclose(vertices, file.rows(primitive["attributes"]["POSITION"]), atol=1e-6)
    np.testing.assert_allclose(vertices - vertices.mean(0), mannequin.vertices - mannequin.vertices.mean(0), atol=1e-5)
    assert vertices[:, 1].min() == pytest.approx(0.0, abs=1e-6)
    assert (file.rows(primitive["indices"]).reshape(-1, 3) == mannequin.faces).all()
    for joint in file.facts["skins"][0]["joints"]:
        np.testing.assert_allclose(file.world(joint)[:3, :3], np.eye(3), atol=1e-9)


def test_a_person_is_a_node_that_holds_its_joints_and_nothing_else(tmp_path: Path) -> None:
    """Blender makes an armature of what holds the joints, be it all of the scene."""
    animations = [Animation.of(motion(1, skeleton=HUMANML3D.scaled(size))[0], "walk")[0] for size in (1.0, 0.7)]
    write(animations, tmp_path / "a.glb", Settings(scene=room()))
    file = File(tmp_path / "a.glb")
    joints = [skin["joints"] for skin in file.facts["skins"]]
    assert [file.nodes[file.parents[mine[0]]]["name"] for mine in joints] == ["person", "person 2"]
    for mine in joints:
        assert file.parents[mine[0]] not in file.parents
        assert [node for node in file.parents if ancestor(file, node) == file.parents[mine[0]]] == mine


def ancestor(file: File, node: int) -> int:
    """The node of the scene that holds a node."""
    return node if node not in file.parents else ancestor(file, file.parents[node])


def test_the_skin_follows_its_joints(in_room: tuple[File, Motion, Scene]) -> None:
    """The crown stays where it is on the head, in every animation."""
    file, people, _ = in_room
    node, head = file.named["mannequin"], file.named["head"]
    top = int(file.skinned(node)[:, 1].argmax())
    before = np.linalg.inv(file.world(head)) @ [*file.skinned(node)[top], 1.0]
    for number in range(len(people.joints)):
        after = np.linalg.inv(file.world(head, number, 0.7)) @ [*file.skinned(node, number, 0.7)[top], 1.0]
        np.testing.assert_allclose(after, before, atol=1e-3)


def test_the_room_stands_where_the_scene_has_it(in_room: tuple[File, Motion, Scene]) -> None:
    file, _, scene = in_room
    same(file.triangles(file.named["chest"]), scene.meshes[0].triangles)
    same(file.triangles(file.named["box"]), scene.primitives[0].mesh().triangles)  # type: ignore[union-attr]


def test_what_moves_is_where_the_scene_has_it(in_room: tuple[File, Motion, Scene]) -> None:
    file, people, scene = in_room
    for number in range(len(people.joints)):
        for frame in (0, 7, 24):
            time = frame / 20.0
            for name, thing in zip(("door", "sphere", "capsule"), scene.moving, strict=True):
                same(file.triangles(file.named[name], number, time), thing.mesh(0.25 + time).triangles)
    for name, thing in zip(("door", "sphere", "capsule"), scene.moving, strict=True):
        same(file.triangles(file.named[name]), thing.mesh(0.25).triangles)  # before anything is played


def test_motions_of_several_lengths_and_rates_share_a_room(tmp_path: Path) -> None:
    scene, rates = room(), (20.0, 30.0)
    animations = [Animation.of(motion(1, 6 * k, fps)[0])[0] for k, fps in enumerate(rates, 1)]
    write(animations, tmp_path / "a.glb", Settings(scene=scene))
    file = File(tmp_path / "a.glb")
    for number, animation in enumerate(animations):
        samplers = file.facts["animations"][number]["samplers"]
        counts = [len(file.rows(sampler[end])) for sampler in samplers for end in ("input", "output")]
        assert set(counts) == {animation.frames}
        end = float(animation.times[-1])
        same(file.triangles(file.named["door"], number, end), scene.objects[0].mesh(end).triangles)


def test_without_a_scene_there_is_nobody_else(tmp_path: Path) -> None:
    export(motion(1), tmp_path / "a.glb")
    file = File(tmp_path / "a.glb")
    assert len(file.facts["meshes"]) == 1 and len(file.nodes) == 24  # 22 joints, what holds them, and the mesh


def test_people_of_one_body_are_one_mannequin_and_others_are_their_own(tmp_path: Path) -> None:
    bodies = [HUMANML3D, HUMANML3D.scaled(0.7), HUMANML3D]
    animations = [Animation.of(motion(1, skeleton=body)[0], "walk")[0] for body in bodies]
    write(animations, tmp_path / "a.glb", Settings())
    file = File(tmp_path / "a.glb")
    assert [a["name"] for a in file.facts["animations"]] == ["walk", "walk 2", "walk 3"]
    assert len(file.facts["skins"]) == len(file.facts["meshes"]) == 2
    tall, small = (np.ptp(file.skinned(file.named[name])[:, 1]) for name in ("mannequin", "mannequin 2"))
    assert small == pytest.approx(0.7 * tall, rel=1e-6)
    targets = [{channel["target"]["node"] for channel in a["channels"]} for a in file.facts["animations"]]
    assert targets[0] == targets[2] and not targets[0] & targets[1]


def test_a_skeleton_with_more_joints_carries_the_same_skin(tmp_path: Path) -> None:
    """As presets have: a root on the ground."""
    animation, _ = Animation.of(motion(1)[0])
    offsets = ((0.0, 0.0, 0.0), (0.0, 0.96, 0.0), *HUMANML3D.offsets[1:])
    more = Skeleton(("base", *HUMANML3D.names), (-1, *(p + 1 for p in HUMANML3D.parents)), offsets)
    unturned = np.tile([[[1.0, 0.0, 0.0, 0.0]]], (animation.frames, 1, 1))
    rotations, roots = np.concatenate([unturned, animation.rotations], axis=1), animation.roots - [0.0, 0.96, 0.0]
    other = replace(animation, skeleton=more, rotations=rotations, roots=roots, ours=animation.ours + 1)
    write([animation], tmp_path / "a.glb", Settings())
    write([other], tmp_path / "b.glb", Settings())
    a, b = (File(tmp_path / f"{name}.glb") for name in "ab")
    for number, time in ((None, 0.0), (0, 0.5)):
        skins = [file.skinned(file.named["mannequin"], number, time) for file in (a, b)]
        np.testing.assert_allclose(*skins, atol=1e-5)


def test_scans_of_many_colours_keep_to_a_palette(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    shape = Sphere((0.0, 1.0, 0.0), 1.0).mesh()
    shades = np.random.default_rng(0).integers(0, 255, (len(shape.faces), 3)).astype(np.uint8)
    monkeypatch.setattr("scenectl.export.rooms.face_colours", lambda *_: shades)
    scan = Scene([Mesh(shape.vertices, shape.faces, "scan")])
    monkeypatch.setattr(Scene, "planes", ())
    export(motion(1), tmp_path / "a.glb", scene=scan)
    file = File(tmp_path / "a.glb")
    assert 1 < len(file.facts["materials"]) <= 1 + COLOURS
    same(file.triangles(file.named["scan"]), scan.meshes[0].triangles)


@pytest.mark.parametrize("frames", [1, 2])
def test_the_shortest_motions(frames: int, tmp_path: Path) -> None:
    export(motion(1, frames), tmp_path / "a.glb")
    assert len(File(tmp_path / "a.glb").times(0)) == frames


def test_a_path_that_cannot_be_written_is_told(tmp_path: Path) -> None:
    (tmp_path / "a.glb").mkdir()
    with pytest.raises(UserError, match="cannot write"):
        export(motion(1, 3), tmp_path / "a.glb")


@pytest.mark.parametrize("task", ["crossing_cart", "swinging_door", "moving_obstacle"])
def test_rooms_of_the_examples(task: str, tmp_path: Path) -> None:
    scene = load_task(Path(__file__).resolve().parents[3] / "examples" / "tasks" / f"{task}.toml").load_scene()
    export(motion(1, 5), tmp_path / "a.glb", scene=scene)
    file = File(tmp_path / "a.glb")
    assert {channel["target"]["node"] for channel in file.facts["animations"][0]["channels"]} - set(range(22))
