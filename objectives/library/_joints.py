"""How goals are told joints: one name, several, or none for all of them."""

from __future__ import annotations

from typing import Literal

from jaxtyping import Float
from torch import Tensor

from scenes.motion.motion import Motion

Joints = str | list[str]
Axes = Literal["x", "y", "z", "xy", "xz", "yz", "xyz"]
"""Some of the world's axes."""


def chosen(joints: Joints | None, motion: Motion) -> list[str]:
    """Names of the joints meant, all of the skeleton's for None."""
    if joints is None:
        return list(motion.skeleton.names)
    return [joints] if isinstance(joints, str) else list(joints)


def placed(joints: Joints | None, motion: Motion) -> tuple[list[str], Float[Tensor, "*b T n 3"]]:
    """Names of the joints meant and their positions, world m; all of the skeleton's for None."""
    names = chosen(joints, motion)
    return names, motion.joints if joints is None else motion.select(names)
