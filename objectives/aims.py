"""Aims: how goals want joints and bones turned, as plain data, and what an angle counts beside a distance."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import torch
from jaxtyping import Float
from torch import Tensor

from scenes.motion.rotations import matrices
from scenes.motion.skeleton import Skeleton

A_METRE = {"m": 1.0, "rad": 1.8, "deg": 100.0}
"""What counts as a metre: an angle by how far it moves a hand, 0.55 m from the shoulder."""


@dataclass(frozen=True)
class Aim:
    """How entries of a goal shall be turned in the world.

    Attributes:
        kind: what of them: the bone that ends in the entry's joint, the joint's front (the z axis of its rotation), or
            its whole rotation against the T-pose.
        values: unit vectors ``[*b, T, n, 3]``, or of rotations unit quaternions w, x, y, z ``[*b, T, n, 4]``. Nan where
            nothing is stated; a front whose height alone is nan shall have that heading.
    """

    kind: Literal["bone", "front", "rotation"]
    values: Float[Tensor, "*b T n d"]


def pointed(aim: Aim, joints: Sequence[str | None], skeleton: Skeleton) -> Float[Tensor, "*b T n 3"]:
    """Directions that show an aim: of a rotation the one in which the longest bone from its joint shall point."""
    if aim.kind != "rotation":
        x, y, z = aim.values.unbind(-1)
        return torch.stack([x, torch.where(x.isfinite(), y.nan_to_num(), y), z], dim=-1)
    rest = aim.values.new_tensor([_longest(skeleton, joint) for joint in joints])
    return torch.einsum("...nij,nj->...ni", matrices(aim.values), rest)


def _longest(skeleton: Skeleton, joint: str | None) -> list[float]:
    """Unit direction at rest of the longest bone from a joint; forward where none leaves it."""
    ends = [] if joint is None else [j for j, parent in enumerate(skeleton.parents) if parent == skeleton.index(joint)]
    end = max(ends, key=lambda j: float(skeleton.bone_lengths[j]), default=0)
    size = float(skeleton.bone_lengths[end])
    return [value / size for value in skeleton.offsets[end]] if size > 0 else [0.0, 0.0, 1.0]
