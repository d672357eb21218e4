"""What forces a trajectory takes: inverse dynamics, and what of it the feet on the ground give."""

from __future__ import annotations

import copy
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from jaxtyping import Float

from scenectl.retarget.robots.humanoid import Humanoid
from scenectl.retarget.robots.standing import Standing
from scenectl.retarget.robots.trajectory import Trajectory
from scenes.errors import UserError, did_you_mean, shown
from scenes.numbers import is_number

CUTOFF = 6.0
"""Hertz above which motion is taken for noise before it is differentiated twice: Winter, Biomechanics and Motor Control
of Human Movement, for walking people."""
_SMALL = 1e-3
"""Cost of a force at a point beside one of the same size that nothing gives: it spreads forces evenly."""


@dataclass(frozen=True, eq=False)
class Dynamics:
    """Forces of a trajectory, moving as it does and standing still in each of its poses.

    The free joint has no motor: what it needs is a wrench that the ground has to give. It is given by forces at the
    points of the soles that touch, within friction pyramids, the smallest such forces by nonnegative least squares
    (contact wrenches as nonnegative sums of the edges of pyramids at the vertices: Caron, Pham and Nakamura, Stability
    of Surface Contacts for Humanoid Robots, ICRA 2015). The motors' torques are what inverse dynamics asks less what
    these forces give.

    Attributes:
        torques: of the joints, N m (N of slides), ``[T, n]``.
        still: the same of a robot that holds each pose, ``[T, n]``.
        missing: forces (N) and moments (N m) on the root that no foot gives, world, ``[T, 6]``.
        mass_centre: metres, world, ``[T, 3]``.
        zmp: the zero-moment point on the height of the soles that touch, ``[T, 2]``; NaN where nothing presses down.
        weight: newtons.
    """

    torques: Float[np.ndarray, "T n"]
    still: Float[np.ndarray, "T n"]
    missing: Float[np.ndarray, "T 6"]
    mass_centre: Float[np.ndarray, "T 3"]
    zmp: Float[np.ndarray, "T 2"]
    weight: float


def half_speeds(trajectory: Trajectory) -> Float[np.ndarray, "U V"]:
    """Speeds (m/s, rad/s) from each frame to the next, ``[T - 1, nv]``, as MuJoCo's `qvel`."""
    import mujoco

    model, found = trajectory.robot.model, np.zeros((max(trajectory.frames - 1, 0), trajectory.robot.model.nv))
    for frame in range(len(found)):
        mujoco.mj_differentiatePos(model, found[frame], 1 / trajectory.fps, *trajectory.qpos[frame : frame + 2])
    return found


def motion_of(trajectory: Trajectory) -> tuple[Float[np.ndarray, "T V"], Float[np.ndarray, "T V"]]:
    """Speeds and accelerations at the frames, smoothed; the first and the last frame don't accelerate."""
    steps = _smooth(half_speeds(trajectory), trajectory.fps)
    ends = np.concatenate([steps[:1], steps, steps[-1:]]) if len(steps) else np.zeros((2, trajectory.robot.model.nv))
    return (ends[1:] + ends[:-1]) / 2, (ends[1:] - ends[:-1]) * trajectory.fps


def _smooth(speeds: Float[np.ndarray, "U V"], fps: float) -> Float[np.ndarray, "U V"]:
    from scipy.signal import butter, sosfiltfilt

    if fps <= 2.5 * CUTOFF or len(speeds) < 8:
        return speeds
    filtered: np.ndarray = sosfiltfilt(
        butter(2, CUTOFF, fs=fps, output="sos"), speeds, axis=0, padtype="odd", padlen=min(int(fps), len(speeds) - 1)
    )
    return filtered


def dynamics(trajectory: Trajectory, standing: Standing) -> Dynamics:
    """Inverse dynamics of a trajectory that stands as `standing` says; springs and dampers of the file count."""
    speeds, accelerations = motion_of(trajectory)
    frames, still = _Frames(trajectory.robot), np.zeros(trajectory.robot.model.nv)
    count, joints = trajectory.frames, trajectory.robot.model.nv - 6
    torques, held, missing = np.zeros((count, joints)), np.zeros((count, joints)), np.zeros((count, 6))
    centre, zmp = np.zeros((count, 3)), np.full((count, 2), np.nan)
    for frame in range(count):
        touching = standing.touching[frame]
        points, bodies = standing.points[frame, touching], standing.bodies[touching]
        held[frame], _ = frames.at(trajectory.qpos[frame], still, still).carried(points, bodies, standing.friction)
        now = frames.at(trajectory.qpos[frame], speeds[frame], accelerations[frame])
        torques[frame], missing[frame] = now.carried(points, bodies, standing.friction)
        centre[frame] = now.mass_centre
        zmp[frame] = now.zmp(float(points[:, 2].mean()) if len(points) else float(standing.points[frame, :, 2].min()))
    return Dynamics(torques, held, missing, centre, zmp, frames.weight)


class _Frames:
    """MuJoCo's inverse dynamics, frame by frame, without contacts and limits: these are the caller's."""

    def __init__(self, robot: Humanoid) -> None:
        import mujoco

        self.model: Any = copy.copy(robot.model)
        self.model.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_CONSTRAINT)
        self.data: Any = mujoco.MjData(self.model)
        self.root = int(self.model.jnt_bodyid[0])

    @cached_property
    def weight(self) -> float:
        """Newtons."""
        return float(self.model.body_subtreemass[self.root] * np.linalg.norm(self.model.opt.gravity))

    @property
    def mass_centre(self) -> Float[np.ndarray, "3"]:
        """Metres, world."""
        place: np.ndarray = self.data.subtree_com[self.root].copy()
        return place

    def at(
        self, qpos: Float[np.ndarray, " Q"], qvel: Float[np.ndarray, " V"], qacc: Float[np.ndarray, " V"]
    ) -> _Frames:
        """Solve one frame."""
        import mujoco

        self.data.qpos[:], self.data.qvel[:], self.data.qacc[:] = qpos, qvel, qacc
        mujoco.mj_inverse(self.model, self.data)
        return self

    def zmp(self, height: float) -> Float[np.ndarray, "2"]:
        """Where the ground's forces act without a horizontal moment, at a height (m); NaN where none presses down."""
        force = self.data.qfrc_inverse[:3]
        if force[2] < 1e-3 * self.weight:
            return np.full(2, np.nan)
        root = self.data.xpos[self.root]
        moment = self.data.xmat[self.root].reshape(3, 3) @ self.data.qfrc_inverse[3:6]
        moment = moment + np.cross([0.0, 0.0, root[2] - height], force)
        place: np.ndarray = root[:2] + np.array([-moment[1], moment[0]]) / force[2]
        return place

    def carried(
        self, points: Float[np.ndarray, "n 3"], bodies: np.ndarray, friction: float
    ) -> tuple[Float[np.ndarray, " j"], Float[np.ndarray, "6"]]:
        """Torques of the joints, and what is missing on the root, with forces at points that bodies press down."""
        import mujoco

        wanted, given = self.data.qfrc_inverse, np.zeros(self.model.nv)
        if len(points):
            edges = np.array([[friction, 0, 1], [-friction, 0, 1], [0, friction, 1], [0, -friction, 1]], dtype=float)
            ways = np.zeros((len(points), 3, self.model.nv))
            for way, point, body in zip(ways, points, bodies, strict=True):
                mujoco.mj_jac(self.model, self.data, way, None, point, int(body))
            columns = np.einsum("ek,nkv->nev", edges, ways).reshape(-1, self.model.nv)
            given = _nonnegative(columns[:, :6], wanted[:6]) @ columns
        rest = wanted - given
        turned = self.data.xmat[self.root].reshape(3, 3) @ rest[3:6]
        return rest[6:].copy(), np.concatenate([rest[:3], turned])


def _nonnegative(columns: Float[np.ndarray, "n 6"], wanted: Float[np.ndarray, "6"]) -> Float[np.ndarray, " n"]:
    """The nonnegative sizes with which columns come nearest to what is wanted, and small."""
    import qpsolvers

    product = columns @ columns.T + _SMALL**2 * np.eye(len(columns))
    found = qpsolvers.solve_problem(
        qpsolvers.Problem(product, -columns @ wanted, lb=np.zeros(len(columns))), solver="daqp"
    )
    return np.zeros(len(columns)) if found.x is None else np.maximum(found.x, 0.0)


def torques_of(robot: Humanoid, stated: Mapping[str, float | int]) -> Float[np.ndarray, " n"]:
    """Largest torques (N m, N of slides) of a robot's joints: stated, or else of its file; infinite where none is.

    Raises:
        UserError: one that is not positive, or of a joint that the robot lacks.
    """
    limits = torque_limits(robot.model)
    for joint, torque in stated.items():
        if joint not in robot.names:
            raise UserError(
                f"a torque is stated for '{joint}', no joint of '{robot.source}'{did_you_mean(joint, robot.names)}"
            )
        if not (is_number(torque) and torque > 0):
            raise UserError(f"the torque of '{joint}' is {shown(torque)}; give N m above 0")
        limits[robot.names.index(joint)] = torque
    return limits


def torque_limits(model: Any) -> Float[np.ndarray, " n"]:
    """Largest torques (N m, N of slides) of the joints but the free one; infinite where the file states none.

    They are those of the joint (`actuatorfrcrange`, URDF's effort), or else of its motors: their force's range, or the
    range of their control where that is the force, times the gear.
    """
    from mujoco import mjtBias, mjtGain, mjtTrn

    found = np.zeros(model.njnt)
    for motor in range(model.nu):
        if int(model.actuator_trntype[motor]) != int(mjtTrn.mjTRN_JOINT):
            continue
        most = np.inf
        if model.actuator_forcelimited[motor]:
            most = float(np.abs(model.actuator_forcerange[motor]).min())
        plain = int(model.actuator_gaintype[motor]) == int(mjtGain.mjGAIN_FIXED)
        if (
            plain
            and int(model.actuator_biastype[motor]) == int(mjtBias.mjBIAS_NONE)
            and model.actuator_ctrllimited[motor]
        ):
            gain = abs(float(model.actuator_gainprm[motor, 0]))
            most = min(most, gain * float(np.abs(model.actuator_ctrlrange[motor]).min()))
        found[model.actuator_trnid[motor, 0]] += most * abs(float(model.actuator_gear[motor, 0]))
    found[found == 0] = np.inf
    limited = model.jnt_actfrclimited.astype(bool)
    found[limited] = np.minimum(found[limited], np.abs(model.jnt_actfrcrange[limited]).min(axis=1))
    return found[1:]
