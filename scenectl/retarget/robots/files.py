"""Trajectories of robots in files: CSV and NPZ, as they are or in the layouts of others.

Layouts by ending, each written for what reads it:

- ``.csv`` `named`: a row a frame: time, free joint, joints, named in a header with their units. `lafan1`: no header,
  the free joint with its quaternion as x y z w, and joints, as Unitree's LAFAN1 retargeting data set has them and
  BeyondMimic's and mjlab's ``csv_to_npz`` read them.
- ``.npz`` `named`: ``qpos [T, nq]``, ``fps``, ``t0``, ``joint_names``, ``root`` (the body that the free joint moves).
  `gmr`: the keys of General Motion Retargeting (``root_rot`` x y z w; GMR itself pickles them). `mjlab`: joints and
  bodies with their velocities, as mjlab's and BeyondMimic's motion commands load them. `isaaclab`: the same for
  Isaac Lab's AMP motion loader.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from scenectl.retarget.robots.reading import borrowed
from scenectl.retarget.robots.trajectory import Trajectory
from scenes.errors import UserError, did_you_mean
from scenes.files import atomic_write

LAYOUTS = {".csv": ("named", "lafan1"), ".npz": ("named", "gmr", "mjlab", "isaaclab")}
_FREE = ("x (m)", "y (m)", "z (m)", "qw", "qx", "qy", "qz")
_XYZW = [0, 1, 2, 4, 5, 6, 3]


def check(path: Path, layout: str = "named") -> None:
    """Raise UserError for an ending or a layout that is not written."""
    if path.suffix.lower() not in LAYOUTS:
        raise UserError(f"'{path}' ends with '{path.suffix}'; trajectories are written as {' or '.join(LAYOUTS)}")
    known = LAYOUTS[path.suffix.lower()]
    if layout not in known:
        raise UserError(f"{path.suffix} files have no layout '{layout}'{did_you_mean(layout, known)}")


def write(trajectory: Trajectory, path: str | Path, layout: str = "named") -> None:
    """Write a trajectory, whole or not at all; raises UserError for what `check` does and paths that can't be."""
    path = Path(path)
    check(path, layout)
    if path.suffix.lower() == ".csv":
        _write_csv(trajectory, path, layout)
        return
    arrays = {"named": _named, "gmr": _gmr, "mjlab": _mjlab, "isaaclab": _isaaclab}[layout](trajectory)
    with atomic_write(path) as file:
        np.savez_compressed(file, **arrays)


def _write_csv(trajectory: Trajectory, path: Path, layout: str) -> None:
    qpos, names, header = trajectory.qpos, trajectory.robot.names, ""
    if layout == "lafan1":
        rows = np.concatenate([qpos[:, _XYZW], qpos[:, 7:]], axis=1)
    else:
        units = ["m" if slides else "rad" for slides in trajectory.robot.slides]
        joints = [f"{name} ({unit})" for name, unit in zip(names, units, strict=True)]
        header = ",".join(["time (s)", *(f"root {name}" for name in _FREE), *joints])
        rows = np.concatenate([trajectory.times[:, None], qpos], axis=1)
    with atomic_write(path, "w") as file:
        np.savetxt(file, rows, "%.8f", delimiter=",", header=header, comments="")


def _named(trajectory: Trajectory) -> dict[str, Any]:
    return {
        "qpos": trajectory.qpos,
        "fps": np.float64(trajectory.fps),
        "t0": np.float64(trajectory.t0),
        "joint_names": np.array(trajectory.robot.names),
        "root": np.array(trajectory.robot.root),
    }


def _gmr(trajectory: Trajectory) -> dict[str, Any]:
    names, places, _ = _bodies(trajectory)
    root = trajectory.qpos[:, :3]
    turn = Rotation.from_quat(trajectory.qpos[:, 3:7], scalar_first=True).as_matrix()
    return {
        "fps": np.float64(trajectory.fps),
        "root_pos": root,
        "root_rot": trajectory.qpos[:, [4, 5, 6, 3]],
        "dof_pos": trajectory.qpos[:, 7:],
        "local_body_pos": (places - root[:, None]) @ turn,
        "link_body_list": names,
        "dof_names": np.array(trajectory.robot.names),
    }


def _mjlab(trajectory: Trajectory) -> dict[str, Any]:
    moved = _moved(trajectory)
    keys = ("joint_pos", "joint_vel", "body_pos_w", "body_quat_w", "body_lin_vel_w", "body_ang_vel_w")
    return {"fps": np.array([trajectory.fps]), **dict(zip(keys, moved[2:], strict=True))}


def _isaaclab(trajectory: Trajectory) -> dict[str, Any]:
    keys = (
        "dof_names", "body_names", "dof_positions", "dof_velocities", "body_positions", "body_rotations",
        "body_linear_velocities", "body_angular_velocities",
    )  # fmt: skip
    return {"fps": np.int64(round(trajectory.fps)), **dict(zip(keys, _moved(trajectory), strict=True))}


def _moved(trajectory: Trajectory) -> tuple[np.ndarray, ...]:
    """Names of joints and bodies, joints and their speeds, bodies' places, quaternions w x y z, and velocities."""
    names, places, turns = _bodies(trajectory)
    joints, fps = trajectory.qpos[:, 7:], trajectory.fps
    numbers = (joints, _rates(joints, fps), places, turns, _rates(places, fps), _spins(turns, fps))
    return (np.array(trajectory.robot.names), names, *(array.astype(np.float32) for array in numbers))


def _bodies(trajectory: Trajectory) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Names of all bodies but the world, places ``[T, B, 3]`` and quaternions w x y z ``[T, B, 4]``."""
    mujoco, model = borrowed("mujoco"), trajectory.robot.model
    data = mujoco.MjData(model)
    places, turns = np.empty((trajectory.frames, model.nbody, 3)), np.empty((trajectory.frames, model.nbody, 4))
    for frame, qpos in enumerate(trajectory.qpos):
        data.qpos[:] = qpos
        mujoco.mj_kinematics(model, data)
        places[frame], turns[frame] = data.xpos, data.xquat
    return np.array(trajectory.robot.tree.names[1:]), places[:, 1:], turns[:, 1:]


def _rates(values: np.ndarray, fps: float) -> np.ndarray:
    return np.gradient(values, axis=0) * fps if len(values) > 1 else np.zeros_like(values)


def _spins(turns: np.ndarray, fps: float) -> np.ndarray:
    """Angular velocities (rad/s, world) of quaternions ``[T, B, 4]``, as `np.gradient` takes differences."""
    frames, bodies = turns.shape[:2]
    after, before = np.minimum(np.arange(frames) + 1, frames - 1), np.maximum(np.arange(frames) - 1, 0)
    ends = [Rotation.from_quat(turns[at].reshape(-1, 4), scalar_first=True) for at in (after, before)]
    by = (ends[0] * ends[1].inv()).as_rotvec().reshape(frames, bodies, 3)
    spins: np.ndarray = by * fps / np.maximum(after - before, 1)[:, None, None]
    return spins
