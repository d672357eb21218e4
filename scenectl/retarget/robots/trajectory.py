"""What a robot is to do: its free joint and its joints over time."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Float

from scenectl.retarget.plants import Plant
from scenes.motion.motion import Motion

if TYPE_CHECKING:
    from scenectl.retarget.robots.robot import Robot


@dataclass(frozen=True, eq=False)
class Trajectory:
    """A robot's motion, in MuJoCo's convention: metres, radians, z up, quaternions w x y z.

    The world is turned back from how `TO_Y_UP["z"]` of `scenes.mesh.scale` turns it: our (x, y, z) is (x, -z, y) here,
    so that a scene that was read with `up = "z"` stands where its file has it.

    Attributes:
        robot: whose.
        qpos: the free joint (place and quaternion) and then all joints, in the order of the model, ``[T, nq]``.
        fps: frames a second.
        source: the motion that the robot follows, scaled to it, at this rate, ``[T, 22, 3]``, metres, y up.
        plants: where the source's feet stand.
        t0: time (s) of the first frame on the clock of what moves in the scene.
    """

    robot: Robot
    qpos: Float[np.ndarray, "T Q"]
    fps: float
    source: Motion
    plants: tuple[Plant, ...]
    t0: float = 0.0

    @property
    def frames(self) -> int:
        """Number of frames T."""
        return len(self.qpos)
