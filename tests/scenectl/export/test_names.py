"""Presets: the joints that tools expect, and ours where they were."""

from __future__ import annotations

import re

import numpy as np
import pytest
import torch

from scenectl.data.joint_names import match_joints
from scenectl.export.animation import Animation
from scenectl.export.names import PRESETS, named
from scenes.errors import UserError
from scenes.motion.kinematics import forward
from scenes.motion.skeleton import HUMANML3D
from tests.scenectl.export.moving import moving

TREES = {
    "mixamo": "mixamorig:Hips mixamorig:Spine mixamorig:Spine1 mixamorig:Spine2 mixamorig:Neck mixamorig:Head",
    "unreal": "root pelvis spine_01 spine_02 spine_03 spine_04 spine_05 neck_01 neck_02 head",
    "unity": "Hips Spine Chest UpperChest Neck Head",
    "vrm": "hips spine chest upperChest neck head",
    "soma": "Root Hips Spine1 Spine2 Chest Neck1 Neck2 Head",
}
"""From the root to the head, as the tools' own skeletons hang."""
LIMBS = {
    "mixamo": ("LeftShoulder LeftArm LeftForeArm LeftHand", "RightUpLeg RightLeg RightFoot RightToeBase"),
    "unreal": ("clavicle_l upperarm_l lowerarm_l hand_l", "thigh_r calf_r foot_r ball_r"),
    "unity": ("LeftShoulder LeftUpperArm LeftLowerArm LeftHand", "RightUpperLeg RightLowerLeg RightFoot RightToes"),
    "vrm": ("leftShoulder leftUpperArm leftLowerArm leftHand", "rightUpperLeg rightLowerLeg rightFoot rightToes"),
    "soma": ("LeftShoulder LeftArm LeftForeArm LeftHand", "RightLeg RightShin RightFoot RightToeBase"),
}  # fmt: skip


def mirrored(name: str) -> str:
    """The joint of the other side."""
    sides = {"Left": "Right", "Right": "Left", "left": "right", "right": "left", "_l": "_r", "_r": "_l"}
    return re.sub("Left|Right|left|right|_[lr]$", lambda found: sides[found[0]], name)


@pytest.fixture(params=PRESETS)
def preset(request: pytest.FixtureRequest) -> str:
    return str(request.param)


def test_our_joints_stand_and_turn_as_they_did(preset: str) -> None:
    animation = Animation.of(moving())[0]
    made = named(animation, preset)
    assert len(set(made.ours.tolist())) == 22
    np.testing.assert_allclose(made.joints[:, made.ours], animation.joints, atol=1e-9)
    same = np.abs((made.orientations[:, made.ours] * animation.orientations).sum(-1))
    np.testing.assert_allclose(same, 1, atol=1e-9)


def test_translations_and_rotations_alone_give_the_joints(preset: str) -> None:
    """The way of any reader: each joint at its place in the frame of its parent."""
    made = named(Animation.of(moving())[0], preset)
    for frame in (0, 17, 39):
        places = made.translations[frame]
        skeleton = type(made.skeleton)(made.skeleton.names, made.skeleton.parents, tuple(map(tuple, places)))
        joints = forward(torch.from_numpy(made.rotations[frame]), torch.from_numpy(places[0]), skeleton)
        np.testing.assert_allclose(joints.numpy(), made.joints[frame], atol=1e-9)


@pytest.mark.parametrize("preset", TREES)
def test_joints_hang_as_in_the_tool(preset: str) -> None:
    skeleton = named(Animation.of(moving(2))[0], preset).skeleton

    def up(name: str) -> list[str]:
        joint, way = skeleton.index(name), []
        while joint >= 0:
            way.insert(0, skeleton.names[joint])
            joint = skeleton.parents[joint]
        return way

    spine = TREES[preset].split()
    assert up(spine[-1]) == spine
    prefix = "mixamorig:" if preset == "mixamo" else ""
    (arm, leg) = ([prefix + name for name in limb.split()] for limb in LIMBS[preset])
    chest = spine[: -2 if preset in ("mixamo", "unity", "vrm") else -3]
    assert up(arm[-1]) == [*chest, *arm]
    hips = spine[: 2 if preset in ("unreal", "soma") else 1]
    assert up(leg[-1]) == [*hips, *leg]
    for name in skeleton.names:  # every joint of a side has its like on the other
        if name != (other := mirrored(name)):
            assert up(other) == [mirrored(above) for above in up(name)]


def test_our_own_reader_knows_every_presets_names(preset: str) -> None:
    made = named(Animation.of(moving(2))[0], preset)
    found = match_joints(list(made.skeleton.names))
    ends = ("pelvis", "head", "neck", *(f"{side}_{part}" for side in ("left", "right") for part in (
        "hip", "knee", "ankle", "foot", "collar", "shoulder", "elbow", "wrist")))  # fmt: skip
    for joint in ends:
        assert found[joint] == made.ours[HUMANML3D.index(joint)], joint


def test_roots_lie_on_the_floor_or_at_the_origin_and_face_nowhere() -> None:
    animation = Animation.of(moving())[0]
    unreal, soma = named(animation, "unreal"), named(animation, "soma")
    np.testing.assert_allclose(unreal.roots[:, [0, 2]], animation.roots[:, [0, 2]])
    assert np.ptp(unreal.roots[:, 1]) == 0
    under = animation.joints[:, HUMANML3D.indices(("left_foot", "right_foot")), 1].min() - unreal.roots[0, 1]
    assert 0.01 < under < 0.06  # the sole
    assert (soma.roots == 0).all()
    for made in (unreal, soma):
        assert (made.rotations[:, 0] == [1, 0, 0, 0]).all()
        assert made.skeleton.offsets[1][1] == pytest.approx(animation.skeleton.legs + under, abs=1e-9)


def test_joints_that_we_lack_lie_on_bones_and_do_not_turn() -> None:
    made = named(Animation.of(moving())[0], "unreal")
    for between, below, above in (("spine_02", "spine_01", "spine_03"), ("neck_02", "neck_01", "head")):
        at, a, b = (made.joints[:, made.skeleton.index(name)] for name in (between, below, above))
        np.testing.assert_allclose(at, (a + b) / 2, atol=1e-9)
        assert (made.rotations[:, made.skeleton.index(between)] == [1, 0, 0, 0]).all()


def test_other_names_are_a_sentence() -> None:
    with pytest.raises(UserError, match="unknown names 'mixmo'; did you mean 'mixamo'"):
        named(Animation.of(moving(2))[0], "mixmo")
