"""What a robot is to do: its free joint and its joints over time."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from scenectl.retarget.plants import Plant
from scenectl.retarget.robots.humanoid import Humanoid
from scenectl.retarget.robots.reading import borrowed
from scenes.errors import UserError, did_you_mean
from scenes.motion.motion import Motion


@dataclass(frozen=True, eq=False)
class Trajectory:
    """A robot's motion, in MuJoCo's convention: metres, radians, z up, quaternions w x y z.

    The world is turned back from how `TO_Y_UP["z"]` of `scenes.mesh.scale` turns it: our (x, y, z) is (x, -z, y) here,
    so that a scene that was read with `up = "z"` stands where its file has it.

    Attributes:
        robot: whose.
        qpos: the free joint (place and quaternion) and then all joints, in the order of the model, ``[T, nq]``.
        fps: frames a second.
        source: the motion that the robot follows, scaled to it, at this rate, ``[T, 22, 3]``, metres, y up; its feet
            (`left_foot`, `right_foot`) are the tips of the robot's soles.
        plants: where the robot's feet are to stand, in the frame of `source`: an ankle where the toes don't stand, too.
        t0: time (s) of the first frame on the clock of what moves in the scene.
    """

    robot: Humanoid
    qpos: Float[np.ndarray, "T Q"]
    fps: float
    source: Motion
    plants: tuple[Plant, ...]
    t0: float = 0.0

    @property
    def frames(self) -> int:
        """Number of frames T."""
        return len(self.qpos)

    @property
    def times(self) -> Float[np.ndarray, " T"]:
        """Seconds from the first frame."""
        return np.arange(self.frames) / self.fps

    def joint(self, name: str) -> Float[np.ndarray, "T 3"]:
        """Where one of our joints is on the robot (`Points.bodies`), metres, z up; UserError for one it lacks."""
        return self.joints((name,))[:, 0]

    def joints(self, names: Sequence[str]) -> Float[np.ndarray, "T n 3"]:
        """Where several of our joints are on the robot."""
        bodies = self.robot.points.bodies
        if strange := [name for name in names if name not in bodies]:
            raise UserError(f"robot '{self.robot.name}' has no '{strange[0]}'{did_you_mean(strange[0], bodies)}")
        mujoco = borrowed("mujoco")
        model, data = self.robot.model, mujoco.MjData(self.robot.model)
        on = [bodies[name][0] for name in names]
        at = np.array([bodies[name][1] for name in names])
        found = np.empty((self.frames, len(names), 3))
        for frame, qpos in enumerate(self.qpos):
            data.qpos[:] = qpos
            mujoco.mj_kinematics(model, data)
            found[frame] = data.xpos[on] + (data.xmat[on].reshape(-1, 3, 3) @ at[:, :, None])[:, :, 0]
        return found
