"""BVH files out: rotations for animation tools, from which `scenectl.data.formats.bvh` reads the joints back."""

from __future__ import annotations

import warnings
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import torch
from jaxtyping import Float
from scipy.spatial.transform import Rotation

from scenectl.data.formats.people import UNITS
from scenes.errors import UserError, did_you_mean
from scenes.files import atomic_write
from scenes.motion.bones import bone_lengths
from scenes.motion.motion import Motion
from scenes.motion.rotations import rotation_between


def write_bvh(motion: Motion, path: str | Path, unit: str = "cm") -> None:
    """Write one motion as rotations (order z, x, y), valid frames only.

    Bones get their median length; where a motion keeps its bone lengths, `load_bvh` returns its joints. Every bone
    that leaves a branching joint turns by itself, through a joint of length zero called ``<parent>_to_<child>``,
    because the joints of a generated pelvis or chest are not exactly rigid.

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
    nodes = list(_nodes(Motion(joints, fps=motion.fps, skeleton=motion.skeleton)))
    rows = np.concatenate([joints[:, 0].numpy() / UNITS[unit], *(_angles(turn) for *_, turn in nodes)], axis=1)
    lines = [*_hierarchy(nodes, UNITS[unit]), "MOTION", f"Frames: {len(rows)}", f"Frame Time: {1 / motion.fps:.8f}"]
    with atomic_write(path, "w") as out:
        np.savetxt(out, rows, "%.6f", header="\n".join(lines), comments="")


_Node = tuple[int, str, np.ndarray, np.ndarray]
"""Depth in the tree, name, rest offset from the joint above (m), and turns relative to it, of a joint as written."""


def _nodes(motion: Motion) -> Iterator[_Node]:
    """Every joint, parents first, depth first; a joint that branches is followed by one for each bone's own turn."""
    skeleton, ends = motion.skeleton, [child for _, child in motion.skeleton.bones]
    # Rest directions of the skeleton, with the motion's median bone lengths.
    rest, lengths = np.array(skeleton.offsets), bone_lengths(motion).median(0).values.numpy()
    rest[ends] *= (lengths / np.maximum(skeleton.bone_lengths[ends], 1e-9))[:, None]

    def below(joint: int, depth: int, above: np.ndarray) -> Iterator[_Node]:
        children = [child for parent, child in skeleton.bones if parent == joint]
        bones = motion.joints[:, children] - motion.joints[:, [joint]]
        branches, turn = len(children) > 1, above
        if branches:
            turn = _best_rotation(rest[children], bones.numpy())
        elif children:
            turn = _swing(above, rest[children[0]], bones[:, 0])
        yield depth, skeleton.names[joint], rest[joint], above.swapaxes(-1, -2) @ turn
        for i, child in enumerate(children):
            swung = _swing(turn, rest[child], bones[:, i]) if branches else turn
            if branches:
                link = f"{skeleton.names[joint]}_to_{skeleton.names[child]}"
                yield depth + 1, link, np.zeros(3), turn.swapaxes(-1, -2) @ swung
            yield from below(child, depth + 1 + branches, swung)

    yield from below(0, 0, np.tile(np.eye(3), (motion.frames, 1, 1)))


def _swing(above: np.ndarray, rest: np.ndarray, bone: Float[torch.Tensor, "T 3"]) -> np.ndarray:
    """The rotation nearest to `above` that points `rest` along `bone`."""
    swing: np.ndarray = rotation_between(torch.from_numpy(above @ rest), bone).numpy()
    return swing @ above


def _best_rotation(rest: np.ndarray, bones: np.ndarray) -> np.ndarray:
    """Least-squares rotations of n rest vectors ``[n, 3]`` onto ``[T, n, 3]`` (Kabsch)."""
    u, _, v = np.linalg.svd(np.einsum("tni,nj->tij", bones, rest))
    u[..., 2] *= np.sign(np.linalg.det(u @ v))[:, None]
    return np.asarray(u @ v)


def _angles(turn: np.ndarray) -> Float[np.ndarray, "T 3"]:
    """Angles z, x, y in degrees with R = Rz Rx Ry, continuous over time."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # where z and y turn about one axis, all of it is given to z
        return np.unwrap(Rotation.from_matrix(turn).as_euler("ZXY", degrees=True), period=360, axis=0)


def _hierarchy(nodes: list[_Node], metres: float) -> Iterator[str]:
    """Lines that describe the tree, in units of so many metres."""
    yield "HIERARCHY"
    for (depth, name, rest, _), after in zip(nodes, [*(depth for depth, *_ in nodes[1:]), 0], strict=True):
        pad, offset = "\t" * depth, rest / metres
        yield from (f"{pad}{'JOINT' if depth else 'ROOT'} {name}", f"{pad}{{", f"{pad}\tOFFSET {_vector(offset)}")
        place = "3" if depth else "6 Xposition Yposition Zposition"
        yield f"{pad}\tCHANNELS {place} Zrotation Xrotation Yrotation"
        if after <= depth:
            yield from (f"{pad}\tEnd Site", f"{pad}\t{{", f"{pad}\t\tOFFSET {_vector(offset / 2)}", f"{pad}\t}}")
        yield from ("\t" * closed + "}" for closed in range(depth, after - 1, -1))


def _vector(values: np.ndarray) -> str:
    return " ".join(f"{value:.6f}" for value in values)
