"""Words for parts of the body, things in a scene and moments."""

from __future__ import annotations

import numpy as np

from scenes.motion.skeleton import Skeleton

_BONES = {
    "knee": "thigh", "ankle": "shin", "foot": "foot", "elbow": "upper arm", "wrist": "forearm", "hip": "hip",
    "shoulder": "shoulder", "collar": "collarbone", "spine1": "lower back", "spine2": "back", "spine3": "upper back",
    "neck": "neck", "head": "head",
}  # fmt: skip
"""What the bone that ends in a joint is called."""


def part_name(part: str) -> str:
    """ "left_hip-left_knee" is the left thigh; a joint or a palm keeps its name."""
    near, _, far = part.partition("-")
    return bone_name(far) if far else near.replace("_", " ")


def bone_name(joint: str) -> str:
    """What the bone that ends in a joint is called, with its side."""
    side, _, name = joint.rpartition("_")
    return f"{side} {_BONES.get(name, name)}".strip()


def joint_name(skeleton: Skeleton, joint: int) -> str:
    """A joint's name in plain words."""
    return skeleton.names[joint].replace("_", " ")


def span(times: np.ndarray, first: int, last: int) -> str:
    """ "from 1.2 to 1.9 s"."""
    return f"from {times[first]:.1f} to {times[last]:.1f} s"


def centimetres(metres: float) -> str:
    """ "6 cm"."""
    return f"{100 * metres:.0f} cm"
