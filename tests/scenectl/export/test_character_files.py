"""Characters in files with their motions: all that was there is still there, and a second reader finds the joints."""

from __future__ import annotations

import json
import struct
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from pygltflib import GLTF2
from scipy.spatial.transform import Rotation

from scenectl.export.export import export
from scenectl.retarget.characters.character import Character
from scenectl.retarget.characters.playing import play
from scenes.errors import UserError
from scenes.motion.motion import Motion
from scenes.motion.skeleton import HUMANML3D
from scenes.world.scene import Scene
from tests.scenectl.retarget.rigs import small, tall
from tests.scenectl.retarget.walk import walk


@pytest.fixture(scope="module")
def heroes(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    folder = tmp_path_factory.mktemp("heroes")
    plain, vrm = small(), tall()
    for file in (plain, vrm):
        file.facts["extras"] = {"made": "by hand"}
        file.facts["nodes"][3]["extras"] = {"weight": 3}
        file.facts["materials"] = [{"name": "cloth", "extensions": {"KHR_materials_unlit": {}}}]
        file.facts["meshes"][0]["primitives"][0] |= {"material": 0, "mode": 4}
        file.facts["extensionsUsed"] = [*file.facts.get("extensionsUsed", ()), "KHR_materials_unlit"]
    return {"small": plain.save(folder / "small.glb"), "tall": vrm.save(folder / "tall.vrm")}


@pytest.fixture(scope="module")
def motion() -> Motion:
    return Motion(torch.from_numpy(walk(1.5).joints))


def facts_of(path: Path) -> dict[str, Any]:
    data = path.read_bytes()
    found: dict[str, Any] = json.loads(data[20 : 20 + struct.unpack_from("<I", data, 12)[0]])
    return found


def rows(gltf: GLTF2, index: int) -> np.ndarray:
    accessor, width = gltf.accessors[index], {"SCALAR": 1, "VEC3": 3, "VEC4": 4}
    view = gltf.bufferViews[accessor.bufferView]
    start = (view.byteOffset or 0) + (accessor.byteOffset or 0)
    count = accessor.count * width[accessor.type]
    return np.frombuffer(gltf.binary_blob(), "<f4", count, start).reshape(accessor.count, -1)


def places(path: Path, number: int, frame: int) -> np.ndarray:
    """World positions of all nodes in a frame of an animation, by pygltflib and scipy alone."""
    gltf = GLTF2().load_binary(str(path))
    moved: dict[tuple[int, str], np.ndarray] = {}
    animation = gltf.animations[number]
    for channel in animation.channels:
        keys = rows(gltf, animation.samplers[channel.sampler].output)
        moved[channel.target.node, channel.target.path] = keys[frame]
    parents = {child: node for node, facts in enumerate(gltf.nodes) for child in facts.children or ()}

    def world(node: int) -> np.ndarray:
        facts, local = gltf.nodes[node], np.eye(4)
        if facts.matrix is not None:
            local = np.array(facts.matrix).reshape(4, 4).T
        else:
            turn = moved.get((node, "rotation"), facts.rotation or [0, 0, 0, 1])
            local[:3, :3] = Rotation.from_quat(turn).as_matrix() * np.array(facts.scale or [1, 1, 1])
            local[:3, 3] = moved.get((node, "translation"), facts.translation or [0, 0, 0])
        return world(parents[node]) @ local if node in parents else local

    return np.stack([world(node)[:3, 3] for node in range(len(gltf.nodes))])


@pytest.mark.parametrize(("name", "out"), [("small", "out.glb"), ("tall", "out.vrm"), ("tall", "out.glb")])
@pytest.mark.parametrize("fps", [20.0, 30.0, 60.0])
def test_a_second_reader_finds_joints_and_times(
    heroes: dict[str, Path], motion: Motion, tmp_path: Path, name: str, out: str, fps: float
) -> None:
    export(motion, tmp_path / out, character=heroes[name], fps=fps)
    animation = walk(1.5).resampled(fps)
    character = Character.load(heroes[name])
    played = play(character, animation.skeleton, animation.rotations, animation.roots, fps)
    gltf = GLTF2().load_binary(str(tmp_path / out))
    times = rows(gltf, gltf.animations[0].samplers[0].input)[:, 0]
    np.testing.assert_allclose(times, np.arange(len(times)) / fps, atol=1e-5)
    assert gltf.animations[0].extras["fps"] == fps
    for frame in (0, len(times) // 2, len(times) - 1):
        found = places(tmp_path / out, 0, frame)
        for joint, node in character.joints.items():
            if not joint.endswith("foot"):
                np.testing.assert_allclose(found[node], played.joints[frame, HUMANML3D.index(joint)], atol=1e-3)


def test_accessors_without_a_view_get_no_offset(motion: Motion, tmp_path: Path) -> None:
    file = small()
    mesh = file.facts["meshes"][0]["primitives"][0]
    count = file.facts["accessors"][mesh["attributes"]["POSITION"]]["count"]
    nothing = {"componentType": 5126, "type": "VEC3", "count": count, "min": [0.0] * 3, "max": [0.0] * 3}
    mesh["targets"] = [{"POSITION": len(file.facts["accessors"])}]
    file.facts["accessors"].append(nothing)  # a morph that is nothing yet, as Blender writes them: sparse, or bare
    export(motion, tmp_path / "out.glb", character=file.save(tmp_path / "morph.glb"))
    written = facts_of(tmp_path / "out.glb")
    assert written["meshes"][0]["primitives"][0]["targets"] == mesh["targets"]
    assert "byteOffset" not in written["accessors"][mesh["targets"][0]["POSITION"]]


@pytest.mark.parametrize("name", ["small", "tall"])
def test_all_that_the_file_held_is_still_there(
    heroes: dict[str, Path], motion: Motion, tmp_path: Path, name: str
) -> None:
    export(motion, tmp_path / "out.glb", character=heroes[name])
    before, after = facts_of(heroes[name]), facts_of(tmp_path / "out.glb")
    for key in ("extras", "extensions", "extensionsUsed", "skins", "scenes"):
        assert after.get(key) == before.get(key), key
    for key in ("nodes", "materials", "meshes"):
        for a, b in zip(before[key], after[key], strict=True):
            assert {k: b.get(k) for k in a} == a
    blob = heroes[name].read_bytes()
    start = 28 + struct.unpack_from("<I", blob, 12)[0]
    assert blob[start : start + before["buffers"][0]["byteLength"]] in (tmp_path / "out.glb").read_bytes()


def test_animations_come_first_one_a_motion_and_old_ones_stay(
    heroes: dict[str, Path], motion: Motion, tmp_path: Path
) -> None:
    two = Motion(motion.joints[None].repeat(2, 1, 1, 1))
    export(two, tmp_path / "walks.glb", character=heroes["small"])
    export(motion, tmp_path / "more.glb", character=tmp_path / "walks.glb")
    export(two, tmp_path / "walks.glb", character=tmp_path / "more.glb")
    names = [animation["name"] for animation in facts_of(tmp_path / "walks.glb")["animations"]]
    assert names == ["walks_0", "walks_1", "more"]
    first, later = (places(tmp_path / "walks.glb", 0, frame) for frame in (0, 20))
    assert np.linalg.norm(later - first, axis=-1).max() > 0.5


def test_nodes_that_rest_by_a_matrix_can_be_animated(motion: Motion, tmp_path: Path) -> None:
    file, same = tall(), tall()
    for node in file.facts["nodes"][1:-1]:
        local = np.eye(4)
        turn = Rotation.from_quat(node.pop("rotation", [0, 0, 0, 1])).as_matrix()
        local[:3, :3] = turn * np.array(node.pop("scale", [1, 1, 1]))
        local[:3, 3] = node.pop("translation", [0, 0, 0])
        node["matrix"] = local.T.ravel().tolist()
    for name, one in (("matrix", file), ("plain", same)):
        export(motion, tmp_path / f"{name}_out.glb", character=one.save(tmp_path / f"{name}.vrm"))
    found = [places(tmp_path / f"{name}_out.glb", 0, 15) for name in ("matrix", "plain")]
    np.testing.assert_allclose(*found, atol=1e-4)
    animated = {c["target"]["node"] for c in facts_of(tmp_path / "matrix_out.glb")["animations"][0]["channels"]}
    assert not any("matrix" in facts_of(tmp_path / "matrix_out.glb")["nodes"][node] for node in animated)


def test_the_room_comes_with_the_character(heroes: dict[str, Path], motion: Motion, tmp_path: Path) -> None:
    from scenes.mesh.primitives import Box

    scene = Scene(primitives=[Box((0.0, 0.5, 0.0), (1.0, 1.0, 1.0))], name="room")
    export(motion, tmp_path / "out.glb", character=heroes["small"], scene=scene)
    facts = facts_of(tmp_path / "out.glb")
    assert "room" in [node.get("name") for node in facts["nodes"]] and len(facts["meshes"]) > 1


def test_what_cannot_be_written_is_told(heroes: dict[str, Path], motion: Motion, tmp_path: Path) -> None:
    with pytest.raises(UserError, match=r"small\.glb' is no VRM, and '.*out\.vrm' would be none; write a \.glb"):
        export(motion, tmp_path / "out.vrm", character=heroes["small"])
    with pytest.raises(UserError, match=r"a \.vrm file is a VRM character; give one"):
        export(motion, tmp_path / "out.vrm")
    with pytest.raises(UserError, match="joint 'nobody', stated as neck, is not in the file"):
        export(motion, tmp_path / "out.glb", character=heroes["small"], joints={"neck": "nobody"})
    assert not list(tmp_path.iterdir())
