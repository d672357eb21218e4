"""The task of mink that makes a robot follow its targets: all of them at once, which saves most of the time."""

from __future__ import annotations

from typing import Any

import mink
import mujoco
import numpy as np
from jaxtyping import Float

from scenectl.retarget.robots.humanoid import Humanoid
from scenectl.retarget.robots.rows import EASE, STEADY, Rows


class Follow(mink.tasks.BaseTask):  # type: ignore[misc]
    """Points and bodies of one frame's targets, and joints that stay near their rest and the frame before."""

    def __init__(self, robot: Humanoid, rows: Rows, fps: float) -> None:
        self.rows, self.nv, self.fps = rows, robot.model.nv, fps
        self.on = [body for body, _ in rows.points]
        self.where = np.array([where for _, where in rows.points])
        self.toward(np.clip(robot.model.qpos0[7:], *robot.bounds)[None].repeat(len(rows.places), axis=0), EASE)

    def toward(self, joints: Float[np.ndarray, "T n"], cost: float) -> None:
        """Stay near a pose at every frame, at so much a radian."""
        self.pose, self.ease = joints, cost
        kept = self.nv - 6
        self.jacobian = np.zeros((3 * (len(self.on) + len(self.rows.bodies)) + 2 * kept, self.nv))
        self.jacobian[-2 * kept :, 6:] = np.concatenate([cost * np.eye(kept), STEADY * np.eye(kept)])

    def at(self, frame: int, before: Float[np.ndarray, " Q"]) -> None:
        """Follow a frame, from the pose of the frame before."""
        self.frame, self.before = frame, before[7:].copy()
        self.steady = STEADY if frame else 0.0

    def compute_qp_residual(self, configuration: Any) -> tuple[np.ndarray, np.ndarray, float]:
        """What a step should change, by rows, and how joints change it, both times the costs."""
        model, data, rows, frame = configuration.model, configuration.data, self.rows, self.frame
        turned = data.xmat.reshape(-1, 3, 3)
        places = data.xpos[self.on] + (turned[self.on] @ self.where[:, :, None])[:, :, 0]
        count = 3 * (len(self.on) + len(rows.bodies))
        jacobian = self.jacobian
        for i, (body, place) in enumerate(zip(self.on, places, strict=True)):
            mujoco.mj_jac(model, data, jacobian[3 * i : 3 * i + 3], None, place, body)
        for i, body in enumerate(rows.bodies, len(self.on)):
            mujoco.mj_jacBody(model, data, None, jacobian[3 * i : 3 * i + 3], body)
        off = rotvecs(rows.turns[frame] @ turned[rows.bodies].transpose(0, 2, 1))
        costs = rows.costs[frame]
        jacobian[:count] *= costs[:, None]
        change = np.concatenate([(rows.places[frame] - places).ravel(), off.ravel()]) * costs
        joints = data.qpos[7:]
        change = np.concatenate([change, self.ease * (self.pose[frame] - joints), self.steady * (self.before - joints)])
        return jacobian, change, 0.0

    def compute_qp_objective(self, configuration: Any) -> Any:
        """The same as a quadratic."""
        jacobian, change, _ = self.compute_qp_residual(configuration)
        return mink.Objective(jacobian.T @ jacobian, -change @ jacobian)


def rotvecs(turns: Float[np.ndarray, "n 3 3"]) -> Float[np.ndarray, "n 3"]:
    """Rotations as vectors along their axes, as long as their angles."""
    skew = np.stack(
        [turns[:, 2, 1] - turns[:, 1, 2], turns[:, 0, 2] - turns[:, 2, 0], turns[:, 1, 0] - turns[:, 0, 1]], 1
    )
    sine = np.linalg.norm(skew, axis=1) / 2
    angle = np.arctan2(sine, (np.trace(turns, axis1=1, axis2=2) - 1) / 2)
    vectors: np.ndarray = skew * (angle / np.maximum(2 * sine, 1e-9))[:, None]
    return vectors
