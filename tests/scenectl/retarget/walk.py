"""A walk whose truth is known: feet that stand still, heels that rise, and a reach of the right arm."""

from __future__ import annotations

import numpy as np
import torch

from scenectl.export.animation import Animation
from scenes.motion.bones import rest_pose
from scenes.motion.motion import Motion
from scenes.motion.rigid import rigid
from scenes.motion.skeleton import HUMANML3D

_AT = HUMANML3D.index


def walk(seconds: float = 3.0, fps: float = 20.0, stride: float = 1.2, heading: float = 0.0) -> Animation:
    """Steps of half a stride (m) a second long stride, starting at (1, 0, 2), the right arm held out."""
    rest = rest_pose(HUMANML3D).numpy()
    t = np.arange(round(seconds * fps)) / fps
    joints = np.tile(rest, (len(t), 1, 1))
    joints += np.array([0.0, 0.86, 0.0]) + stride * t[:, None, None] * np.array([0.0, 0.0, 1.0])
    for j in (18, 20):
        joints[:, j] = joints[:, 16] - [0.0, 0.25 if j == 18 else 0.51, 0.0]
    for j in (19, 21):
        joints[:, j] = joints[:, 17] + [0.0, 0.0, 0.26 if j == 19 else 0.53]
    for side, phase in (("left", 0.0), ("right", 0.5)):
        hip, knee, ankle, foot = (_AT(f"{side}_{name}") for name in ("hip", "knee", "ankle", "foot"))
        cycle, number = np.modf(t + phase)
        swing = ((cycle - 0.6) / 0.4).clip(0, 1)
        ahead = stride * (number + swing**2 * (3 - 2 * swing) - phase) + 0.35 * stride
        lift, pitch = np.sin(np.pi * swing), -0.7 * np.sin(2 * np.pi * swing.clip(0, 0.5))
        toe = np.array(HUMANML3D.offsets[foot])
        joints[:, ankle] = np.stack([joints[:, hip, 0], 0.08 + 0.08 * lift, ahead], axis=-1)
        turned = np.stack([0 * t, np.cos(pitch) * toe[1] + np.sin(pitch) * toe[2],
                           np.cos(pitch) * toe[2] - np.sin(pitch) * toe[1]], axis=-1)  # fmt: skip
        joints[:, foot] = joints[:, ankle] + turned
        joints[:, knee] = _knee(joints[:, hip], joints[:, ankle], *HUMANML3D.bone_lengths[[knee, ankle]])
    c, s = np.cos(heading), np.sin(heading)
    joints = joints @ np.array([[c, 0, -s], [0, 1, 0], [s, 0, c]]) + [1.0, 0.0, 2.0]
    animation, moved = Animation.of(rigid(Motion(torch.from_numpy(joints), fps=fps)), "walk")
    assert moved == 0
    return animation


def _knee(hip: np.ndarray, ankle: np.ndarray, thigh: float, shin: float) -> np.ndarray:
    way = ankle - hip
    far = np.linalg.norm(way, axis=-1, keepdims=True)
    way, reach = way / far, np.minimum(far, thigh + shin - 1e-6)
    along = (reach**2 + thigh**2 - shin**2) / (2 * reach)
    ahead = np.array([0.0, 0.0, 1.0]) - way[:, 2:] * way
    ahead /= np.linalg.norm(ahead, axis=-1, keepdims=True)
    return np.asarray(hip + along * way + np.sqrt(np.maximum(thigh**2 - along**2, 0)) * ahead)
