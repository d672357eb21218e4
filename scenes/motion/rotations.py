"""Rotations in space, as matrices and as unit quaternions (w, x, y, z)."""

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


def unit_quaternions(rotations: Float[Tensor, "*b 3 3"]) -> Float[Tensor, "*b 4"]:
    """Unit quaternions (w, x, y, z) of rotation matrices: of q and -q either one."""
    (xx, xy, xz), (yx, yy, yz), (zx, zy, zz) = (row.unbind(-1) for row in rotations.unbind(-2))
    # Four times the products of all pairs: every row is q, and the one with the largest square is sound.
    rows = [
        [1 + xx + yy + zz, zy - yz, xz - zx, yx - xy],
        [zy - yz, 1 + xx - yy - zz, xy + yx, xz + zx],
        [xz - zx, xy + yx, 1 - xx + yy - zz, yz + zy],
        [yx - xy, xz + zx, yz + zy, 1 - xx - yy + zz],
    ]
    products = torch.stack([torch.stack(row, dim=-1) for row in rows], dim=-2)
    largest = products.diagonal(dim1=-2, dim2=-1).argmax(-1)
    found = products.take_along_dim(largest[..., None, None], dim=-2).squeeze(-2)
    return found / found.norm(dim=-1, keepdim=True)


def steady(quaternions: Float[Tensor, "*b T J 4"]) -> Float[Tensor, "*b T J 4"]:
    """The same rotations by quaternions that go on from frame to frame without a change of sign; w >= 0 at first."""
    near = (quaternions[..., 1:, :, :] * quaternions[..., :-1, :, :]).sum(-1) >= 0
    signs = torch.cat([quaternions[..., :1, :, 0] >= 0, near], dim=-2).to(quaternions).mul(2).sub(1).cumprod(-2)
    return quaternions * signs[..., None]


def about(axis: int, angle: Float[Tensor, "*b"]) -> Float[Tensor, "*b 3 3"]:
    """Rotation matrices about a coordinate axis (0 to 2) by angles in radians."""
    vector = torch.nn.functional.one_hot(torch.tensor(axis), 3).to(angle)
    return matrices(torch.cat([(angle / 2).cos()[..., None], (angle / 2).sin()[..., None] * vector], dim=-1))


def angle(rotations: Float[Tensor, "*b 3 3"]) -> Float[Tensor, "*b"]:
    """By how much (rad, 0 to pi) rotations turn; without a gradient at no turn at all."""
    x, y, z = (rotations - rotations.mT)[..., (2, 0, 1), (1, 2, 0)].unbind(-1)
    trace = rotations.diagonal(dim1=-2, dim2=-1).sum(-1)
    return torch.atan2((x * x + y * y + z * z).sqrt(), trace - 1)


def axes(x: Float[Tensor, "*b 3"], y: Float[Tensor, "*b 3"]) -> Float[Tensor, "*b 3 3"]:
    """Right-handed axes as columns: the first along x, the second in the plane of x and y."""
    x = x / (x.square().sum(-1, keepdim=True) + 1e-12).sqrt()
    y = y - (y * x).sum(-1, keepdim=True) * x
    y = y / (y.square().sum(-1, keepdim=True) + 1e-12).sqrt()
    return torch.stack([x, y, torch.linalg.cross(x, y)], dim=-1)


def rotation_between(a: Float[Tensor, "*b 3"], b: Float[Tensor, "*b 3"]) -> Float[Tensor, "*b 3 3"]:
    """The smallest rotation that takes direction a to direction b; any half turn where they oppose."""
    a = a / a.norm(dim=-1, keepdim=True).clamp_min(1e-8)
    b = b / b.norm(dim=-1, keepdim=True).clamp_min(1e-8)
    half = a + b
    length = half.norm(dim=-1, keepdim=True)
    # Opposed directions leave the axis free: any one at right angles to a.
    side = torch.linalg.cross(a, torch.eye(3).to(a)[a.abs().argmin(-1)])
    half = torch.where(length > 1e-6, half / length.clamp_min(1e-6), torch.zeros_like(half))
    side = side / side.norm(dim=-1, keepdim=True).clamp_min(1e-8)
    w = (a * half).sum(-1, keepdim=True)
    xyz = torch.where(length > 1e-6, torch.linalg.cross(a, half), side)
    return matrices(torch.cat([w, xyz], dim=-1))
