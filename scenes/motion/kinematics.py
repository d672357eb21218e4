"""Rotations of joints, and the joints that they carry.

A joint's rotation turns, with the joint, everything that hangs on it: with rotations R (world) and offsets o of the
skeleton's T-pose, a joint stands at ``p[parent] + R[parent] @ o[joint]``.
"""

from __future__ import annotations

from jaxtyping import Float
from torch import Tensor

from scenes.motion.motion import Motion
from scenes.motion.skeleton import Skeleton


def orientations(motion: Motion) -> Float[Tensor, "*b T J 3 3"]:
    """How every joint is turned in the world, against the T-pose; differentiable in the joints."""
    raise NotImplementedError


def local_rotations(motion: Motion) -> Float[Tensor, "*b T J 4"]:
    """Unit quaternions (w, x, y, z) of every joint against its parent, the root's in the world; continuous in time."""
    raise NotImplementedError


def forward(
    rotations: Float[Tensor, "*b J 4"], root: Float[Tensor, "*b 3"], skeleton: Skeleton
) -> Float[Tensor, "*b J 3"]:
    """Joints (m) of local rotations and the root's position (m)."""
    raise NotImplementedError
