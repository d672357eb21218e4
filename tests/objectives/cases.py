"""A small example of every registered goal, and a world for it; the registry-wide tests run over these."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from objectives import Context
from scenes.body.body import Segments
from scenes.mesh.primitives import Box
from scenes.motion.motion import Motion
from scenes.motion.skeleton import HUMANML3D, Skeleton
from scenes.world.moving import MovingObject, Trajectory


@dataclass(frozen=True)
class Ball:
    """A smooth analytic scene: the floor, and a sphere that drifts along x."""

    center: tuple[float, float, float] = (0.3, 0.9, 0.4)
    radius: float = 0.4
    drift: float = 0.05  # m/s
    epoch: float = 0.0  # s at which the sphere is at its center
    floor: float = 0.0

    @property
    def ground(self) -> float:
        return self.floor

    @property
    def bounds(self) -> np.ndarray:
        return np.array([[-3.0, self.floor, -3.0], [3.0, self.floor + 3.0, 3.0]])

    def part(self, name: str) -> MovingObject:
        """A box that rests."""
        return MovingObject(Box((0.0, 0.0, 0.0), (0.2, 0.3, 0.1)), Trajectory((0.0,), ((0.3, 1.0, 0.4),), (0.3,)), name)

    def distance(self, points: Tensor, time: Tensor | None = None) -> Tensor:
        now = torch.zeros_like(points[..., 0]) if time is None else time.expand(points.shape[:-1]) - self.epoch
        offset = points - points.new_tensor(self.center) - now[..., None] * points.new_tensor([self.drift, 0, 0])
        return torch.minimum(offset.norm(dim=-1) - self.radius, points[..., 1] - self.floor)


@dataclass(frozen=True)
class Joints:
    """A proxy body of one sphere for each joint."""

    size: float = 0.06
    skeleton: Skeleton = HUMANML3D
    sole_offset: float = 0.02

    @property
    def owners(self) -> list[str]:
        return list(HUMANML3D.names)

    def points(self, motion: Motion) -> tuple[Float[Tensor, "*b T M 3"], Float[Tensor, " M"]]:
        return motion.joints, motion.joints.new_full((22,), self.size) + 0.01 * torch.arange(22) / 22

    def segments(self, motion: Motion) -> Segments:
        points, radius = self.points(motion)
        return Segments(points, points, radius, self.owners)


def context(epoch: float = 0.0, x: float = 0.3) -> Context:
    return Context(Ball(center=(x, 0.9, 0.4), epoch=epoch), Joints())


def standing(frames: int = 9, *batch: int, dtype: torch.dtype = torch.float64) -> Tensor:
    """Joints of a person at rest with the lowest joint at y = 0, ``[*b, T, 22, 3]``."""
    rest = np.zeros((22, 3))
    for joint, parent in enumerate(HUMANML3D.parents):
        rest[joint] = (rest[parent] if parent >= 0 else 0.0) + np.asarray(HUMANML3D.offsets[joint])
    rest[:, 1] -= rest[:, 1].min()
    return torch.as_tensor(rest, dtype=dtype).expand(*batch, frames, 22, 3).clone()


def wandering(*batch: int, frames: int = 9, seed: int = 0, t0: float = 0.0) -> Motion:
    """A person who walks and trembles, float64; every goal below has something to complain about."""
    noise = torch.Generator().manual_seed(seed)
    joints = standing(frames, *batch)
    joints = joints + 0.05 * torch.randn(joints.shape, generator=noise, dtype=joints.dtype)
    steps = torch.arange(frames, dtype=joints.dtype)[:, None] * 0.08
    return Motion(joints + steps[..., None] * joints.new_tensor([0.5, 0.1, 1.0]), t0=t0)


def recorded(frames: int = 9, seed: int = 5) -> list[Any]:
    """Positions ``[T, 22, 3]`` of another person who walks and trembles, turned to the side, as plain numbers."""
    joints = wandering(frames=frames, seed=seed).joints
    return (joints[..., [2, 1, 0]] * joints.new_tensor([1.0, 1.0, -1.0])).tolist()


Example = Callable[[float], dict[str, Any]]
"""Parameters (and `at`, `window`) of a term whose stated times are all shifted by so many seconds."""

EXAMPLES: dict[str, list[Example]] = {
    "joint_target": [
        lambda s: {"joint": "right_wrist", "position": [0.2, 1.0, 0.3], "at": 0.2 + s},
        lambda s: {"joint": "pelvis", "position": [[0.1, 0.2], [0.3, 0.9]], "at": [0.1 + s, 0.35 + s]},
        lambda s: {
            "joint": ["head", "left_foot"],
            "track": {
                "kind": "array",
                "positions": np.linspace(0, 1, 7 * 2 * 3).reshape(7, 2, 3).tolist(),
                "mask": [[1, 0], [1, 1], [0, 0], [1, 1], [0, 1], [1, 1], [1, 1]],
                "begin": 0.05 + s,
            },
        },
        lambda s: {
            "track": {"kind": "arc", "center": [0, 1, 0], "radius": 0.5, "angles": [0, 2], "times": [0.1 + s, 0.3 + s]},
            "axes": "xz",
        },
    ],
    "face": [
        lambda s: {"position": [1.0, 2.0], "within": 5.0, "at": [0.1 + s, 0.35 + s]},
        lambda s: {"part": "chest", "heading": 0.7, "window": [0.1 + s, 0.3 + s]},
        lambda s: {"part": "head", "direction": [1.0, -0.5, 0.4], "level": False},
        lambda s: {
            "part": "pelvis",
            "track": {"kind": "line", "start": [1, 1, 0], "end": [-1, 1, 1], "times": [0.1 + s, 0.35 + s]},
        },
    ],
    "bone_direction": [
        lambda s: {"bone": "left_wrist", "direction": [0.0, 1.0, 1.0], "at": 0.2 + s},
        lambda s: {"bone": ["right_shoulder", "right_wrist"], "position": [1.0, 1.2, 2.0], "within": 10.0},
        lambda s: {"bone": "right_knee", "direction": [0.0, 0.0, 1.0], "frame": "pelvis"},
    ],
    "joint_rotation": [
        lambda s: {"joint": "left_shoulder", "euler": [0.0, -40.0, -60.0], "at": 0.3 + s},
        lambda s: {"joint": "pelvis", "quaternion": [0.8, 0.0, 0.6, 0.0], "within": 5.0},
        lambda s: {"joint": "right_elbow", "euler": [10.0, 0.0, 20.0], "frame": "world"},
    ],
    "sphere_repulsion": [
        lambda s: {"center": [0.1, 1.0, 0.2], "radius": 0.3, "margin": 0.2},
        lambda s: {
            "center": {
                "kind": "waypoints",
                "times": [0.0 + s, 0.2 + s, 0.5 + s],
                "positions": [[0, 1, 0], [0.2, 1, 0.3], [0, 0, 1]],
            },
            "radius": 0.3,
            "joints": ["head", "pelvis", "left_knee"],
        },
    ],
    "capsule_repulsion": [
        lambda s: {
            "a": {"kind": "line", "start": [0, 0, 0], "end": [0.5, 0, 0.5], "times": [0.0 + s, 0.4 + s]},
            "b": [0.0, 1.5, 0.0],
            "radius": 0.15,
        }
    ],
    "sdf_penetration": [
        lambda s: {"margin": 0.03},
        lambda s: {"exempt": ["left_foot", "right_foot"], "exempt_windows": [[0.1 + s, 0.2 + s]]},
        lambda s: {"touches": {"left_foot": [[0.1 + s, 0.2 + s]], "right_foot": [[s, 0.1 + s], [0.3 + s, 0.4 + s]]}},
    ],
    "swept_penetration": [
        lambda s: {"margin": 0.03, "speed": 0.05},
        lambda s: {"exempt": ["left_foot", "right_foot"], "exempt_windows": [[0.1 + s, 0.2 + s]]},
        lambda s: {"touches": {"left_foot": [[0.1 + s, 0.2 + s]], "right_foot": [[s, 0.1 + s], [0.3 + s, 0.4 + s]]}},
    ],
    "contact": [
        lambda s: {"part": "seat"},
        lambda s: {"part": "right_hand", "position": [0.2, 1.0, 0.2], "slide": 0.02, "within": 0.01},
        lambda s: {"part": "left_foot", "window": [0.1 + s, 0.3 + s]},
    ],
    "support": [
        lambda s: {"parts": ["right_hand"]},
        lambda s: {"parts": ["right_hand", "right_foot"], "window": [0.1 + s, 0.3 + s]},
    ],
    "hold": [
        lambda s: {"object": "box", "hand": "left", "position": [0.2, 1.0, 0.2]},
        lambda s: {"object": "box", "hand": "left", "position": [0.3, 1.1, 0.2], "at": 0.2 + s, "turned": 0.3},
        lambda s: {"object": "box", "hand": "left", "left": -0.4, "up": -0.35, "forward": 0.25},
        lambda s: {"object": "box", "hand": "both", "facing": 0.4, "window": [0.1 + s, 0.3 + s]},
    ],
    "foot_contact": [lambda s: {"threshold": 0.01}, lambda s: {"threshold": 0.01, "each": True}],
    "head_height": [
        lambda s: {"height": [1.3, 1.2, 1.4]},
        lambda s: {"height": 1.2, "at": [0.1 + s, 0.3 + s], "weights": [1, 3]},
        lambda s: {"height": 1.4, "mode": "below", "window": [0.1 + s, 0.3 + s]},
    ],
    "height_limit": [
        lambda s: {"limit": 1.2, "joints": ["head", "neck"]},
        lambda s: {"limit": 1.1, "mode": "above", "joints": "pelvis", "region": {"z": [0.2, 0.5]}},
    ],
    "square_region": [lambda s: {"half": 0.25}],
    "barrier": [lambda s: {"stand": 1.6, "duck": 1.0, "feet": -0.1}],
    "follow_path": [
        lambda s: {"path": [[0.5, 0], [0.5, 0.5], [1.0, 0.8]], "half_width": 0.1},
        lambda s: {
            "path": [[0.5, 0], [0.5, 0.5], [1.0, 0.8]],
            "half_width": 0.1,
            "begin": 0.05 + s,
            "end": 0.3 + s,
            "lag": 0.15,
            "pace": "ease",
        },
        lambda s: {
            "path": [[0.5, 0], [0.5, 0.5], [1.0, 0.8]],
            "half_width": 0.1,
            "begin": 0.05 + s,
            "end": 0.4 + s,
            "lag": 0.15,
            "brake": 0.2,
        },
    ],
    "foot_skating": [lambda s: {"height": 0.06}],
    "foot_clearance": [lambda s: {"height": 0.3, "speed": 0.4}],
    "speed_limit": [
        lambda s: {"limit": 0.05},
        lambda s: {"limit": 0.02, "joints": ["pelvis", "left_foot"], "axes": "xz"},
    ],
    "smoothness": [lambda s: {"limit": 5.0, "joints": ["head", "left_wrist"]}],
    "pose": [
        lambda s: {"pose": recorded(1)[0], "at": 0.2 + s},
        lambda s: {"pose": recorded(2), "at": [0.1 + s, 0.35 + s], "frame": "world", "within": 0.05},
        lambda s: {"pose": recorded(1)[0], "joints": ["left_wrist", "head"], "window": [0.1 + s, 0.3 + s]},
    ],
    "like": [
        lambda s: {"clip": {"positions": recorded(7)}, "begin": 0.1 + s},
        lambda s: {"clip": {"positions": recorded(4), "fps": 8}, "begin": s, "joints": "right_foot", "frame": "world"},
        lambda s: {"clip": {"positions": recorded(7), "fps": 24}, "timing": "free", "begin": 0.05 + s, "within": 0.02},
        lambda s: {
            "clip": {"positions": recorded(12)},
            "frame": "world",
            "timing": "free",
            "begin": s,
            "end": 0.4 + s,
            "position": [0.3, 0.2],
            "heading": 1.0,
            "clear": 0.1,
        },
    ],
    "joint_limits": [lambda s: {"knee": 0.1, "elbow": 0.1, "backwards": 0.05}],
}

# Parameters under which a person standing at rest at the origin (lowest joint at y = 0.02) meets the goal exactly.
SATISFIED: dict[str, dict[str, Any]] = {
    "joint_target": {"joint": "pelvis", "position": None},  # the test states where the pelvis is
    "face": {"heading": 0.0},
    "bone_direction": {"bone": "left_wrist", "direction": [1.0, 0.0, 0.0]},
    "joint_rotation": {"joint": "right_knee", "quaternion": [1.0, 0.0, 0.0, 0.0], "within": 0.1},
    "sphere_repulsion": {"center": [2, 1, 2], "radius": 0.3},
    "capsule_repulsion": {"a": [2, 0, 2], "b": [2, 1, 2], "radius": 0.3},
    "sdf_penetration": {"exempt": ["left_foot", "right_foot", "left_ankle", "right_ankle"]},
    "swept_penetration": {"exempt": ["left_foot", "right_foot", "left_ankle", "right_ankle"]},
    "contact": {"part": "left_hand", "within": 2.0},
    "support": {"parts": ["left_foot", "right_foot"]},
    "hold": {"object": "box", "hand": "left", "left": 0.5},
    "foot_contact": {"threshold": 0.0},
    "head_height": {"height": None},  # the test states where the head is
    "height_limit": {"limit": 2.0},
    "square_region": {"half": 1.0},
    "barrier": {"stand": 1.2, "duck": 1.8, "feet": 0.05},
    "follow_path": {"path": [[0, 0], [0, 1]], "half_width": 0.3},
    "foot_skating": {"allowed": 0.0},
    "foot_clearance": {"height": 0.5, "speed": 0.0},
    "speed_limit": {"limit": 0.0},
    "smoothness": {"limit": 0.0},
    "joint_limits": {"knee": 0.5},
    "pose": {"pose": standing(1)[0].tolist(), "within": 1e-6},
    "like": {"clip": {"positions": standing(9).tolist()}, "within": 1e-6},
}
