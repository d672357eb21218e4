"""The skeleton of a motion that does not state it: lengths of bones, and the shape of the joints that branch."""

from __future__ import annotations

import torch

from scenes.motion.bones import bone_lengths, bone_vectors
from scenes.motion.motion import Motion
from scenes.motion.rigid import tree_of, turns
from scenes.motion.skeleton import Skeleton

_EXACT = 1e-4
"""Metres within which the bones of a motion are its skeleton's."""


def skeleton_of(motion: Motion) -> Skeleton:
    """A T-pose with the bones of one motion ``[T, J, 3]``: its skeleton's own where its bones are as long as that.

    Lengths are medians over the real frames. Hips and spine in the pelvis, neck and collars in the chest stand where
    they do on average as seen from there; all other bones rest in the directions of the motion's skeleton.
    """
    skeleton, joints = motion.skeleton, motion.joints[motion.valid].detach().double()
    real = Motion(joints, fps=motion.fps, skeleton=skeleton)
    lengths = bone_lengths(real).median(dim=0).values
    rest = torch.tensor(skeleton.bone_lengths[1:], dtype=torch.float64)
    if float((bone_lengths(real) - rest).abs().max()) < _EXACT:
        return skeleton
    vectors = bone_vectors(real)
    ways = torch.tensor(skeleton.offsets[1:], dtype=torch.float64)
    for branch in tree_of(skeleton).branches:
        bones = vectors[:, branch.bones]
        ways[branch.bones] = (bones @ turns(bones, branch)).mean(0)  # rows times R: seen from the joint
    offsets = lengths[:, None] * ways / ways.norm(dim=-1, keepdim=True).clamp_min(1e-9)
    rows = tuple((x, y, z) for x, y, z in offsets.tolist())
    return Skeleton(skeleton.names, skeleton.parents, (skeleton.offsets[0], *rows))
