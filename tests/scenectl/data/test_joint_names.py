"""Joints of other people's rigs are found by their names, whatever prefixes, numbers and further bones these have."""

from __future__ import annotations

import random

import pytest

from scenectl.data.joint_names import match_joints

MIXAMO = "Hips Neck Head Shoulder Arm ForeArm Hand UpLeg Leg Foot ToeBase"
UNREAL = "pelvis neck_01 head clavicle upperarm lowerarm hand thigh calf foot ball"
BIPED = "Pelvis Neck Head Clavicle UpperArm Forearm Hand Thigh Calf Foot Toe0"
HUMAN = "Hips Neck Head Shoulder UpperArm LowerArm Hand UpperLeg LowerLeg Foot ToeBase"
OURS = ["pelvis", "neck", "head", "collar", "shoulder", "elbow", "wrist", "hip", "knee", "ankle", "foot"]

RIGS = {
    "mixamo": ("mixamorig:{0}", "mixamorig:{1}{0}", MIXAMO, "Left Right", ["Armature", "Sword", "mixamorig:Spine"]),
    "mixamo numbered": ("mixamorig1_{0}", "mixamorig1_{1}{0}", MIXAMO, "Left Right", ["Root", "mixamorig1_Spine1"]),
    "mixamo bare": ("{0}", "{1}{0}", MIXAMO, "Left Right", ["_rootJoint", "LeftHandThumb1", "LeftToe_End"]),
    "no colons": ("mixamorig{0}", "mixamorig{1}{0}", MIXAMO, "Left Right", ["Armature", "mixamorigLeftHandIndex1"]),
    "sketchfab": ("{0}_01", "{1}{0}_042", MIXAMO, "Left Right", ["_rootJoint", "LeftHandThumb1_07"]),
    "unreal": ("{0}", "{0}_{1}", UNREAL, "l r", ["root", "ik_foot_l", "ik_hand_r", "thigh_twist_01_l", "hand_gun"]),
    "upper case": ("{0}", "{0}_{1}", UNREAL.upper(), "L R", ["ROOT", "IK_FOOT_L"]),
    "vroid": ("J_Bip_C_{0}", "J_Bip_{1}_{0}", HUMAN, "L R", ["Root", "J_Sec_Hair1_01", "J_Adj_L_FaceEye"]),
    "biped": ("Bip001 {0}", "Bip001 {1} {0}", BIPED, "L R", ["Bip001", "Bone01", "Bip001 L Toe0Nub", "Bip001 HeadNub"]),
    "valve": ("ValveBiped.Bip01_{0}", "ValveBiped.Bip01_{1}_{0}", BIPED, "L R", ["ValveBiped.forward", "weapon_bone"]),
    "cc": (
        "CC_Base_{0}", "CC_Base_{1}_{0}", "Hip NeckTwist01 Head Clavicle Upperarm Forearm Hand Thigh Calf Foot ToeBase",
        "L R", ["RL_BoneRoot", "CC_Base_L_ThighTwist01", "CC_Base_L_ToeBaseShareBone", "CC_Base_L_BigToe1"],
    ),
    "daz": (
        "{0}", "{1}{0}", "hip neckLower head Collar ShldrBend ForearmBend Hand ThighBend Shin Foot Toe", "l r",
        ["abdomenLower", "chestUpper", "lThighTwist", "lForearmTwist", "lMetatarsals", "neckUpper"],
    ),
    "makehuman": (
        "{0}", "{0}.{1}", "root neck01 head clavicle upperarm01 lowerarm01 wrist upperleg01 lowerleg01 foot toe1-1",
        "L R", ["spine05", "pelvis.L", "shoulder01.L", "breast.L", "finger1-1.L"],
    ),
    "deform bones": (
        "DEF-{0}", "DEF-{0}.{1}", "hips neck head shoulder upper_arm forearm hand thigh shin foot toe", "L R",
        ["root", "foot_ik.L", "thigh_parent.L", "DEF-pelvis.L", "DEF-palm.01.L", "DEF-f_index.01.L"],
    ),
    "maya": (
        "{0}_M", "{0}_{1}", "Root Neck Head Scapula Shoulder Elbow Wrist Hip Knee Ankle Toes", "L R", ["Spine1_M"],
    ),
}  # fmt: skip
"""Names of joints in the middle and at the sides, parts in the order of `OURS`, sides, and what else is in the file."""


@pytest.mark.parametrize("rig", RIGS)
def test_joints_are_found_in_any_order_among_other_bones(rig: str) -> None:
    middle, sided, parts, sides, others = RIGS[rig]
    expected = {}
    for ours, part in zip(OURS, parts.split(), strict=True):
        if ours in ("pelvis", "neck", "head"):
            expected[ours] = middle.format(part)
        else:
            expected |= {
                f"{s}_{ours}": sided.format(part, t) for s, t in zip(("left", "right"), sides.split(), strict=True)
            }
    names = [*expected.values(), *others]
    for seed in range(5):
        random.Random(seed).shuffle(names)
        assert {joint: names[at] for joint, at in match_joints(names).items()} == expected


def test_of_links_of_one_part_the_first_is_taken() -> None:
    names = ["Hips", "Neck", "Neck.001", "Head"]
    for side in "LR":
        names += [
            f"{part}.{side}{k}"
            for part in ["thigh", "shin", "foot", "upper_arm", "forearm", "hand"]
            for k in ("", ".001")
        ]
    found = {joint: names[at] for joint, at in match_joints(names).items()}
    assert found["left_hip"] == "thigh.L" and found["right_elbow"] == "forearm.R" and found["neck"] == "Neck"
    names = [name + ".001" if name[-1] in "LR" else name for name in names if ".001" not in name]
    assert names[match_joints(names)["left_hip"]] == "thigh.L.001"
