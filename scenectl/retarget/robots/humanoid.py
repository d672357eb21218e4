"""A humanoid robot from its own file, and which of its bodies move as which of our joints."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Bool, Float

from scenectl.retarget.robots.mapping import ARM, LEG, SIDES, Tree
from scenectl.retarget.robots.points import Points, points_of
from scenectl.retarget.robots.reading import borrowed, read
from scenectl.retarget.robots.upright import upright

SPEED = 3 * math.pi
"""Radians a second (metres of slides) where a file states no speed, as MJCF never does: GMR's default for all motors
(general_motion_retargeting/motion_retarget.py). What Unitree states for the motors of its G1, 20 to 37, is more."""
MARGIN = 0.005
"""Radians (or metres) that joints stay away from the ends of their ranges, so that rounding in files exceeds none."""
_BENT = 0.1
"""Radians that knees and elbows stay bent. Straight limbs cannot say which way to bend, and knees snap: so little costs
a leg a thousandth of its length."""
_EITHER = 0.5
"""Radians on both sides of straight from which a range does not say which way a limb bends."""
_ANGLES = 181
"""At which a limb's length is looked at, 2 degrees apart."""


class Humanoid:
    """A humanoid robot, and what is known of it; `Robot` moves it.

    Attributes:
        name, source: the file's stem and the file.
        model: MuJoCo's, with a free joint at the root, which comes first, and hinges and slides.
        joints: {one of our 22 joints: the body of the model that moves as it does}.
        names: of its joints but the free one, in the model's order, ``[n]``.
        ranges: of these, rad or m, infinite where they are free, ``[n, 2]``.
        speeds: largest of these, rad/s or m/s, ``[n]``.
        stated: whether the file states each of those speeds, ``[n]``.
        doubts: what whoever gave the file should hear about how it was read, one sentence each.
    """

    def __init__(self, file: str | Path, joints: Mapping[str, str] | None = None, speed: float | int = SPEED) -> None:
        """Read an MJCF or a URDF.

        Args:
            file: with the root <mujoco> or <robot>.
            joints: {our joint: body} for what names and geometry get wrong.
            speed: of joints (rad/s, or m/s of slides) for which the file states none.

        Raises:
            UserError: no such file, no robot that MuJoCo reads, no humanoid, a body in `joints` that is not there, or
                the extra `robots` is missing.
        """
        found = read(file)
        self.name, self.source, self.model = Path(file).stem, str(file), found.model
        self.names = tuple(self.model.joint(i).name for i in range(1, self.model.njnt))
        limited = self.model.jnt_limited[1:, None].astype(bool)
        self.ranges: Float[np.ndarray, "n 2"] = np.where(limited, self.model.jnt_range[1:], [[-np.inf, np.inf]])
        self.stated = np.array([name in found.speeds for name in self.names], bool)
        self.speeds: Float[np.ndarray, " n"] = np.array([found.speeds.get(name, speed) for name in self.names])
        self.model.qpos0[3:7], self.joints, doubts = upright(self.model, self.source, joints or {})
        self.doubts = (*found.doubts, *doubts, *self.points.doubts, *self._tied())

    def _tied(self) -> Iterator[str]:
        """What the file ties together and trajectories do not: loops of bodies, joints of limbs that follow others."""
        model, names = self.model, self.tree.names
        limbs = {joint for body in self.joints.values() for joint in self.tree.between(0, names.index(body))}
        tied = model.eq_type == int(borrowed("mujoco").mjtEq.mjEQ_JOINT)
        ties = [
            i for i in range(model.neq) if not tied[i] or {int(model.eq_obj1id[i]), int(model.eq_obj2id[i])} & limbs
        ]
        if ties:
            yield f"its file ties joints or bodies together ({len(ties)} equalities); trajectories do not keep them"

    @property
    def slides(self) -> Bool[np.ndarray, " n"]:
        """Which of its joints slide, and don't turn."""
        slides: np.ndarray = self.model.jnt_type[1:] == borrowed("mujoco").mjtJoint.mjJNT_SLIDE
        return slides

    @property
    def root(self) -> str:
        """The body that the free joint moves."""
        name: str = self.model.body(self.model.jnt_bodyid[0]).name
        return name

    @cached_property
    def bounds(self) -> Float[np.ndarray, "2 n"]:
        """Lowest and highest that joints are moved to, ``[2, n]``.

        Their ranges, `MARGIN` away from either end; and knees and elbows are never quite straight nor bent backwards.
        """
        low, high = self.ranges.T
        margin = np.minimum(MARGIN, (high - low) / 4)
        low, high = low + margin, high - margin
        for joint, straight, way in self._hinges():
            least, most = straight + _BENT, straight - _BENT
            up, down = high[joint] - straight, straight - low[joint]
            if way > 0 if min(up, down) > _EITHER else up > down:
                low[joint] = min(max(low[joint], least), high[joint])
            else:
                high[joint] = max(min(high[joint], most), low[joint])
        return np.stack([low, high])

    def _hinges(self) -> Iterator[tuple[int, float, float]]:
        """Knees and elbows, counted without the free joint; the angle (rad) at which each limb is straight; its sense.

        The sense in which it bends as people's do is that in which a knee takes the ankle back, at rest. What an
        elbow takes the wrist to says less; where its range allows both, it is the sense of the longer part.
        """
        for start, hinge, end in ((f"{side}_{part}" for part in limb) for limb in (LEG, ARM) for side in SIDES):
            top, body = (self.tree.names.index(self.joints[name]) for name in (start, hinge))
            best, found = 1e-6, None
            for joint in self.tree.between(top, body):
                low, high = self.ranges[joint - 1]
                angles = np.linspace(max(low, -math.pi) - 0.5, min(high, math.pi) + 0.5, _ANGLES)
                ways = self._ways(joint, angles, start, end)
                far = np.linalg.norm(ways, axis=1)
                if far.max() - far.min() > best:
                    at = int(far.argmax())
                    beside = (ways[min(at + 1, _ANGLES - 1)] - ways[max(at - 1, 0)]) @ self.points.turn[2]
                    sense = -beside if end.endswith("ankle") else angles[-1] + angles[0] - 2 * angles[at]
                    best, found = far.max() - far.min(), (joint - 1, float(angles[at]), float(sense))
            if found is not None:
                yield found

    def _ways(self, joint: int, angles: Float[np.ndarray, " k"], start: str, end: str) -> Float[np.ndarray, "k 3"]:
        """From one of our joints to another (m, world) at angles (rad) of a joint, all else at rest."""
        mujoco = borrowed("mujoco")
        data, found = mujoco.MjData(self.model), []
        for angle in angles:
            data.qpos[6 + joint] = angle
            mujoco.mj_kinematics(self.model, data)
            a, b = (
                data.xpos[on] + data.xmat[on].reshape(3, 3) @ at
                for on, at in (self.points.bodies[start], self.points.bodies[end])
            )
            found.append(b - a)
        return np.stack(found)

    @cached_property
    def rest(self) -> Any:
        """MuJoCo's data of the pose in which the file has it, stood up (`upright`); not to be changed."""
        mujoco = borrowed("mujoco")
        data = mujoco.MjData(self.model)
        mujoco.mj_kinematics(self.model, data)
        mujoco.mj_comPos(self.model, data)
        return data

    @cached_property
    def tree(self) -> Tree:
        """Its bodies at rest."""
        return Tree(self.model, self.rest)

    @cached_property
    def points(self) -> Points:
        """Where our joints are on its bodies."""
        return points_of(self.tree, self.joints, self.source)
