"""Names and hierarchies of skeletons that tools expect: a preset says which joints there are, and their names."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from scenectl.export.animation import Animation
from scenes.body.body import DEFAULT_BODY
from scenes.errors import UserError, did_you_mean
from scenes.motion.skeleton import FEET, Skeleton, size_of

# Mixamo's characters; Epic's mannequin of Unreal Engine 5 (Manny, Quinn); Unity's HumanBodyBones; humanoid bones of
# VRM 1.0; NVIDIA's SOMA, as Kimodo writes it and soma-retargeter reads it. Fingers, twist bones, eyes and jaws, which
# our body has not, are left out. All five hang as our own tree does, so that a column of names is a skeleton:
# `a~b` lies halfway between two of our joints, `floor` under the pelvis, and `world` at the origin.
_TABLE = """
joint           mixamo                  unreal      unity           vrm             soma
floor           -                       root        -               -               -
world           -                       -           -               -               Root
pelvis          mixamorig:Hips          pelvis      Hips            hips            Hips
spine1          mixamorig:Spine         spine_01    Spine           spine           Spine1
spine1~spine2   -                       spine_02    -               -               -
spine2          mixamorig:Spine1        spine_03    Chest           chest           Spine2
spine2~spine3   -                       spine_04    -               -               -
spine3          mixamorig:Spine2        spine_05    UpperChest      upperChest      Chest
neck            mixamorig:Neck          neck_01     Neck            neck            Neck1
neck~head       -                       neck_02     -               -               Neck2
head            mixamorig:Head          head        Head            head            Head
left_collar     mixamorig:LeftShoulder  clavicle_l  LeftShoulder    leftShoulder    LeftShoulder
left_shoulder   mixamorig:LeftArm       upperarm_l  LeftUpperArm    leftUpperArm    LeftArm
left_elbow      mixamorig:LeftForeArm   lowerarm_l  LeftLowerArm    leftLowerArm    LeftForeArm
left_wrist      mixamorig:LeftHand      hand_l      LeftHand        leftHand        LeftHand
right_collar    mixamorig:RightShoulder clavicle_r  RightShoulder   rightShoulder   RightShoulder
right_shoulder  mixamorig:RightArm      upperarm_r  RightUpperArm   rightUpperArm   RightArm
right_elbow     mixamorig:RightForeArm  lowerarm_r  RightLowerArm   rightLowerArm   RightForeArm
right_wrist     mixamorig:RightHand     hand_r      RightHand       rightHand       RightHand
left_hip        mixamorig:LeftUpLeg     thigh_l     LeftUpperLeg    leftUpperLeg    LeftLeg
left_knee       mixamorig:LeftLeg       calf_l      LeftLowerLeg    leftLowerLeg    LeftShin
left_ankle      mixamorig:LeftFoot      foot_l      LeftFoot        leftFoot        LeftFoot
left_foot       mixamorig:LeftToeBase   ball_l      LeftToes        leftToes        LeftToeBase
right_hip       mixamorig:RightUpLeg    thigh_r     RightUpperLeg   rightUpperLeg   RightLeg
right_knee      mixamorig:RightLeg      calf_r      RightLowerLeg   rightLowerLeg   RightShin
right_ankle     mixamorig:RightFoot     foot_r      RightFoot       rightFoot       RightFoot
right_foot      mixamorig:RightToeBase  ball_r      RightToes       rightToes       RightToeBase
"""
_HEADINGS, *_ROWS = (line.split() for line in _TABLE.strip().splitlines())
PRESETS = ("humanml", *_HEADINGS[1:])


def named(animation: Animation, preset: str) -> Animation:
    """The same motion on the skeleton of a preset; our 22 joints stand and turn as they did, at `Animation.ours`.

    Joints that we lack don't turn. A root of its own (`Animation.hips`) is `root` of "unreal", on the floor under the
    pelvis, heading nowhere, and `Root` of "soma", at the origin.

    Args:
        animation: on the 22 joints of HumanML3D.
        preset: one of `PRESETS`.

    Raises:
        UserError: an unknown preset.
    """
    if preset not in PRESETS:
        raise UserError(f"unknown names '{preset}'{did_you_mean(preset, PRESETS)}")
    if preset == "humanml":
        return animation
    own, column = animation.skeleton, PRESETS.index(preset)
    names = {row[0]: row[column] for row in _ROWS if row[column] != "-"}
    at = {joint: place for place, joint in enumerate(names)}
    parents, offsets = zip(*(_hung(joint, at, own) for joint in names), strict=True)
    rotations = np.zeros((animation.frames, len(names), 4))
    rotations[..., 0] = 1.0
    ours = np.array([at[joint] for joint in own.names])
    rotations[:, ours] = animation.rotations
    made = replace(
        animation, skeleton=Skeleton(tuple(names.values()), parents, offsets), rotations=rotations, ours=ours
    )
    if at["pelvis"] == 0:
        return made
    roots = np.zeros_like(animation.roots)
    if "floor" in at:
        roots[:] = animation.roots
        roots[:, 1] = animation.joints[:, own.indices(FEET), 1].min() - _sole(own)
    return replace(made, roots=roots, hips=animation.roots - roots)


def _hung(joint: str, at: Mapping[str, int], own: Skeleton) -> tuple[int, tuple[float, float, float]]:
    """Parent and offset (m) of a row's joint, by the rows of a preset and our own skeleton."""
    last = joint.partition("~")[2]
    end = last or joint
    above = own.names[own.parents[own.index(end)]] if end in own.names and end != "pelvis" else ""
    if not above:  # a root, or the pelvis, which stands on one as in the T-pose
        return at[joint] - 1, (0.0, own.legs + _sole(own) if at[joint] else 0.0, 0.0)
    halved = f"{above}~{end}" in at
    parent = at[f"{above}~{end}"] if halved and not last else at[above]
    x, y, z = np.array(own.offsets[own.index(end)]) * (0.5 if halved else 1.0)
    return parent, (float(x), float(y), float(z))


def _sole(skeleton: Skeleton) -> float:
    """From the lowest foot joint down to the sole (m)."""
    return DEFAULT_BODY.sole_offset * size_of(skeleton)
