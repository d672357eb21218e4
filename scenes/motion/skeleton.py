"""Skeletons: named joints in a tree, with their offsets at rest, which for people is a T-pose."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from scenes.errors import UserError, clipped, did_you_mean

FEET = ("left_foot", "right_foot")
"""Joints at the balls of the feet, by which people stand."""
HIP, COLLAR = 0.82, 0.5
"""Sines of the angles between the vertical and the bones to hips and collars in the T-pose: 55 and 30 degrees."""
LONGEST_BONE = 10.0
"""Metres: beyond it, no person's."""


@dataclass(frozen=True)
class Skeleton:
    """A tree of joints.

    Attributes:
        names: joint names, the root first.
        parents: index of each joint's parent, -1 for the root, which comes first; parents precede children.
        offsets: offset of each joint from its parent in the rest pose (for people a T-pose), metres, y up, facing +z.
    """

    names: tuple[str, ...]
    parents: tuple[int, ...]
    offsets: tuple[tuple[float, float, float], ...]

    def __post_init__(self) -> None:
        count = len(self.names)
        if not count or len(self.parents) != count or len(self.offsets) != count:
            raise UserError(
                f"a skeleton has {count} names, {len(self.parents)} parents, {len(self.offsets)} offsets; give as many"
            )
        if len(set(self.names)) < count or not all(self.names):
            raise UserError("joints of a skeleton lack names, or share one; give each its own")
        if self.parents[0] != -1 or not all(0 <= parent < j for j, parent in enumerate(self.parents) if j):
            raise UserError(
                "parents of joints are their indices, -1 for the first joint, and come before their children"
            )
        if not np.isfinite(self.offsets).all() or np.abs(self.offsets).max() > LONGEST_BONE:
            raise UserError(f"offsets of joints are finite, and at most {LONGEST_BONE:g} m")

    @cached_property
    def _index(self) -> dict[str, int]:
        return {name: i for i, name in enumerate(self.names)}

    def index(self, name: str) -> int:
        """Index of the joint called `name`; raises UserError naming the nearest known joint."""
        if name not in self._index:
            raise UserError(f"unknown joint '{clipped(name)}'{did_you_mean(name, self.names)}")
        return self._index[name]

    def indices(self, names: list[str] | tuple[str, ...]) -> list[int]:
        """Indices of several joints, in the order given."""
        return [self.index(name) for name in names]

    @cached_property
    def bones(self) -> tuple[tuple[int, int], ...]:
        """(parent, child) of every bone."""
        return tuple((p, j) for j, p in enumerate(self.parents) if p >= 0)

    @cached_property
    def bone_lengths(self) -> np.ndarray:
        """Length in metres of the bone that ends in each joint, ``[J]``; 0 for the root."""
        lengths: np.ndarray = np.linalg.norm(np.asarray(self.offsets, dtype=np.float64), axis=-1)
        return lengths

    @cached_property
    def legs(self) -> float:
        """Height (m) of the root over the feet in the T-pose: steps, speeds and heights of a body are in proportion."""
        down = []
        for joint in self.indices(FEET):
            down.append(0.0)
            while joint >= 0:
                down[-1] -= self.offsets[joint][1]
                joint = self.parents[joint]
        return sum(down) / len(down)

    def scaled(self, by: float) -> Skeleton:
        """The same proportions, so many times as large."""
        return replace(self, offsets=tuple((by * x, by * y, by * z) for x, y, z in self.offsets))

    def span(self, a: str, b: str) -> float:
        """Largest distance (m) between two joints, with all bones between them stretched in a line."""
        ways: list[dict[int, float]] = []
        for joint in (self.index(a), self.index(b)):
            way, done = {joint: 0.0}, 0.0
            while self.parents[joint] >= 0:
                done += float(self.bone_lengths[joint])
                joint = self.parents[joint]
                way[joint] = done
            ways.append(way)
        return min(ways[0][joint] + ways[1][joint] for joint in ways[0].keys() & ways[1].keys())


def tree_order(parents: Sequence[int]) -> list[int]:
    """Indices so that parents precede children; raises ValueError where links go round in a ring."""
    children: dict[int, list[int]] = {}
    for link, parent in enumerate(parents):
        children.setdefault(parent, []).append(link)
    order, waiting = [], children.get(-1, [])[::-1]
    while waiting:
        order.append(waiting.pop())
        waiting += children.get(order[-1], [])[::-1]
    if len(order) < len(parents):
        raise ValueError("links are each other's parents")
    return order


def with_lengths(skeleton: Skeleton, lengths: np.ndarray) -> Skeleton:
    """The same skeleton with bones of other lengths (m), each given by the joint in which it ends, ``[J]``."""
    scale = np.asarray(lengths, np.float64) / np.maximum(skeleton.bone_lengths, 1e-9)
    scaled = np.asarray(skeleton.offsets) * scale[:, None]
    return replace(skeleton, offsets=tuple((x, y, z) for x, y, z in scaled.tolist()))


def _humanml3d() -> Skeleton:
    # Joints of SMPL without the hands. Lengths are those of HumanML3D's uniform skeleton, measured on its published
    # clip 012314 (every clip of that data set has them). Hips and collars lie between those of the collections that the
    # weights are trained on, whose skeletons differ (`scenectl bench skeletons`); soles are level.
    x, y = (1.0, 0.0, 0.0), (0.0, 1.0, 0.0)
    toe = (0.0, -0.33, 0.944)
    rows: list[tuple[str, int, tuple[float, float, float], float]] = [
        # name, parent, direction in the T-pose, length (m)
        ("pelvis", -1, y, 0.0),
        ("left_hip", 0, (HIP, -_along(HIP), 0.0), 0.103074),
        ("right_hip", 0, (-HIP, -_along(HIP), 0.0), 0.109883),
        ("spine1", 0, y, 0.131568),
        ("left_knee", 1, y, -0.393623),
        ("right_knee", 2, y, -0.390188),
        ("spine2", 3, y, 0.143190),
        ("left_ankle", 4, y, -0.432433),
        ("right_ankle", 5, y, -0.425643),
        ("spine3", 6, y, 0.057365),
        ("left_foot", 7, toe, 0.143382),
        ("right_foot", 8, toe, 0.149419),
        ("neck", 9, y, 0.219360),
        ("left_collar", 9, (COLLAR, _along(COLLAR), 0.0), 0.137487),
        ("right_collar", 9, (-COLLAR, _along(COLLAR), 0.0), 0.143383),
        ("head", 12, y, 0.103039),
        ("left_shoulder", 13, x, 0.131614),
        ("right_shoulder", 14, x, -0.122984),
        ("left_elbow", 16, x, 0.256840),
        ("right_elbow", 17, x, -0.263092),
        ("left_wrist", 18, x, 0.266012),
        ("right_wrist", 19, x, -0.269876),
    ]
    return Skeleton(
        names=tuple(row[0] for row in rows),
        parents=tuple(row[1] for row in rows),
        offsets=tuple(_offset(direction, length) for _, _, direction, length in rows),
    )


def _along(aside: float) -> float:
    """The other leg of a unit direction."""
    return math.sqrt(1 - aside * aside)


def _offset(direction: tuple[float, float, float], length: float) -> tuple[float, float, float]:
    scale = length / math.hypot(*direction)
    return direction[0] * scale, direction[1] * scale, direction[2] * scale


HUMANML3D = _humanml3d()
"""HumanML3D's 22 joints on its uniform skeleton."""


def size_of(skeleton: Skeleton) -> float:
    """How many times as long its legs are as HumanML3D's, whose people limits and habits of walking are stated for."""
    return skeleton.legs / HUMANML3D.legs
