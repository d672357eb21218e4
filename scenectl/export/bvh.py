"""BVH files out: one joint for each of a preset's, against a T-pose, in centimetres by default.

pybvh writes them: angles, in the order z, x, y, are ours; numbers have six decimals, and the frame time ten digits. Of
1,200 frames that took 0.2 s and was off by 0.03 micrometres. With bvhio it took 1.1 s and was off by 120: it computes
in single precision, makes each angle from a quaternion by itself, which lets it jump by a turn, and writes numbers as
1e-07. It reads these files in the tests.

A joint other than the root has no place of its own in a file of pybvh's: a root that carries the pelvis
(`Animation.hips`) rises and sinks with it here, and walks where the pelvis does.
"""

from __future__ import annotations

import shutil
import tempfile
import warnings
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from jaxtyping import Float
from pybvh import Bvh
from pybvh.bvhnode import BvhEndSite, BvhJoint, BvhNode, BvhRoot
from scipy.spatial.transform import Rotation

from scenectl.data.formats.people import UNITS
from scenectl.export.animation import Animation
from scenectl.export.settings import Settings
from scenes.files import atomic_write, writing
from scenes.motion.skeleton import Skeleton, tree_order

SEVERAL = False
TAKES = frozenset({"up", "unit"})
ORDER = "ZXY"
"""Channels of a rotation: R = Rz Rx Ry."""


def write(animations: Sequence[Animation], path: Path, settings: Settings) -> None:
    """Write one animation; raises UserError for a path that cannot be written."""
    (animation,) = animations
    animation = animation.turned(settings.up or "y")
    metres = UNITS[settings.unit or "cm"]
    order = tree_order(animation.skeleton.parents)
    nodes, angles = _nodes(animation.skeleton, order, metres), _angles(animation.rotations[:, order])
    file = Bvh(nodes, _roots(animation) / metres, angles, 1 / animation.fps, f"+{settings.up or 'y'}")
    with writing(path), tempfile.TemporaryDirectory() as folder:  # pybvh writes to a path only
        file.write(made := Path(folder) / "motion.bvh")
        with atomic_write(path) as out, made.open("rb") as whole:
            shutil.copyfileobj(whole, out)


def _roots(animation: Animation) -> Float[np.ndarray, "T 3"]:
    """Places of the root (m), which carries the pelvis in its offset."""
    if animation.hips is None:
        return animation.roots
    turn = Rotation.from_quat(animation.rotations[:, 0], scalar_first=True)
    places: np.ndarray = animation.roots + turn.apply(animation.hips - animation.skeleton.offsets[1])
    return places


def _angles(rotations: Float[np.ndarray, "T J 4"]) -> Float[np.ndarray, "T J 3"]:
    """Angles z, x, y in radians; of the ways to write a rotation, the one nearest to the frame before's."""
    turns = Rotation.from_quat(rotations.reshape(-1, 4), scalar_first=True)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # where z and y turn about one axis, all of it is given to z
        angles = turns.as_euler(ORDER).reshape(*rotations.shape[:-1], 3)
    ways = np.stack([angles, angles * [1, -1, 1] + np.pi])
    last = np.zeros_like(angles[0])
    for frame in range(len(angles)):
        near = ways[:, frame] + 2 * np.pi * np.round((last - ways[:, frame]) / (2 * np.pi))
        first = np.abs(near[0] - last).max(-1) <= np.abs(near[1] - last).max(-1)
        angles[frame] = last = np.where(first[:, None], *near)
    return angles


def _nodes(skeleton: Skeleton, order: Sequence[int], metres: float) -> list[BvhNode]:
    """The tree, depth first, in units of so many metres; bones that end in no joint are half as long as their parents.

    A file gives them a length, as tools draw a bone by where it ends.
    """
    made: dict[int, BvhJoint] = {}
    nodes: list[BvhNode] = []
    for joint in order:
        name, parent = skeleton.names[joint], skeleton.parents[joint]
        offset = np.array(skeleton.offsets[joint]) / metres + 0.0
        made[joint] = (
            BvhRoot(name, offset, "XYZ", ORDER) if parent < 0 else BvhJoint(name, offset, ORDER, [], made[parent])
        )
        nodes.append(made[joint])
        if parent >= 0:
            made[parent].children += [made[joint]]
        if joint not in skeleton.parents:
            end = BvhEndSite(f"{name}.end", offset / 2, made[joint])
            made[joint].children += [end]
            nodes.append(end)
    return nodes
