"""What skeletons tell of how a body turns: bones, and the joints from which several leave and turn as one."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import torch
from jaxtyping import Float
from torch import Tensor

from scenes.motion.rotations import axes
from scenes.motion.skeleton import Skeleton

SHORTEST = 1e-4
"""Of its length at rest: a bone much shorter than this has no direction."""


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


def _branch(skeleton: Skeleton, joint: int, ends: list[int]) -> Branch | None:
    """None where the bones lie in a line at rest, and so don't tell how the joint turns."""
    offsets = torch.tensor([skeleton.offsets[end] for end in ends], dtype=torch.float64)
    shares = offsets[:, :2].T
    across, up = shares @ offsets
    if float(torch.linalg.cross(across, up).norm()) <= SHORTEST**2 * float(offsets.norm()) ** 2:
        return None
    rest = axes(across, up)
    return Branch(joint, [end - 1 for end in ends], offsets.tolist(), shares.tolist(), rest.tolist())
