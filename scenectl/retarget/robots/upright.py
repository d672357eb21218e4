"""How a robot stands: files keep robots on their backs, too, or with another axis up than z."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np
from jaxtyping import Float
from scipy.spatial.transform import Rotation

from scenectl.retarget.robots.mapping import SIDES, Tree, mapped
from scenectl.retarget.robots.reading import borrowed
from scenes.errors import UserError

_LEANS = np.cos(np.radians(45))
"""Cosine of the lean of a trunk from which another axis is nearer to it than the one that is up."""


def upright(
    model: Any, source: str, stated: Mapping[str, str]
) -> tuple[Float[np.ndarray, "4"], dict[str, str], list[str]]:
    """The free joint's quaternion (w x y z) with which a robot stands, all else at rest; and `mapped`'s findings.

    It is the file's where the shoulders are over the hips in that; else the root is turned so that one of its axes is
    up, the one along which they are.

    Raises:
        UserError: as `mapped`.
    """
    faults = list[UserError]()
    for up, quat in _turned(model):
        tree = _tree(model, quat)
        try:
            joints, doubts = mapped(tree, source, stated)
        except UserError as fault:
            faults.append(fault)
            continue
        trunk = _middle(tree, joints, "shoulder") - _middle(tree, joints, "hip")
        if trunk[2] >= _LEANS * np.linalg.norm(trunk):
            told = [f"the robot does not stand in its file; it was stood up, {up} of its root up"] if up else []
            return quat, joints, [*doubts, *told]
    raise faults[0] if faults else UserError(f"'{source}' is no humanoid: its shoulders are not over its hips")


def _middle(tree: Tree, joints: Mapping[str, str], part: str) -> Float[np.ndarray, "3"]:
    """Between the last hinges of both hips or shoulders."""
    ends = [tree.between(0, tree.names.index(joints[f"{side}_{part}"]))[-1] for side in SIDES]
    middle: np.ndarray = tree.anchors[ends].mean(axis=0)
    return middle


def _turned(model: Any) -> Iterator[tuple[str, Float[np.ndarray, "4"]]]:
    """The root as the file has it, and with each of its axes up, turned no more than that takes."""
    quat: np.ndarray = model.qpos0[3:7].copy()
    yield "", quat
    root = Rotation.from_quat(quat, scalar_first=True)
    for axis in (2, 1, 0):
        for sign in (1, -1):
            way = sign * root.as_matrix()[:, axis]
            if way[2] < 0.999:
                turn = Rotation.align_vectors([[0.0, 0.0, 1.0]], [way])[0]
                yield f"{'-' * (sign < 0)}{'xyz'[axis]}", (turn * root).as_quat(canonical=True, scalar_first=True)


def _tree(model: Any, quat: Float[np.ndarray, "4"]) -> Tree:
    """The robot at rest, its root turned."""
    mujoco = borrowed("mujoco")
    data = mujoco.MjData(model)
    data.qpos[3:7] = quat
    mujoco.mj_kinematics(model, data)
    mujoco.mj_comPos(model, data)
    return Tree(model, data)
