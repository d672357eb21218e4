"""People who stand, and sit down and stand up again, written as formulas."""

from __future__ import annotations

import math

import torch
from jaxtyping import Float
from torch import Tensor

from scenectl.data.corpus import Clip
from scenectl.data.edits.limbs import axes, with_legs
from scenectl.data.edits.timing import eased
from scenectl.data.features import canonicalise
from scenes.motion.skeleton import HUMANML3D
from tests.scenectl.small import walk


def standing(frames: int = 80) -> Float[Tensor, "T 22 3"]:
    """A person who stands with arms that hang, and sways a little."""
    pose = canonicalise(walk(2, sway=0.0))[:1]
    for hip, leg in ((1, (4, 7, 10)), (2, (5, 8, 11))):  # both legs under the hips, the knees a little bent
        for joint, way in zip(leg, ((0.0, -1.0, 0.08), (0.0, -1.0, -0.08), (0.0, -0.33, 0.944)), strict=True):
            bone = torch.tensor(way)
            parent = hip if joint == leg[0] else HUMANML3D.parents[joint]
            pose[:, joint] = pose[:, parent] + bone / bone.norm() * HUMANML3D.bone_lengths[joint]
    joints = canonicalise(pose).expand(frames, -1, -1).clone()
    time = torch.arange(frames) / 20
    sway = torch.stack([0.01 * (2 * math.pi * 0.3 * time).sin(), 0 * time, 0 * time], -1)
    return with_legs(joints, sway, joints.new_zeros(frames, 2, 3))


def sitting(frames: int = 160, down: float = 0.42, back: float = 0.4) -> Clip:
    """A person who sits down, stays and stands up again."""
    joints = standing(frames)
    time = torch.arange(frames) / frames
    on = eased((time - 0.15) / 0.2) * eased((0.85 - time) / 0.2)
    _, forward = axes(joints)
    shift = on[:, None] * (torch.tensor([0.0, -down, 0.0]) - back * forward)
    led = with_legs(joints, shift, joints.new_zeros(frames, 2, 3))
    return Clip("s", canonicalise(led), ("a person sits down.",), "cmu", "train", "sit on stool", "free", True)
