"""Bones: a person at rest has the skeleton's lengths, and bodies of other sizes have theirs."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import torch

from scenes.motion.bones import bone_lengths, bone_vectors, rest_lengths, rest_pose
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


def test_at_rest_bones_have_the_skeletons_lengths() -> None:
    motion = rest()
    assert bone_vectors(motion).shape == (2, 4, 21, 3)
    torch.testing.assert_close(bone_lengths(motion)[1, 2], rest_lengths(motion))
    assert rest_lengths(replace(motion, joints=motion.joints.float())).dtype == torch.float32


def test_scaled_bodies_have_scaled_bones() -> None:
    motion = rest()
    larger = replace(motion, joints=1.5 * motion.joints)
    torch.testing.assert_close(bone_lengths(larger), 1.5 * bone_lengths(motion))
