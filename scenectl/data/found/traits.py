"""What can be read off a recorded motion frame by frame: how fast it goes, how it turns, how upright it stands."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float
from scipy.ndimage import gaussian_filter1d
from torch import Tensor

from scenectl.data.features import FPS
from scenes.motion.headings import heading
from scenes.motion.motion import Motion
from scenes.motion.skeleton import HUMANML3D

PELVIS, NECK, HEAD = HUMANML3D.indices(("pelvis", "neck", "head"))
HIPS, KNEES, ANKLES, TOES, SHOULDERS, ELBOWS, WRISTS = (
    HUMANML3D.indices([f"{side}_{part}" for side in ("left", "right")])
    for part in ("hip", "knee", "ankle", "foot", "shoulder", "elbow", "wrist")
)
FEET = [*ANKLES, *TOES]


@dataclass(frozen=True)
class Traits:
    """Of every frame of a motion, smoothed where noise of the capture would count.

    Attributes:
        speed: of the pelvis over the floor, m/s.
        ahead: the part of it that goes where the body faces, m/s.
        heading: radians about +y (positive to the person's left), unwrapped.
        height: of the pelvis, m.
        quickest: speed of the fastest joint, m/s.
        feet: speed of the fastest ankle or toe, m/s.
        trunk: cosine of the trunk's angle from the vertical.
        arms: angle from hanging straight down, degrees, of the upper arm or forearm that is raised most.
        knees: bend of the knee that is more bent, degrees.
        thighs: angle of the more level thigh from the vertical, degrees.
    """

    speed: Float[np.ndarray, " T"]
    ahead: Float[np.ndarray, " T"]
    heading: Float[np.ndarray, " T"]
    height: Float[np.ndarray, " T"]
    quickest: Float[np.ndarray, " T"]
    feet: Float[np.ndarray, " T"]
    trunk: Float[np.ndarray, " T"]
    arms: Float[np.ndarray, " T"]
    knees: Float[np.ndarray, " T"]
    thighs: Float[np.ndarray, " T"]

    @classmethod
    def of(cls, joints: Float[Tensor, "T 22 3"]) -> Traits:
        p = joints.double().numpy()
        path = gaussian_filter1d(p[:, PELVIS], 3.0, axis=0, mode="nearest")
        velocity = np.gradient(path, axis=0) * FPS
        facing = gaussian_filter1d(np.unwrap(heading(Motion(joints)).double().numpy()), 2.0, mode="nearest")
        moved = np.linalg.norm(np.gradient(gaussian_filter1d(p, 1.0, axis=0, mode="nearest"), axis=0), axis=-1) * FPS
        down = np.array([0.0, -1.0, 0.0])
        return cls(
            speed=np.linalg.norm(velocity[:, [0, 2]], axis=-1),
            ahead=velocity[:, 0] * np.sin(facing) + velocity[:, 2] * np.cos(facing),
            heading=facing,
            height=gaussian_filter1d(p[:, PELVIS, 1], 1.0, mode="nearest"),
            quickest=moved.max(-1),
            feet=moved[:, FEET].max(-1),
            trunk=_unit(p[:, NECK] - p[:, PELVIS])[:, 1],
            arms=_degrees(_unit(p[:, [*ELBOWS, *WRISTS]] - p[:, [*SHOULDERS, *ELBOWS]]) @ down).max(-1),
            knees=bends(p).max(-1),
            thighs=_degrees(_unit(p[:, KNEES] - p[:, HIPS]) @ down).max(-1),
        )


def bends(joints: Float[np.ndarray, "T 22 3"]) -> Float[np.ndarray, "T 2"]:
    """How far each knee is bent, degrees; 0 is straight."""
    thigh, shin = joints[:, KNEES] - joints[:, HIPS], joints[:, ANKLES] - joints[:, KNEES]
    return _degrees((_unit(thigh) * _unit(shin)).sum(-1))


def runs(mask: Bool[np.ndarray, " T"], least: int, gap: int = 0) -> list[tuple[int, int]]:
    """First frames and ends of the stretches of at least `least` frames where `mask` holds; short gaps count too."""
    edges = np.flatnonzero(np.diff(np.r_[False, mask, False].astype(np.int8)))
    found: list[list[int]] = []
    for begin, end in edges.reshape(-1, 2).tolist():
        if found and begin - found[-1][1] <= gap:
            found[-1][1] = end
        else:
            found.append([begin, end])
    return [(begin, end) for begin, end in found if end - begin >= least]


def wander(joints: Float[Tensor, "T 22 3"], which: list[int]) -> float:
    """Farthest that any of some joints gets from where it is in the mean, m."""
    some = joints[:, which]
    return float((some - some.mean(0)).norm(dim=-1).max())


def _unit(v: np.ndarray) -> np.ndarray:
    return v / np.maximum(np.linalg.norm(v, axis=-1, keepdims=True), 1e-9)


def _degrees(cosine: np.ndarray) -> np.ndarray:
    return np.degrees(np.arccos(np.clip(cosine, -1.0, 1.0)))
