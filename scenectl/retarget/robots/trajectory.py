"""What a robot is to do: its free joint and its joints over time."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from scenectl.retarget.plants import Plant
from scenectl.retarget.robots.humanoid import Humanoid
from scenectl.retarget.robots.mapping import SIDES
from scenectl.retarget.robots.points import WORLD
from scenectl.retarget.robots.reading import borrowed
from scenes.errors import UserError, did_you_mean
from scenes.motion.motion import Motion

FOLLOWED = tuple(f"{side}_{part}" for side in SIDES for part in ("ankle", "foot", "knee", "wrist", "elbow"))
"""Our joints that a robot is held against."""
_AT, _FULL = 1e-4, 0.99
"""Radians from an end, and share of a speed, at which a joint is held."""
_LISTED = 5


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

    def figures(self) -> Figures:
        """How near the robot comes to what it follows, and what keeps it away."""
        names = [name for name in FOLLOWED if name in self.robot.points.bodies]
        places = dict(zip(names, np.moveaxis(self.joints(names), 1, 0), strict=True))
        wanted = {name: self.source.joint(name).numpy() @ WORLD.T for name in names}
        off = {name: np.linalg.norm(places[name] - wanted[name], axis=1) for name in names}
        slides = [0.0]
        for plant in self.plants:
            path = places[plant.joint][plant.begin : plant.end, :2]
            slides.append(float(np.linalg.norm(path - path.mean(axis=0), axis=1).max()))
        joints, (low, high) = self.qpos[:, 7:], self.robot.bounds
        used = np.abs(np.diff(joints, axis=0)) * self.fps / self.robot.speeds
        beyond = np.maximum(self.robot.ranges[:, 0] - joints, joints - self.robot.ranges[:, 1])
        ends = (joints <= low + _AT) | (joints >= high - _AT)
        ends[1:] |= used >= _FULL
        tree = self.robot.tree  # fingers, which nothing moves, rest at their ends
        ours = {joint for body in self.robot.joints.values() for joint in tree.between(0, tree.names.index(body))}
        shares = {name: float(ends[:, i].mean()) for i, name in enumerate(self.robot.names) if i + 1 in ours}
        return Figures(
            {name: (float(np.median(far)), float(np.quantile(far, 0.95))) for name, far in off.items()},
            max(slides),
            float(used.max(initial=0.0)),
            float(beyond.max(initial=-np.inf)),
            {name: share for name, share in sorted(shares.items(), key=lambda one: -one[1])[:_LISTED] if share > 0},
        )


@dataclass(frozen=True)
class Figures:
    """How well a robot follows.

    Attributes:
        off: {our joint: metres from what it follows, in the median and the 95th percentile}.
        slide: how far (m) a standing foot is at most from where it stands in the mean.
        speed: largest share of a joint's speed that is used.
        beyond: how far (rad or m) joints are beyond their ranges; negative within all.
        limited: {joint: share of frames in which it is at an end of its range or at its speed}, the most of it first.
    """

    off: dict[str, tuple[float, float]]
    slide: float
    speed: float
    beyond: float
    limited: dict[str, float]
