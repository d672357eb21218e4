"""Characters play motions: rotations are copied whatever they rest in, feet stand, and what cannot be is told."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from scipy.spatial.transform import Rotation

from scenectl.bench.studies.characters import bench_characters, figures
from scenectl.data.characters import character_body
from scenectl.export.animation import Animation
from scenectl.retarget.characters.character import Character
from scenectl.retarget.characters.playing import Played, play
from scenes.body.gltf import read_rig
from scenes.errors import UserError
from scenes.motion.bones import rest_pose
from scenes.motion.motion import Motion
from scenes.motion.rigid import rigid
from scenes.motion.skeleton import HUMANML3D
from tests.scenectl.retarget.rigs import MIXAMO, SMALL, TALL, hero, small, tall
from tests.scenectl.retarget.walk import walk
from tests.scenes.body.rigs import Gltf, humanoid, other_person, robot

_AT = HUMANML3D.index
LIMBS = [(a, b) for a, b in HUMANML3D.bones if HUMANML3D.names[b].endswith(("elbow", "wrist"))]
LEGS = [(a, b) for a, b in HUMANML3D.bones if HUMANML3D.names[b].endswith(("knee", "ankle"))]


@pytest.fixture(scope="module")
def rigs(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    folder = tmp_path_factory.mktemp("rigs")
    return {"small": small().save(folder / "small.glb"), "tall": tall().save(folder / "tall.vrm")}


def played(path: Path, animation: Animation, **options: Any) -> tuple[Character, Played]:
    character = Character.load(path)
    motion = animation.skeleton, animation.rotations, animation.roots, animation.fps
    return character, play(character, *motion, **options)


def directions(joints: np.ndarray, bones: list[tuple[int, int]]) -> np.ndarray:
    way = np.stack([joints[:, b] - joints[:, a] for a, b in bones], axis=1)
    return way / np.linalg.norm(way, axis=-1, keepdims=True)


@pytest.mark.parametrize(("name", "height"), [("small", 1.5), ("tall", 1.95)])
def test_feet_stand_bones_are_rigid_and_arms_are_ours(rigs: dict[str, Path], name: str, height: float) -> None:
    animation = walk(4.0)
    character, result = played(rigs[name], animation)
    assert np.ptp(character.rig.triangles[..., 1]) == pytest.approx(height, abs=0.03)
    found = figures(character, result, animation)
    assert len(result.stands) >= 10
    assert found["slide_max_m"] < 1e-6 and found["sink_max_m"] < 0.01 and found["float_max_m"] < 0.01
    assert found["stretch_max_m"] < 1e-9 and found["arm_max_deg"] < 1e-3 and found["knee_min_deg"] > 0
    assert found["turn_max_deg"] < 20
    assert result.ratio == pytest.approx(character.skeleton.legs / HUMANML3D.legs)
    steps = np.linalg.norm(result.joints[-1, 0] - result.joints[0, 0])
    assert steps == pytest.approx(result.ratio * np.linalg.norm(animation.roots[-1] - animation.roots[0]), rel=0.01)


@pytest.mark.parametrize("name", ["small", "tall"])
def test_written_nodes_are_where_the_joints_are(rigs: dict[str, Path], name: str) -> None:
    character, result = played(rigs[name], walk(1.0))
    places = result.worlds(character.file)[..., :3, 3]
    for joint, node in character.joints.items():
        if not joint.endswith("foot"):
            np.testing.assert_allclose(places[:, node], result.joints[:, _AT(joint)], atol=1e-6)
    scales = np.linalg.norm(result.worlds(character.file)[..., :3, 0], axis=-1)
    np.testing.assert_allclose(scales, np.tile(np.linalg.norm(character.file.world[:, :3, 0], axis=-1), (20, 1)))


def test_our_own_skeleton_plays_our_own_rotations(tmp_path: Path) -> None:
    place = rest_pose(HUMANML3D).numpy() + np.array([0.0, 1.0, 0.0])
    animation = walk(2.0)
    character, result = played(humanoid(place=place).save(tmp_path / "ours.glb"), animation)
    assert result.ratio == pytest.approx(1) and not result.stands
    np.testing.assert_allclose(result.joints, animation.joints, atol=1e-6)
    for joint, node in character.joints.items():
        ours = Rotation.from_quat(animation.rotations[:, _AT(joint)], scalar_first=True)
        theirs = Rotation.from_quat(result.rotations[node], scalar_first=True)
        assert (ours.inv() * theirs).magnitude().max() < 1e-6, joint


@pytest.mark.parametrize("name", ["small", "tall"])
def test_a_motion_that_was_made_for_a_character_lands_exactly(rigs: dict[str, Path], name: str) -> None:
    body = character_body(rigs[name])
    joints = rigid(Motion(torch.from_numpy(walk(2.0).joints)), body.skeleton).joints
    animation, moved = Animation.of(Motion(joints, skeleton=body.skeleton))
    character, result = played(rigs[name], animation)
    assert moved == 0 and result.ratio == 1 and result.lowered == 0
    np.testing.assert_allclose(result.joints, joints, atol=1e-4)
    places = result.worlds(character.file)[..., :3, 3]
    wrist = places[:, character.joints["right_wrist"]]
    np.testing.assert_allclose(wrist, joints[:, _AT("right_wrist")], atol=1e-4)


def test_how_a_character_rests_and_is_built_is_not_seen_in_the_world(tmp_path: Path) -> None:
    animation = walk(2.0, heading=0.7)
    names = [f"mixamorig:{name}" for name in MIXAMO]
    kinds: list[dict[str, Any]] = [
        {}, {"axes": np.random.default_rng(1)}, {"scale": 0.01}, {"z_up": True},
        {"axes": np.random.default_rng(2), "scale": 100.0, "z_up": True},
    ]  # fmt: skip
    _, plain = played(hero(SMALL, names).save(tmp_path / "0.glb"), animation)
    for number, kind in enumerate(kinds):
        _, other = played(hero(SMALL, names, **kind).save(tmp_path / f"{number}.glb"), animation)
        np.testing.assert_allclose(other.joints, plain.joints, atol=2e-5)
        np.testing.assert_allclose(other.turns, plain.turns, atol=1e-4)


@pytest.mark.parametrize("turn", [[0, 180, 0], [0, 35, 0]])
def test_a_turned_armature_leaves_world_joints(tmp_path: Path, turn: list[float]) -> None:
    animation = walk(1.0)
    _, plain = played(humanoid(place=other_person()).save(tmp_path / "a.glb"), animation)
    file = humanoid(place=other_person())
    file.facts["nodes"][0]["rotation"] = Rotation.from_euler("xyz", turn, degrees=True).as_quat().tolist()
    _, turned = played(file.save(tmp_path / "b.glb"), animation)
    np.testing.assert_allclose(turned.joints, plain.joints, atol=1e-4)


def test_limbs_point_as_ours_where_no_foot_is_held(rigs: dict[str, Path]) -> None:
    animation = walk(3.0)
    for path in rigs.values():
        _, result = played(path, animation)
        free = np.ones(animation.frames, dtype=bool)
        for stand in result.stands:
            free[max(stand.begin - 4, 0) : stand.end + 4] = False
        np.testing.assert_allclose(directions(result.joints, LIMBS), directions(animation.joints, LIMBS), atol=1e-5)
        assert np.isfinite(directions(result.joints, LEGS)[free]).all()
    rising = animation.roots[:8] + np.arange(8)[:, None]
    jump = replace(animation, rotations=animation.rotations[:8], roots=rising)
    _, result = played(rigs["small"], jump)
    assert not result.stands
    np.testing.assert_allclose(directions(result.joints, LEGS), directions(jump.joints, LEGS), atol=1e-4)


def test_roots_that_stay_keep_the_turns_of_roots_that_walk(rigs: dict[str, Path]) -> None:
    _, goes = played(rigs["small"], walk(2.0))
    _, stays = played(rigs["small"], walk(2.0), travels=False)
    np.testing.assert_allclose(goes.turns, stays.turns)
    assert np.ptp(stays.joints[:, 0, [0, 2]], axis=0).max() < 1e-9
    np.testing.assert_allclose(stays.joints[:, 0, 1], goes.joints[:, 0, 1])


def test_vrm_0_and_1_name_the_same_bones(tmp_path: Path) -> None:
    file = tall()
    one = read_rig(file.save(tmp_path / "one.vrm"))
    bones = file.facts["extensions"].pop("VRMC_vrm")["humanoid"]["humanBones"]
    rows = [{"bone": name, **bone} for name, bone in bones.items()]
    file.facts["extensions"]["VRM"] = {"humanoid": {"humanBones": rows}}
    zero = read_rig(file.save(tmp_path / "zero.vrm"))
    assert zero.known == one.known and len(one.known) == 19
    assert one.known["left_knee"] == "bone.004"


def test_spines_are_told_by_the_tree_and_toes_may_be_missing(tmp_path: Path) -> None:
    file = small()
    for node in file.facts["nodes"]:
        if str(node.get("name", "")).endswith(("ToeBase", "Toe_End")):
            node["name"] = "something"
    character = Character.load(file.save(tmp_path / "toeless.glb"))
    names = {joint: character.file.nodes[node]["name"] for joint, node in character.joints.items()}
    assert [names[f"spine{k}"] for k in (1, 2, 3)] == ["mixamorig:Spine", "mixamorig:Spine1", "mixamorig:Spine2"]
    assert "left_foot" not in names
    animation = walk(2.0)
    _, result = played(tmp_path / "toeless.glb", animation)
    assert figures(character, result, animation)["stretch_max_m"] < 1e-9


@pytest.mark.parametrize("joints", [("Foot",), ("UpLeg", "Shoulder"), ("Arm", "Foot", "Head")])
def test_joints_that_hang_elsewhere_go_with_their_body(tmp_path: Path, joints: tuple[str, ...]) -> None:
    whole, apart, animation = small(), small(), walk(2.0)
    at = Character.load(whole.save(tmp_path / "whole.glb")).origins
    nodes = apart.facts["nodes"]
    for k, node in enumerate(nodes):
        if str(node.get("name")).removeprefix("mixamorig:").removeprefix("Left").removeprefix("Right") in joints:
            above = next(n for n in nodes if k in n.get("children", ()))
            above["children"].remove(k)
            nodes[1]["children"].append(k)
            node["translation"] = (at[k] - at[1]).tolist()
    for node in nodes:
        if node.get("children") == []:
            del node["children"]
    apart.save(tmp_path / "apart.glb")
    (_, expected), (character, found) = (played(tmp_path / f"{name}.glb", animation) for name in ("whole", "apart"))
    assert len(character.loose) >= len(joints)
    np.testing.assert_allclose(found.joints, expected.joints, atol=1e-9)
    worlds = found.worlds(character.file)
    for joint, node in character.joints.items():
        if not joint.endswith("foot"):
            np.testing.assert_allclose(worlds[:, node, :3, 3], expected.joints[:, _AT(joint)], atol=1e-9)
    measured = figures(character, found, animation)
    assert measured["stretch_max_m"] < 1e-6 and measured["slide_max_m"] < 0.02 and measured["sink_max_m"] < 0.01


def test_neck_head_and_pelvis_are_told_by_a_spine_of_one_name(tmp_path: Path) -> None:
    file = small()
    spine = ("Hips", "Spine", "Spine1", "Spine2", "Neck", "Head")
    for node in file.facts["nodes"]:
        name = str(node.get("name")).removeprefix("mixamorig:")
        if name in spine:
            node["name"] = f"DEF-spine.{spine.index(name):03}"
        elif name != str(node.get("name")):
            node["name"] = f"DEF-{name}"
    character = Character.load(file.save(tmp_path / "spine.glb"))
    names = {joint: character.file.nodes[node]["name"] for joint, node in character.joints.items()}
    ours = ("pelvis", "spine1", "spine2", "spine3", "neck", "head")
    assert [names[joint] for joint in ours] == [f"DEF-spine.{k:03}" for k in range(6)]


def test_the_pelvis_is_what_spine_and_legs_hang_on(tmp_path: Path) -> None:
    file = small()
    nodes = file.facts["nodes"]
    hips = next(node for node in nodes if node.get("name") == "mixamorig:Hips")
    legs = [k for k in hips["children"] if nodes[k]["name"].endswith("UpLeg")]
    hips["children"] = [*(k for k in hips["children"] if k not in legs), len(nodes)]
    hips["name"] = "mixamorig:Hip"
    nodes.append({"name": "mixamorig:Pelvis", "children": legs})
    file.facts["skins"][0]["joints"].append(len(nodes) - 1)
    inverse = file.facts["accessors"][file.facts["skins"][0].pop("inverseBindMatrices")]
    assert inverse["count"] == len(file.facts["skins"][0]["joints"]) - 1
    character = Character.load(file.save(tmp_path / "two.glb"))
    assert character.file.nodes[character.joints["pelvis"]]["name"] == "mixamorig:Hip"


def test_the_bench_has_a_row_for_each_character_and_motion(rigs: dict[str, Path], tmp_path: Path) -> None:
    np.savez(tmp_path / "walk.npz", joints=walk(2.0).joints.astype(np.float32), fps=20.0)
    result = bench_characters([*rigs.values()], [tmp_path / "walk.npz"])
    assert [row["character"] for row in result["rows"]] == ["small.glb", "tall.vrm"]
    assert result["summary"]["slide_max_m"] < 0.02 and result["summary"]["sink_max_m"] < 0.01


# ---- what cannot be -------------------------------------------------------------------------------------------------


def test_characters_that_cannot_play_are_told(tmp_path: Path) -> None:
    bare = Gltf()
    bare.facts["nodes"].append({"name": "box"})
    with pytest.raises(UserError, match=r"character file '.*bare\.glb' has no skin"):
        Character.load(bare.save(tmp_path / "bare.glb"))
    with pytest.raises(UserError, match=r"ends with '\.urdf'; \.glb, \.gltf, \.vrm are read"):
        Character.load(robot(tmp_path))
    creature = hero(TALL, [f"limb{j}" for j in range(22)])
    with pytest.raises(UserError, match=r"no joint found for .*left_hip.* among limb0, limb1"):
        Character.load(creature.save(tmp_path / "creature.glb"))
    with pytest.raises(UserError, match=r"nobody\.glb"):
        Character.load(tmp_path / "nobody.glb")


def test_a_mapping_says_which_is_which(tmp_path: Path) -> None:
    names = [f"limb{j}" for j in range(22)]
    path = hero(TALL, names).save(tmp_path / "creature.glb")
    stated = dict(zip(HUMANML3D.names, names, strict=True))
    character = Character.load(path, stated)
    assert [character.file.nodes[character.joints[j]]["name"] for j in HUMANML3D.names] == names
    with pytest.raises(UserError, match="joint 'limb99', stated as neck, is not in the file; did you mean 'limb9'"):
        Character.load(path, {**stated, "neck": "limb99"})


def test_vrm_extensions_that_are_broken_are_told(tmp_path: Path) -> None:
    file = tall()
    file.facts["extensions"]["VRMC_vrm"]["humanoid"]["humanBones"]["head"]["node"] = 999
    with pytest.raises(UserError, match="there is no node 999"):
        read_rig(file.save(tmp_path / "a.vrm"))
    file.facts["extensions"]["VRMC_vrm"] = {"humanoid": json.loads("[1]")}
    with pytest.raises(UserError):
        read_rig(file.save(tmp_path / "b.vrm"))
