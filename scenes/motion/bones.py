"""Bones of a motion, their lengths, and those of its skeleton."""

from __future__ import annotations

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from scenes.motion.motion import Motion
from scenes.motion.skeleton import Skeleton


def bone_vectors(motion: Motion) -> Float[Tensor, "*b T B 3"]:
    """From parent to child (m, world) of every bone, in the order of `Skeleton.bones`."""
    parents, children = (list(side) for side in zip(*motion.skeleton.bones, strict=True))
    return motion.joints[..., children, :] - motion.joints[..., parents, :]


def bone_lengths(motion: Motion) -> Float[Tensor, "*b T B"]:
    """Length (m) of every bone, in the order of `Skeleton.bones`."""
    return bone_vectors(motion).norm(dim=-1)


def rest_lengths(motion: Motion) -> Float[Tensor, " B"]:
    """Lengths (m) of the skeleton's bones, in the order of `Skeleton.bones`, typed as the motion."""
    return motion.joints.new_tensor(motion.skeleton.bone_lengths)[[child for _, child in motion.skeleton.bones]]


def rest_pose(skeleton: Skeleton) -> Float[Tensor, "J 3"]:
    """Positions (m) of a person's joints at rest, the root at the origin, in double precision."""
    rest = np.zeros((len(skeleton.names), 3))
    for parent, joint in skeleton.bones:
        rest[joint] = rest[parent] + np.asarray(skeleton.offsets[joint])
    return torch.from_numpy(rest)


def standing_pose(skeleton: Skeleton) -> Float[Tensor, "J 3"]:
    """The rest pose with arms that hang, as people stand; the same where the skeleton knows no arms."""
    joints, arms = rest_pose(skeleton), ("elbow", "wrist")
    for parent, joint in skeleton.bones:
        if skeleton.names[joint].endswith(arms):
            joints[joint] = joints[parent] - joints.new_tensor([0.0, float(skeleton.bone_lengths[joint]), 0.0])
    return joints
