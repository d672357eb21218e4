"""Recorded motions that a verdict is measured on: which, and how they stand on a floor."""

from __future__ import annotations

import math
import re
from pathlib import Path

import numpy as np
import torch

from scenectl.data.corpus import Clip, load_motions
from scenectl.data.kinds import kind_of
from scenectl.measures.metrics import SHALLOW, Scorer
from scenes.motion.headings import turned
from scenes.motion.motion import Motion
from scenes.world.scene import Scene

LEFT_OUT = ("climb", "sit", "sit and kneel", "get up", "acrobatics")
"""Kinds of `scenectl.data.kinds` that are climbing, sitting, lying and acrobatics."""
_LIKE_THEM = re.compile("crawl|slope|uneven", re.IGNORECASE)
"""Labels of other kinds that lie on the floor, or climb ground that the collection does not hold."""
SHORTEST = 20
"""Frames: shorter clips say little of a second."""
FLOOR = Scene.empty()
_BODY = Scorer(FLOOR)


def recordings(data: str | Path, split: str) -> list[Clip]:
    """Clips of a split without climbing, sitting, lying and acrobatics, of a second or more."""
    return [
        clip
        for clip in load_motions(data, (split,))
        if clip.frames >= SHORTEST and kind_of(clip) not in LEFT_OUT and not _LIKE_THEM.search(clip.label)
    ]


def floor_known(clip: Clip) -> bool:
    """Whether nothing of the body dips more than 3 cm below where it is lowest otherwise: no floor would fit both."""
    bottoms = _bottoms(Motion(clip.joints.double()))
    return bool(np.quantile(bottoms, 0.05) - bottoms.min() < 0.03)


def _bottoms(motion: Motion) -> np.ndarray:
    """Height (m) of the body's lowest point in each frame."""
    found: np.ndarray = (_BODY.points(motion.joints.numpy())[..., 1] - _BODY.radii).min(axis=1)
    return found


def on_floor(clip: Clip, heading: float = 0.0) -> Motion:
    """The clip on `FLOOR`, turned by `heading` (rad).

    Recordings do not state their floor. It is put where the body is lowest in 95 % of the frames, but nowhere deeper
    than the depth that counts as a touch.
    """
    joints = turned(clip.joints.double(), torch.tensor(heading, dtype=torch.float64))
    bottoms = _bottoms(Motion(joints))
    height = min(float(np.quantile(bottoms, 0.05)), float(bottoms.min()) + 0.9 * SHALLOW)
    joints[..., 1] -= height
    return Motion(joints)


def travel_speed(motion: Motion) -> float:
    """Mean speed (m/s) of the pelvis over the ground."""
    steps = motion.joints[:, 0, ::2].diff(dim=0).norm(dim=-1)
    return float(steps.mean()) * motion.fps if len(steps) else 0.0


def drawn_heading(draw: torch.Generator) -> float:
    """A heading (rad) by chance."""
    return 2 * math.pi * float(torch.rand((), generator=draw))
