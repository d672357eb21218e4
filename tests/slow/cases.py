"""What is exported, and where everything should then be: the same sums as in no exporter, in Blender's axes."""

from __future__ import annotations

from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from scenectl.export.animation import Animation
from scenes.motion.motion import Motion

MOMENTS = 10
FPS = 30


@dataclass
class Moment:
    """Where things are at a time (s): joints by name, corners of the person's mesh and of what moves (m, z up)."""

    time: float
    joints: dict[str, list[float]]
    mesh: list[list[float]] = field(default_factory=list)
    things: dict[str, list[list[float]]] = field(default_factory=dict)


@dataclass
class Play:
    """One animation in a file."""

    name: str
    moments: list[Moment]


@dataclass
class Case:
    """A file, what it should show, the frame of its first moment in Blender, and where a picture goes."""

    file: str
    picture: str
    fps: float
    first: int
    rest: dict[str, list[float]]
    plays: list[Play]

    def table(self) -> dict[str, Any]:
        return asdict(self)


def blenders(points: np.ndarray) -> Any:
    """Points (y up, facing +z) as Blender has them, z up, facing -y."""
    x, y, z = np.moveaxis(np.asarray(points, np.float64), -1, 0)
    return np.stack([x, -z, y], axis=-1).tolist()


def at_rest(animation: Animation) -> np.ndarray:
    """Joints in the T-pose, ``[J, 3]``, from the root."""
    places = np.zeros((len(animation.skeleton.names), 3))
    for parent, joint in animation.skeleton.bones:
        places[joint] = places[parent] + animation.skeleton.offsets[joint]
    return places


def moments(motion: Motion, animation: Animation, names: list[str]) -> list[Moment]:
    """At whole frames of both: our joints are where the motion has them, others where the animation does."""
    every = np.linspace(0, motion.frames - 1, MOMENTS).round().astype(int)
    found = []
    for frame in every:
        places = animation.joints[frame].copy()
        places[animation.ours] = motion.joints[frame].numpy()
        found.append(Moment(float(frame / motion.fps), dict(zip(names, blenders(places), strict=True))))
    return found
