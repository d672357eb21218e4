"""Bones: a person at rest has the skeleton's lengths, and what is stretched is longer by so much."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import torch

from scenes.motion.bones import bone_errors, bone_lengths, bone_vectors, rest_lengths, rest_pose, stretches
from scenes.motion.motion import Motion
from scenes.motion.skeleton import FEET, HUMANML3D


def rest(frames: int = 4) -> Motion:
    return Motion(rest_pose(HUMANML3D).expand(2, frames, -1, -1).clone())


def test_the_rest_pose_is_the_sum_of_offsets_from_the_root() -> None:
    pose = rest_pose(HUMANML3D)
    assert pose.shape == (22, 3) and pose.dtype == torch.float64 and pose[0].abs().max() == 0
    for parent, joint in HUMANML3D.bones:
        assert np.allclose((pose[joint] - pose[parent]).numpy(), HUMANML3D.offsets[joint])
    height = dict(zip(HUMANML3D.names, pose[:, 1].tolist(), strict=True))
    assert height["head"] > 0.5 and min(height[foot] for foot in FEET) == min(height.values())


def test_at_rest_no_bone_is_stretched() -> None:
    motion = rest()
    assert bone_vectors(motion).shape == (2, 4, 21, 3)
    torch.testing.assert_close(bone_lengths(motion)[1, 2], rest_lengths(motion))
    assert float(stretches(motion).abs().max()) < 1e-12
    assert rest_lengths(replace(motion, joints=motion.joints.float())).dtype == torch.float32


def test_scaled_bodies_have_scaled_bones() -> None:
    motion = rest()
    larger = replace(motion, joints=1.5 * motion.joints)
    torch.testing.assert_close(bone_lengths(larger), 1.5 * bone_lengths(motion))
    torch.testing.assert_close(stretches(larger), 0.5 * bone_lengths(motion))


def test_one_stretched_bone_counts_by_its_share_and_padding_not_at_all() -> None:
    motion = rest()
    hand = HUMANML3D.index("left_wrist")
    joints = motion.joints.clone()
    joints[:, 1:, hand, 1] -= 0.21  # the forearm hangs straight down at rest
    valid = torch.ones(2, 4, dtype=torch.bool)
    valid[:, 3] = False
    longer = replace(motion, joints=joints, valid=valid)
    bone = [child for _, child in HUMANML3D.bones].index(hand)
    torch.testing.assert_close(stretches(longer)[0, :, bone], torch.tensor([0.0, 0.21, 0.21, 0.0]).double())
    torch.testing.assert_close(bone_errors(longer)[1], torch.tensor([0.0, 0.01, 0.01, 0.0]).double())  # of 21 bones
