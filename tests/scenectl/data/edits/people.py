"""People for the tests of edits with hands: one who stands and sways, one who walks up to a place and stands there."""

from __future__ import annotations

import math

import torch

from scenectl.data.corpus import Clip
from scenectl.data.edits.limbs import with_legs
from scenectl.data.features import canonicalise
from scenes.motion.bones import standing_pose
from scenes.motion.skeleton import HUMANML3D
from tests.scenectl.small import walk

ARMS = ((16, 18, 20), (17, 19, 21))


def standing(frames: int = 60) -> Clip:
    """A person who stands with hanging arms and sways by a centimetre."""
    joints = standing_pose(HUMANML3D).float().expand(frames, 22, 3).clone()
    for shoulder, elbow, wrist in ARMS:
        upper, lower = HUMANML3D.bone_lengths[[elbow, wrist]]
        joints[:, elbow] = joints[:, shoulder] + torch.tensor([0.0, -upper, 0.0])
        joints[:, wrist] = joints[:, elbow] + torch.tensor([0.0, -0.96 * lower, 0.28 * lower])
    t = torch.arange(frames) / 20.0
    sway = torch.stack([0.01 * (2 * math.pi * 0.4 * t).sin(), 0 * t - 0.02, 0.005 * (2 * math.pi * 0.3 * t).cos()], -1)
    joints = canonicalise(with_legs(joints, sway, joints.new_zeros(frames, 2, 3)))
    return Clip("stand", joints, ("a person stands.",), "cmu", "train", "idle", "free", True)


def arriving(frames: int = 60) -> Clip:
    """A person who walks and then stands."""
    way, stand = canonicalise(walk(frames)), standing().joints
    there = way[-1, 0] * torch.tensor([1.0, 0.0, 1.0])
    joints = torch.cat([way, stand - stand[0, 0] * torch.tensor([1.0, 0.0, 1.0]) + there])
    return Clip("arrive", joints, ("a person walks and stops.",), "cmu", "train", "walk", "free", True)


def between() -> Clip:
    """A person who stands, walks and stands again."""
    stand, rest = standing().joints, arriving().joints
    joints = torch.cat([stand, rest + stand[0, 0] * torch.tensor([1.0, 0.0, 1.0])])
    return Clip("between", joints, ("a person walks.",), "cmu", "train", "walk", "free", True)
