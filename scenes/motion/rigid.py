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

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from scenes.motion.motion import Motion
from scenes.motion.skeleton import Skeleton

_SHORTEST = 1e-4
"""Of its length at rest: a bone much shorter than this has no direction."""


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
    apart, together, branches = _tables(skeleton, before or skeleton, joints.dtype, joints.device)
    rows = joints.mT.contiguous()  # so that one small matrix takes all frames at once
    ways, up = (rows @ apart).tensor_split((apart.shape[1] - branches,), dim=-1)
    ways = _unit(ways)
    across = ways[..., ways.shape[-1] - branches :]
    up = _unit(up - (up * across).sum(-2, keepdim=True) * across)
    parts = (rows[..., :1], ways, up, torch.linalg.cross(across, up, dim=-2))
    return (torch.cat(parts, dim=-1) @ together).mT


def _unit(ways: Float[Tensor, "*b 3 n"]) -> Float[Tensor, "*b 3 n"]:
    """Of length 1, exactly where they are."""
    small = _SHORTEST**2
    return ways * ((1 + small) / (ways.square().sum(-2, keepdim=True) + small)).sqrt()


def turns(bones: Float[Tensor, "*b n 3"], branch: Branch) -> Float[Tensor, "*b 3 3"]:
    """Rotations that carry the rest of a branching joint to its bones: exactly where they are as rigid as it.

    Otherwise the line across (of hips, of collars) is kept, and the bones together decide how it leans.
    """
    across, up = (torch.einsum("n,...nd->...d", bones.new_tensor(share), bones) for share in branch.shares)
    return _frame(across, up) @ bones.new_tensor(branch.rest).mT


def _frame(x: Float[Tensor, "*b 3"], y: Float[Tensor, "*b 3"]) -> Float[Tensor, "*b 3 3"]:
    """Right-handed axes as columns: the first along x, the second in the plane of x and y."""
    x = x / (x.square().sum(-1, keepdim=True) + 1e-12).sqrt()
    y = y - (y * x).sum(-1, keepdim=True) * x
    y = y / (y.square().sum(-1, keepdim=True) + 1e-12).sqrt()
    return torch.stack([x, y, torch.linalg.cross(x, y)], dim=-1)


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
        branches: joints whose bones turn as one, parents first.
    """

    parents: list[int]
    branches: tuple[Branch, ...]


@lru_cache(maxsize=32)
def tree_of(skeleton: Skeleton) -> Tree:
    """The tables of a skeleton."""
    parents = list(skeleton.parents[1:])
    children = [[j for j, parent in enumerate(parents, 1) if parent == p] for p in range(len(skeleton.names))]
    with torch.device("cpu"):
        found = [_branch(skeleton, joint, ends) for joint, ends in enumerate(children) if len(ends) > 1]
    return Tree(parents, tuple(branch for branch in found if branch is not None))


def _products(skeleton: Skeleton, before: Skeleton) -> tuple[np.ndarray, np.ndarray]:
    """Both products of the map, ``[J, n]`` and ``[m, J]``.

    The first leads from joints to bones that turn alone, then to the lines across branches, then to those up; lengths
    at rest are 1, of lines up beside what they have along those across. The second leads from the root, these lines and
    the third axes of branches back to joints.
    """
    told = {branch.joint: branch for branch in tree_of(before).branches}
    branches = [(branch, told.get(branch.joint, branch)) for branch in tree_of(skeleton).branches]
    count, k = len(skeleton.names), len(branches)
    bones, above = np.eye(count)[:, 1:], np.zeros((count, count - 1))
    for bone, (parent, joint) in enumerate(skeleton.bones):
        bones[parent, bone] = -1.0
        above[joint] = above[parent]
        above[joint, bone] = 1.0
    alone = [b for b in range(count - 1) if not any(b in branch.bones for branch, _ in branches)]
    lengths = skeleton.bone_lengths[1:][alone]
    apart = np.hstack([bones[:, alone] / lengths.clip(_SHORTEST), np.zeros((count, 2 * k))])
    placed = np.zeros((len(alone) + 3 * k, count - 1))
    placed[range(len(alone)), alone] = lengths
    for i, (branch, seen) in enumerate(branches):
        shares, rest = np.array(seen.shares), np.array(seen.rest)
        along = (shares @ np.array(seen.offsets) @ rest).diagonal()  # of the line across, and of that up beside it
        apart[:, [len(alone) + i, len(alone) + k + i]] = bones[:, branch.bones] @ (shares / along[:, None]).T
        placed[len(alone) + i :: k, branch.bones] = (np.array(branch.offsets) @ rest).T
    return apart, np.vstack([np.ones(count), placed @ above.T])


@lru_cache(maxsize=32)
def _tables(
    skeleton: Skeleton, before: Skeleton, dtype: torch.dtype, device: torch.device
) -> tuple[Tensor, Tensor, int]:
    """Both products of a map and the number of its branches, where they are needed."""
    apart, together = (torch.from_numpy(table).to(device, dtype) for table in _products(skeleton, before))
    return apart, together, len(tree_of(skeleton).branches)


def _branch(skeleton: Skeleton, joint: int, ends: list[int]) -> Branch | None:
    """None where the bones lie in a line at rest, and so don't tell how the joint turns."""
    offsets = torch.tensor([skeleton.offsets[end] for end in ends], dtype=torch.float64)
    shares = offsets[:, :2].T
    across, up = shares @ offsets
    if float(torch.linalg.cross(across, up).norm()) < _SHORTEST**2 * float(offsets.norm()) ** 2:
        return None
    rest = _frame(across, up)
    return Branch(joint, [end - 1 for end in ends], offsets.tolist(), shares.tolist(), rest.tolist())
