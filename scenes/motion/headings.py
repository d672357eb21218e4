"""Headings: which way a body faces on the floor, and turns about the vertical.

A heading is an angle about +y in radians: 0 faces +z, pi/2 faces +x, which is a person's left at rest.
"""

from __future__ import annotations

import torch
from jaxtyping import Float
from torch import Tensor

from scenes.motion.motion import Motion


def heading_of(forward: Float[Tensor, "*b 3"]) -> Float[Tensor, "*b"]:
    """Heading (rad, -pi to pi) of directions that point forward; their height does not matter."""
    return torch.atan2(forward[..., 0], forward[..., 2])


def heading_across(across: Float[Tensor, "*b 3"]) -> Float[Tensor, "*b"]:
    """Heading (rad, -pi to pi) of bodies for which `across` points from their right to their left."""
    return torch.atan2(-across[..., 2], across[..., 0])


def across(motion: Motion, parts: tuple[str, ...] = ("hip", "shoulder")) -> Float[Tensor, "*b T 3"]:
    """From right to left through a body (m): the sum over pairs of joints, such as both hips."""
    sides = (motion.joint(f"left_{part}") - motion.joint(f"right_{part}") for part in parts)
    return sum(sides, start=torch.zeros_like(motion.joints[..., 0, :]))


def heading(motion: Motion, parts: tuple[str, ...] = ("hip", "shoulder")) -> Float[Tensor, "*b T"]:
    """Heading (rad, -pi to pi) of a motion at every frame, by pairs of joints."""
    return heading_across(across(motion, parts))


def rotation_about_y(heading: Float[Tensor, "*b"]) -> Float[Tensor, "*b 3 3"]:
    """Rotation matrices about +y by angles in radians; +z turns towards +x."""
    c, s, zero, one = heading.cos(), heading.sin(), torch.zeros_like(heading), torch.ones_like(heading)
    rows = torch.stack([c, zero, s, zero, one, zero, -s, zero, c], dim=-1)
    return rows.unflatten(-1, (3, 3))


def turned(vectors: Float[Tensor, "*d 3"], heading: Float[Tensor, "*c"]) -> Float[Tensor, "*e 3"]:
    """Vectors turned about +y by angles in radians, which broadcast to ``vectors[..., 0]``; +z turns towards +x."""
    return turned_by(vectors, heading.cos(), heading.sin())


def turned_by(
    vectors: Float[Tensor, "*d 3"], cosine: Float[Tensor, "*c"], sine: Float[Tensor, "*c"]
) -> Float[Tensor, "*e 3"]:
    """The same, by the cosine and sine of the angle."""
    x, y, z = vectors.unbind(-1)
    x, y, z = torch.broadcast_tensors(cosine * x + sine * z, y, cosine * z - sine * x)
    return torch.stack([x, y, z], dim=-1)
