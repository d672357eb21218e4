"""The skeleton of a person of whom only a motion is known."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import torch

from scenes.motion.bones import bone_lengths
from scenes.motion.motion import Motion
from scenes.motion.rigid import tree_of, turns
from scenes.motion.skeleton import Skeleton, with_lengths

SAME = 0.001
"""Metres by which bones may differ from a skeleton's and count as its: twice the step in which collections store."""


def skeleton_of(motion: Motion) -> Skeleton:
    """The motion's skeleton where its bones are as long as the motion's, to `SAME`; else one that is fitted to it.

    Its bones are as long as the motion's are in the median. Those of joints that branch stand as they do in the mean,
    as seen from pelvis and chest, and all others in the directions of the motion's skeleton. So a body that is rigid
    but another one's is found exactly: `scenes.motion.kinematics` gives its joints back.
    """
    skeleton, tree = motion.skeleton, tree_of(motion.skeleton)
    joints = motion.joints.detach()[motion.valid].double().cpu()
    if not len(joints) or not tree.parents:
        return skeleton
    real = Motion(joints, skeleton=skeleton)
    lengths = np.append(0.0, bone_lengths(real).median(dim=0).values.numpy())
    if np.abs(lengths - skeleton.bone_lengths).max() <= SAME:
        return skeleton
    offsets, bones = np.array(skeleton.offsets), joints[:, 1:] - joints[:, tree.parents]
    for branch in tree.branches:
        own = bones[:, branch.bones]
        seen = torch.einsum("tij,tni->nj", turns(own, branch), own) / len(own)
        offsets[[bone + 1 for bone in branch.bones]] = seen.numpy()
    return with_lengths(replace(skeleton, offsets=tuple((x, y, z) for x, y, z in offsets.tolist())), lengths)
