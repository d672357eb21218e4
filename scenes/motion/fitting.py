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
    """The motion's skeleton where its bones are as long as the motion's, to `SAME`; else one `fitted` to it."""
    skeleton, lengths = motion.skeleton, _lengths(motion)
    same = lengths is None or np.abs(lengths - skeleton.bone_lengths).max() <= SAME
    return skeleton if same else fitted(motion)


def fitted(motion: Motion) -> Skeleton:
    """A skeleton whose bones are as long as the motion's are in the median.

    Those of joints that branch stand as they do in the mean, as seen from pelvis and chest, and all others in the
    directions of the motion's skeleton. So a body that is rigid but another one's is found exactly:
    `scenes.motion.kinematics` gives its joints back.
    """
    lengths, tree, offsets = _lengths(motion), tree_of(motion.skeleton), np.array(motion.skeleton.offsets)
    if lengths is None:
        return motion.skeleton
    joints = motion.joints.detach()[motion.valid].double().cpu()
    bones = joints[:, 1:] - joints[:, tree.parents]
    for branch in tree.branches:
        own = bones[:, branch.bones]
        seen = torch.einsum("tij,tni->nj", turns(own, branch), own) / len(own)
        offsets[[bone + 1 for bone in branch.bones]] = seen.numpy()
    placed = replace(motion.skeleton, offsets=tuple((x, y, z) for x, y, z in offsets.tolist()))
    return with_lengths(placed, lengths)


def _lengths(motion: Motion) -> np.ndarray | None:
    """Of the bone that ends in each joint (m), in the median over real frames, 0 for the root; None without any."""
    if not motion.valid.any() or len(motion.skeleton.names) < 2:
        return None
    lengths = bone_lengths(motion).detach()[motion.valid].double().cpu()
    return np.append(0.0, lengths.median(dim=0).values.numpy())
