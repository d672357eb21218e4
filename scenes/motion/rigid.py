"""Rigid bodies: the map that gives every bone its skeleton's length, and joints that branch their skeleton's shape.

Generators make 22 points a frame, whose bones are a few millimetres to centimetres off. Here each bone keeps its
direction and gets its own length, from the pelvis outward. Where several bones leave one joint (hips and spine the
pelvis, neck and collars the chest) they turn as one, so that rotations of joints alone carry the body
(`scenes.motion.kinematics`). The map is smooth, acts on each frame alone, commutes with rigid moves, and leaves what is
rigid as it is.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import lru_cache

import torch
from jaxtyping import Float
from torch import Tensor

from scenes.motion.motion import Motion
from scenes.motion.rotations import axes
from scenes.motion.skeleton import Skeleton

_SHORTEST = 1e-4
"""Metres: a bone much shorter than this has no direction, and keeps its length."""


def rigid(motion: Motion, skeleton: Skeleton | None = None) -> Motion:
    """The motion on its skeleton's bones, or on another's of the same joints; differentiable in the joints."""
    skeleton = motion.skeleton if skeleton is None else skeleton
    return replace(motion, joints=on_bones(motion.joints, skeleton, motion.skeleton), skeleton=skeleton)


def on_bones(
    joints: Float[Tensor, "*b J 3"], skeleton: Skeleton, before: Skeleton | None = None
) -> Float[Tensor, "*b J 3"]:
    """Joints (m) on a skeleton's bones: the root where it was, bones in their directions.

    How joints that branch are turned is told by the skeleton that the joints were made on `before`.
    """
    tree = tree_of(skeleton)
    told = {} if before is None else {branch.joint: branch for branch in tree_of(before).branches}
    bones = joints[..., 1:, :] - joints[..., tree.parents, :]
    size = (bones.square().sum(-1, keepdim=True) + _SHORTEST**2).sqrt()
    placed = bones * (joints.new_tensor(tree.lengths)[:, None] / size)
    for branch in tree.branches:
        turn = turns(bones[..., branch.bones, :], told.get(branch.joint, branch))
        offsets = joints.new_tensor(branch.offsets)
        placed = placed.index_copy(-2, torch.tensor(branch.bones, device=joints.device), offsets @ turn.mT)
    moved = joints.new_tensor(tree.above) @ placed
    return torch.cat([joints[..., :1, :], joints[..., :1, :] + moved], dim=-2)


def turns(bones: Float[Tensor, "*b n 3"], branch: Branch) -> Float[Tensor, "*b 3 3"]:
    """Rotations that carry the rest of a branching joint to its bones: exactly where they are as rigid as it.

    Otherwise the line across (of hips, of collars) is kept, and the bones together decide how it leans.
    """
    across, up = (torch.einsum("n,...nd->...d", bones.new_tensor(share), bones) for share in branch.shares)
    return axes(across, up) @ bones.new_tensor(branch.rest).mT


@dataclass(frozen=True)
class Branch:
    """A joint from which several bones leave, in directions that span a plane at rest.

    Attributes:
        joint: its index.
        bones: indices of the bones, each one less than that of the joint in which it ends.
        offsets: of those joints at rest (m).
        shares: of each bone in the line across and in the one up.
        rest: axes at rest, as columns.
    """

    joint: int
    bones: list[int]
    offsets: list[list[float]]
    shares: list[list[float]]
    rest: list[list[float]]


@dataclass(frozen=True)
class Tree:
    """What the map needs of a skeleton.

    Attributes:
        parents: of all joints but the root.
        lengths: of the bones that end in them (m).
        above: 1 where a bone lies on the way from the root to a joint.
        branches: joints whose bones turn as one, parents first.
    """

    parents: list[int]
    lengths: list[float]
    above: list[list[float]]
    branches: tuple[Branch, ...]


@lru_cache(maxsize=32)
def tree_of(skeleton: Skeleton) -> Tree:
    """The tables of a skeleton."""
    parents, count = list(skeleton.parents[1:]), len(skeleton.names) - 1
    above = torch.zeros(count + 1, count)
    for joint, parent in enumerate(parents, 1):
        above[joint] = above[parent]
        above[joint, joint - 1] = 1.0
    children = [[j for j, parent in enumerate(skeleton.parents) if parent == p] for p in range(count + 1)]
    branches = (_branch(skeleton, joint, ends) for joint, ends in enumerate(children) if len(ends) > 1)
    lengths = skeleton.bone_lengths[1:].tolist()
    return Tree(parents, lengths, above[1:].tolist(), tuple(branch for branch in branches if branch is not None))


def _branch(skeleton: Skeleton, joint: int, ends: list[int]) -> Branch | None:
    """None where the bones lie in a line at rest, and so don't tell how the joint turns."""
    offsets = torch.tensor([skeleton.offsets[end] for end in ends], dtype=torch.float64)
    shares = offsets[:, :2].T
    across, up = shares @ offsets
    if float(torch.linalg.cross(across, up).norm()) < _SHORTEST**2 * float(offsets.norm()) ** 2:
        return None
    rest = axes(across, up)
    return Branch(joint, [end - 1 for end in ends], offsets.tolist(), shares.tolist(), rest.tolist())
