"""Rotations in space as matrices: of quaternions, between directions, and of vectors."""

from __future__ import annotations

import torch
from jaxtyping import Float
from torch import Tensor


def rotated(rotation: Float[Tensor, "*c 3 3"], vectors: Float[Tensor, "*d 3"]) -> Float[Tensor, "*e 3"]:
    """Vectors turned by rotation matrices, which broadcast to them."""
    # A broadcast product: batched 3 x 3 matrix products are many times slower on a CPU.
    return (rotation * vectors[..., None, :]).sum(-1)


def matrices(quaternions: Float[Tensor, "*b 4"]) -> Float[Tensor, "*b 3 3"]:
    """Rotation matrices of unit quaternions (w, x, y, z)."""
    w, x, y, z = quaternions.unbind(-1)
    rows = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
        [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
        [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
    ]
    return torch.stack([torch.stack(row, dim=-1) for row in rows], dim=-2)


def rotation_between(a: Float[Tensor, "*b 3"], b: Float[Tensor, "*b 3"]) -> Float[Tensor, "*b 3 3"]:
    """The smallest rotation that takes direction a to direction b (any half turn where they oppose)."""
    a = a / a.norm(dim=-1, keepdim=True).clamp_min(1e-8)
    b = b / b.norm(dim=-1, keepdim=True).clamp_min(1e-8)
    half = a + b
    length = half.norm(dim=-1, keepdim=True)
    # Opposed directions leave the axis free: any one at right angles to a.
    side = torch.linalg.cross(a, torch.eye(3).to(a)[a.abs().argmin(-1)])
    half = torch.where(length > 1e-6, half / length.clamp_min(1e-6), torch.zeros_like(half))
    w = (a * half).sum(-1, keepdim=True)
    xyz = torch.where(length > 1e-6, torch.linalg.cross(a, half), side / side.norm(dim=-1, keepdim=True))
    return matrices(torch.cat([w, xyz], dim=-1))
