"""BVH files out: rotations for animation tools, from which `scenectl.data.formats.bvh` reads the joints back."""

from __future__ import annotations

import warnings
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np
from jaxtyping import Float
from scipy.spatial.transform import Rotation
from torch import Tensor

from scenectl.data.formats.people import UNITS
from scenes.errors import UserError, did_you_mean
from scenes.files import atomic_write
from scenes.motion.fitting import fitted
from scenes.motion.motion import Motion
from scenes.motion.rigid import rigid
from scenes.motion.rotations import matrices
from scenes.motion.skeleton import Skeleton, tree_order

RIGID = 1e-4
"""Metres by which joints may be off their skeleton's pieces and count as rigid: what a round trip keeps."""


def write_bvh(motion: Motion, path: str | Path, unit: str = "cm") -> float:
    """Write one motion as the rotations of its joints (order z, x, y) against a T-pose, valid frames only.

    Where the motion's pieces are rigid, `load_bvh` returns its joints. Where they are not, a skeleton is fitted to it
    (`scenes.motion.fitting`) and the motion put on its bones.

    Returns:
        By how much (m) that moved the joint that it moved most; 0 for what is rigid, to `RIGID`.

    Raises:
        UserError: a batch instead of one motion, no valid frame, an unknown unit, or a path that cannot be written.
    """
    if motion.joints.ndim != 3:
        raise UserError(f"BVH files hold one motion, not {tuple(motion.joints.shape[:-3])}; choose one with motion[i]")
    if unit not in UNITS:
        raise UserError(f"unknown unit '{unit}'{did_you_mean(unit, UNITS)}")
    joints = motion.joints.detach()[motion.valid].double().cpu()
    if len(joints) == 0:
        raise UserError("a motion without a valid frame cannot be written as BVH")
    motion, moved = _on_bones(Motion(joints, fps=motion.fps, skeleton=motion.skeleton))
    order = tree_order(motion.skeleton.parents)
    rows = [motion.joints[:, 0].numpy() / UNITS[unit], *(_angles(motion.rotations[:, joint]) for joint in order)]
    lines = [*_hierarchy(motion.skeleton, order, UNITS[unit]), "MOTION", f"Frames: {motion.frames}"]
    lines.append(f"Frame Time: {1 / motion.fps:.8f}")
    with atomic_write(path, "w") as out:
        np.savetxt(out, np.concatenate(rows, axis=1), "%.6f", header="\n".join(lines), comments="")
    return moved


def _on_bones(motion: Motion) -> tuple[Motion, float]:
    """The motion with rigid pieces, and by how much (m) it moved for that."""
    on = rigid(motion)
    if float((on.joints - motion.joints).norm(dim=-1).max()) <= RIGID:
        return motion, 0.0
    on = rigid(motion, fitted(motion))
    moved = float((on.joints - motion.joints).norm(dim=-1).max())
    return on, moved if moved > RIGID else 0.0


def _angles(rotations: Float[Tensor, "T 4"]) -> Float[np.ndarray, "T 3"]:
    """Angles z, x, y in degrees with R = Rz Rx Ry, continuous over time."""
    turn = Rotation.from_matrix(matrices(rotations).numpy())
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # where z and y turn about one axis, all of it is given to z
        return np.unwrap(turn.as_euler("ZXY", degrees=True), period=360, axis=0)


def _hierarchy(skeleton: Skeleton, order: Sequence[int], metres: float) -> Iterator[str]:
    """Lines that describe the tree, in units of so many metres."""
    depths = [0] * len(order)
    for parent, joint in skeleton.bones:
        depths[joint] = depths[parent] + 1
    yield "HIERARCHY"
    for joint, after in zip(order, [*(depths[joint] for joint in order[1:]), 0], strict=True):
        depth, offset = depths[joint], np.array(skeleton.offsets[joint]) / metres + 0.0
        pad = "\t" * depth
        yield from (f"{pad}{'JOINT' if depth else 'ROOT'} {skeleton.names[joint]}", f"{pad}{{")
        yield f"{pad}\tOFFSET {_vector(offset)}"
        place = "3" if depth else "6 Xposition Yposition Zposition"
        yield f"{pad}\tCHANNELS {place} Zrotation Xrotation Yrotation"
        if after <= depth:
            yield from (f"{pad}\tEnd Site", f"{pad}\t{{", f"{pad}\t\tOFFSET {_vector(offset / 2)}", f"{pad}\t}}")
        yield from ("\t" * closed + "}" for closed in range(depth, after - 1, -1))


def _vector(values: np.ndarray) -> str:
    return " ".join(f"{value:.6f}" for value in values)
