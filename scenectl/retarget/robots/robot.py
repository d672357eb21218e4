"""Robots that follow motions."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from scenectl.retarget.robots.avoid import clear
from scenectl.retarget.robots.humanoid import Humanoid
from scenectl.retarget.robots.solve import solved
from scenectl.retarget.robots.targets import Body, resampled, targets
from scenectl.retarget.robots.trajectory import Trajectory
from scenes.body.body import STATURE
from scenes.errors import UserError
from scenes.motion.motion import Motion
from scenes.motion.skeleton import HUMANML3D
from scenes.world.scene import Scene

FPS = 50.0
"""Frames a second at which controllers of humanoids track motions (mjlab, BeyondMimic)."""


class Robot(Humanoid):
    """A humanoid robot from its own file, that can be made to follow motions: ``Robot("g1.xml").retarget(motion)``."""

    @property
    def stature(self) -> float:
        """Height (m) of a person with legs as long as the robot's.

        Motions of a task with ``body = { height = ... }`` of that are followed without a scale: the robot comes to all
        places that its scene has for it.
        """
        return STATURE * Body(self.points, HUMANML3D).legs

    def retarget(
        self,
        motion: Motion,
        fps: float | int = FPS,
        scene: Scene | None = None,
        tasks: Sequence[Any] = (),
        limits: Sequence[Any] = (),
    ) -> Any:
        """Make the robot follow a motion.

        Args:
            motion: one ``[T, 22, 3]``, or several ``[S, T, 22, 3]``.
            fps: frames a second of the trajectory.
            scene: that the robot stays out of, y up; nothing is where there is none.
            tasks, limits: of mink, beside the robot's own.

        Returns:
            A `Trajectory`; a list of them for several motions.

        Raises:
            UserError: a motion without a valid frame or of other joints, or a rate that is not positive.
        """
        if not 1 <= fps <= 1000:
            raise UserError(f"{fps:g} frames a second are no rate for a robot; give 1 to 1000")
        if motion.joints.ndim == 4:
            return [self.retarget(motion[i], fps, scene, tasks, limits) for i in range(len(motion.joints))]
        rate = float(fps)
        wanted = targets(resampled(motion, rate), self.points)
        qpos = clear(lambda *avoid: solved(self, wanted, tasks, limits, *avoid), self, rate, scene, motion.t0)
        return Trajectory(self, qpos, rate, wanted.source, wanted.plants, motion.t0)
