"""Inverse kinematics: a robot's free joint and joints, frame by frame, so that it follows its targets.

Each frame is a few steps of Gauss and Newton, quadratic programs that mink builds and DAQP solves, from where the frame
before ended or the pass before had it. Ranges and speeds of joints bound every step: a frame lies within what the one
before can reach.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from jaxtyping import Float
from scipy.ndimage import gaussian_filter1d
from scipy.spatial.transform import Rotation

from scenectl.retarget.robots.humanoid import Humanoid
from scenectl.retarget.robots.reading import borrowed
from scenectl.retarget.robots.rows import SMOOTH, rows_of
from scenectl.retarget.robots.targets import Targets

FIRST, STEPS, ENOUGH = 60, 4, 2e-3
"""Steps for the first frame and for each other, and radians or metres of a step after which no more are made."""
WIDTH = 0.05
"""Seconds: width of the Gaussian that smooths joints between the passes."""
NEAR = 0.999
"""Share of speeds that is used, so that numbers rounded in files exceed none."""


def solved(
    robot: Humanoid,
    targets: Targets,
    tasks: Sequence[Any] = (),
    limits: Sequence[Any] = (),
    avoid: Sequence[Any] = (),
    known: Float[np.ndarray, "T Q"] | None = None,
) -> Float[np.ndarray, "T Q"]:
    """The robot's qpos over time.

    Args:
        robot: whose.
        targets: what it follows.
        tasks: of mink, beside the targets.
        limits: of mink, beside ranges and speeds of joints.
        avoid: of mink, both tasks and limits, told each frame by `at(frame)`.
        known: qpos that is near, instead of a first pass.
    """
    mink = borrowed("mink")
    from scenectl.retarget.robots.follow import Follow

    follow = Follow(robot, rows_of(robot, targets), targets.source.fps)
    configuration = mink.Configuration(robot.model, _start(robot, targets))
    every, bounds = [follow, *tasks, *avoid], [*limits, *avoid]
    if known is None:
        known = _pass(robot, configuration, follow, every, bounds, avoid)
    smooth = gaussian_filter1d(known[:, 7:], WIDTH * follow.fps, axis=0, mode="nearest")
    follow.toward(smooth, SMOOTH)
    configuration.update(known[0])
    return _pass(robot, configuration, follow, every, bounds, avoid, known)


def _pass(
    robot: Humanoid,
    configuration: Any,
    follow: Any,
    tasks: Sequence[Any],
    limits: Sequence[Any],
    avoid: Sequence[Any],
    known: Float[np.ndarray, "T Q"] | None = None,
) -> Float[np.ndarray, "T Q"]:
    """All frames, each from where it is known to be near, or else from where the one before ended."""
    mink, qpsolvers, mujoco = borrowed("mink"), borrowed("qpsolvers"), borrowed("mujoco")
    model, dt, (low, high) = robot.model, 1 / follow.fps, robot.bounds
    reach = robot.speeds * NEAR * dt
    found = np.empty((len(follow.pose), model.nq))
    for frame in range(len(found)):
        before = configuration.q[7:].copy()
        least, most = (low, high) if frame == 0 else (np.maximum(low, before - reach), np.minimum(high, before + reach))
        follow.at(frame, configuration.q)
        if known is not None:
            configuration.update(np.concatenate([known[frame, :7], np.clip(known[frame, 7:], least, most)]))
        for one in avoid:
            one.at(frame)
        for _ in range(STEPS if frame else FIRST):
            problem = mink.build_ik(configuration, tasks, dt, 1e-9, limits)
            joints = configuration.data.qpos[7:]
            problem.lb = np.concatenate([_FREE[0], least - joints])
            problem.ub = np.concatenate([_FREE[1], most - joints])
            solution = qpsolvers.solve_problem(problem, "daqp")
            if not solution.found:
                break
            qpos = configuration.q.copy()
            mujoco.mj_integratePos(model, qpos, solution.x, 1.0)
            qpos[7:] = np.clip(qpos[7:], least, most)
            configuration.update(qpos)
            if np.abs(solution.x).max() < ENOUGH:
                break
        found[frame] = configuration.q
    return found


_FREE = np.full((2, 6), [[-1.0], [1.0]])
"""Metres and radians of a step of the free joint: what a linear model is good for."""


def _start(robot: Humanoid, targets: Targets) -> Float[np.ndarray, " Q"]:
    """The robot at rest where its hips begin, turned as they are."""
    points, rest, model = robot.points, robot.rest, robot.model
    qpos: np.ndarray = model.qpos0.copy()
    turn = targets.turns["pelvis"][0] @ points.turn
    root = model.body(robot.root).id
    body, where = points.bodies["pelvis"]
    hips = rest.xpos[body] + rest.xmat[body].reshape(3, 3) @ where
    qpos[:3] = targets.places["pelvis"][0] + turn @ (rest.xpos[root] - hips)
    qpos[3:7] = Rotation.from_matrix(turn @ rest.xmat[root].reshape(3, 3)).as_quat(canonical=True, scalar_first=True)
    qpos[7:] = np.clip(qpos[7:], *robot.bounds)
    return qpos
