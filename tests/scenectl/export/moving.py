"""A body that moves through all that people's joints allow, and goes about: what exports are tried with."""

from __future__ import annotations

import numpy as np
import torch

from scenectl.bench.studies.rotations import animated
from scenes.motion.motion import Motion
from scenes.motion.rigid import rigid
from scenes.motion.skeleton import HUMANML3D, Skeleton, with_lengths

OWN = with_lengths(HUMANML3D, np.linspace(0.9, 1.1, 22) * HUMANML3D.bone_lengths)
"""A person's of other proportions than HumanML3D's."""


def moving(frames: int = 40, seed: int = 0, fps: float = 20.0, skeleton: Skeleton = OWN) -> Motion:
    """Smooth random rotations along a curve, ``[T, 22, 3]`` float64, rigid."""
    times = torch.arange(frames, dtype=torch.float64) / fps
    way = torch.stack([1.0 + 0.8 * times, 1.0 + 0.1 * torch.sin(4 * times), -2.0 + torch.sin(times)], dim=-1)
    motion = rigid(animated(frames, seed, fps)[1], skeleton)
    return Motion(motion.joints + way[:, None], fps=fps, skeleton=skeleton)


def lengths(joints: np.ndarray, parents: tuple[int, ...]) -> np.ndarray:
    """Length of every bone in every frame, ``[T, J - 1]``."""
    found: np.ndarray = np.linalg.norm(joints[:, 1:] - joints[:, list(parents[1:])], axis=-1)
    return found
