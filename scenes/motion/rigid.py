"""Rigid bodies: the map that gives every bone its skeleton's length, and joints that branch their skeleton's shape.

Generators make 22 points a frame, whose bones are a few millimetres to centimetres off. Here each bone keeps its
direction and gets its own length, from the pelvis outward. Where several bones leave one joint (hips and spine the
pelvis, neck and collars the chest) they turn as one, so that rotations of joints alone carry the body
(`scenes.motion.kinematics`). The map is smooth, acts on each frame alone, commutes with rigid moves, and leaves what is
rigid as it is.
"""

from __future__ import annotations

from dataclasses import replace

import torch
from jaxtyping import Float
from torch import Tensor

from scenes.motion.branches import SHORTEST, tree_of, turns
from scenes.motion.motion import Motion
from scenes.motion.skeleton import Skeleton


def rigid(motion: Motion, skeleton: Skeleton | None = None) -> Motion:
    """The motion on its skeleton's bones, or on another's of the same joints; differentiable in the joints."""
    skeleton = motion.skeleton if skeleton is None else skeleton
    return replace(motion, joints=on_bones(motion.joints, skeleton), skeleton=skeleton)


def on_bones(joints: Float[Tensor, "*b J 3"], skeleton: Skeleton) -> Float[Tensor, "*b J 3"]:
    """Joints (m) on a skeleton's bones: the root where it was, bones in their directions."""
    tree = tree_of(skeleton)
    if not tree.parents:
        return joints
    bones = joints[..., 1:, :] - joints[..., tree.parents, :]
    size = (bones.square().sum(-1, keepdim=True) + SHORTEST**2).sqrt()
    placed = bones * (joints.new_tensor(tree.lengths)[:, None] / size)
    for branch in tree.branches:
        turn = turns(bones[..., branch.bones, :], branch)
        offsets = joints.new_tensor(branch.offsets)
        placed = placed.index_copy(-2, torch.tensor(branch.bones, device=joints.device), offsets @ turn.mT)
    moved = joints.new_tensor(tree.above) @ placed
    return torch.cat([joints[..., :1, :], joints[..., :1, :] + moved], dim=-2)
