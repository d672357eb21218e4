"""Motions of any origin as `Motion`: NumPy arrays, NumPy archives and BVH, in metres, y up, with our 22 joints.

What is read, by the ending of the file:

- ``.npz``: `joints` ``[T, J, 3]`` or ``[S, T, J, 3]``, or `features` ``[T, 263]`` or ``[S, T, 263]`` of HumanML3D
  (`scenectl.data.features`), not normalised; an array that was saved without a name. Beside it `fps`, `joint_names`,
  `parents`, `offsets`, `valid` (True where a frame is no padding), `t0` (s), `unit`, `up`, `rotations` and `format`,
  each of which may be missing. This is what `Motion.save` writes.
- ``.npy``: the same array alone; ``[T, 66]`` are joints, too.
- ``.bvh``: see `scenectl.data.formats.bvh`.
- a folder: the ``motion.npz`` in it.

Joints are the 22 of HumanML3D in its order, or any that `joint_names` tell by name. Their places are what counts: the
skeleton is the one stated (HumanML3D's where there is none) where its bones are as long as theirs, and else fitted to
them (`scenes.motion.fitting`); rotations are made of both. Frames a second are stated by the
caller or by the file; unit and axis are metres and y where neither says.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import torch

from scenectl.data.features import FEATURES, JOINTS, ROOT_HEIGHT, features_to_joints
from scenectl.data.formats.bvh import convert_bvh, read_bvh
from scenectl.data.formats.people import check_legs, doubted_axis, doubted_legs, turned
from scenectl.data.joint_names import DERIVED, listed, match_joints
from scenes.archive import load_npy, npz_headers
from scenes.errors import UserError
from scenes.files import readable
from scenes.motion.fitting import skeleton_of
from scenes.motion.motion import MOST_BYTES, Motion, read_motion_arrays, rests
from scenes.motion.skeleton import HUMANML3D, Skeleton
from scenes.motion.sound import check_rotations, check_shapes, check_valid

KEYS = (
    "joints",
    "features",
    "arr_0",
    "fps",
    "joint_names",
    "parents",
    "offsets",
    "valid",
    "t0",
    "unit",
    "up",
    "format",
    "rotations",
)
"""Of an archive; `arr_0` is what NumPy calls an array that was saved without a name."""
SUFFIXES = (".npz", ".npy", ".bvh")
_LAYOUTS = (
    f"joints [frames, {JOINTS}, 3], [samples, frames, {JOINTS}, 3] or [frames, {3 * JOINTS}], or HumanML3D's "
    f"[frames, {FEATURES}] features"
)
_HEIGHTS = (0.3, 1.6)
"""Metres that the pelvis may be high in the median: beyond, features are doubted; normalised ones have it near 0."""
_CLOCK = ("fps", "valid", "t0")


@dataclass(frozen=True)
class Reading:
    """What a file holds.

    Attributes:
        motion: one ``[T, 22, 3]`` or several ``[S, T, 22, 3]``, world metres, y up, at the file's own rate.
        notes: what was decided about it, a sentence each.
        doubts: what looks wrong, a sentence each.
    """

    motion: Motion
    notes: tuple[str, ...] = ()
    doubts: tuple[str, ...] = ()


def load_motion(
    path: str | Path, fps: float | int | None = None, unit: str | None = None, up: str | None = None
) -> Motion:
    """The motion in a file of any kind; see `read_motion`, which also tells what was decided and what is doubtful."""
    return read_motion(path, fps, unit, up).motion


def read_motion(
    path: str | Path, fps: float | int | None = None, unit: str | None = None, up: str | None = None
) -> Reading:
    """Read a motion that anybody wrote.

    Args:
        path: an ``.npz``, ``.npy`` or ``.bvh`` file as the module describes them, or a folder with a ``motion.npz``.
        fps: frames a second, instead of what the file says.
        unit: "m", "cm", "mm", "in", "ft" or "cmu", instead of what the file says.
        up: the axis that is up, "x", "y" or "z", instead of what the file says.

    Raises:
        UserError: no such file, another layout, no frames a second from anybody, joints that are none of a person.
    """
    path = Path(path)
    path = readable(path / "motion.npz" if path.is_dir() else path, "motion file")
    where, suffix = f"motion file '{path}'", path.suffix.lower()
    if suffix not in SUFFIXES:
        raise UserError(f"{where} ends with '{suffix}'; {', '.join(SUFFIXES)} are read")
    if suffix == ".bvh":
        return _of_bvh(path, fps, unit, up)
    try:
        arrays = _archive(path) if suffix == ".npz" else {"arr_0": load_npy(path, MOST_BYTES)}
        return _of_arrays(arrays, fps, unit, up, where)
    except (OSError, ValueError) as error:
        raise UserError(f"{where}: {getattr(error, 'strerror', None) or error}") from error


def one_of(motion: Motion, sample: int, path: str | Path) -> Motion:
    """One motion ``[T, J, 3]`` of those that a file holds, 0 being the best; raises UserError for none."""
    count = len(motion.joints) if motion.joints.ndim == 4 else 1
    if not 0 <= sample < count:
        which = "one motion; --sample is 0" if count == 1 else f"{count} motions; --sample goes from 0 to {count - 1}"
        raise UserError(f"'{path}' holds {which}")
    return motion[sample] if motion.joints.ndim == 4 else motion


def _of_bvh(path: Path, fps: float | int | None, unit: str | None, up: str | None) -> Reading:
    file = read_bvh(path)
    doubts: tuple[str, ...] = ()
    if fps is not None and abs(file.rate / fps - 1) > 1e-3:
        doubts = (f"BVH file '{path}': it says {file.rate:.4g} frames a second, and {fps:g} were stated and are taken",)
        file = file.at_rate(fps)
    clip = convert_bvh(file, unit, up, fps=None, source=str(path))
    try:
        motion = Motion.from_arrays({"joints": clip.motion.joints.numpy(), "fps": clip.motion.fps})
        motion = replace(motion, skeleton=clip.motion.skeleton)
    except ValueError as error:
        raise UserError(f"BVH file '{path}': {error}") from error
    return Reading(motion, (clip.message,), doubts + clip.doubts)


def _archive(path: Path) -> dict[str, np.ndarray]:
    """What is known of an .npz file's arrays; raises ValueError where none of them is a motion."""
    names = npz_headers(path).keys()
    if names.isdisjoint(KEYS[:3]):
        why = "; poses of SMPL need its body model: let that write the joints" if {"poses", "trans"} <= names else ""
        raise ValueError(f"it holds {listed([*names]) or 'nothing'}, and a motion is 'joints' or 'features'{why}")
    return read_motion_arrays(path, KEYS)


def _of_arrays(
    arrays: Mapping[str, np.ndarray], fps: float | int | None, unit: str | None, up: str | None, where: str
) -> Reading:
    key = next(key for key in KEYS if key in arrays)
    if arrays[key].dtype.kind not in "fiu":
        raise ValueError(f"its '{key}' are of type {arrays[key].dtype}, not numbers")
    doubts: list[str] = []
    joints = _joints(key, arrays[key], doubts)
    _check_tree(joints.shape, arrays)
    joints = _ours(joints, arrays.get("joint_names"))
    clock = {name: arrays[name] for name in _CLOCK if name in arrays}
    if fps is not None:
        if "fps" in clock and clock["fps"].size == 1 and float(clock["fps"].item()) != fps:
            doubts.append(f"it says {clock['fps'].item():g} frames a second, and {fps:g} were stated and are taken")
        clock["fps"] = np.array(fps)
    if "fps" not in clock:
        raise ValueError("it does not say its frames a second; state them, such as --fps 30 (HumanML3D has 20)")
    check_shapes({"joints": joints.shape, **{name: array.shape for name, array in clock.items()}})
    real = _real(joints, clock)
    unit, up = unit or _word(arrays, "unit"), up or _word(arrays, "up")
    joints = turned(joints, unit or "m", up or "y")
    real = turned(real, unit or "m", up or "y")
    check_legs(real, unit or "m")
    motion = Motion.from_arrays({**clock, **_stated(arrays), "joints": joints})
    motion = replace(motion, skeleton=skeleton_of(motion))
    doubts = [f"{where}: {doubt}" for doubt in doubts]
    doubts += () if unit else doubted_legs(real, where)
    doubts += () if up else doubted_axis(real, where)
    return Reading(motion, (), tuple(doubts))


def _joints(key: str, array: np.ndarray, doubts: list[str]) -> np.ndarray:
    """Joints ``[T, J, 3]`` or ``[S, T, J, 3]`` of joints, flat ones or features; raises ValueError for other shapes."""
    shape = array.shape
    if array.size and len(shape) in (2, 3) and shape[-1] == FEATURES and key != "joints":
        height = float(np.median(array[..., ROOT_HEIGHT]))
        if not _HEIGHTS[0] <= height <= _HEIGHTS[1]:
            doubts.append(
                f"the root of its features is {height:.2f} m high; if they are normalised, take them times the data "
                "set's Std.npy plus its Mean.npy first"
            )
        return features_to_joints(torch.from_numpy(array.astype(np.float32))).numpy()
    if key != "features" and len(shape) in (2, 3) and shape[-1] == 3 * JOINTS:
        return array.reshape(*shape[:-1], JOINTS, 3)
    if key == "features" or len(shape) not in (3, 4) or shape[-1] != 3:
        raise ValueError(f"its '{key}' have shape {list(shape)}; read are {_LAYOUTS}")
    return array


def _check_tree(shape: tuple[int, ...], arrays: Mapping[str, np.ndarray]) -> None:
    """Raise ValueError for parents or offsets of no tree: they aren't needed, but a file that has such is unsound."""
    tree = {key: arrays[key] for key in ("parents", "offsets") if key in arrays}
    check_shapes({"joints": shape, **{key: array.shape for key, array in tree.items()}})
    if wrong := [key for key, array in tree.items() if array.dtype.kind not in ("iu" if key == "parents" else "fiu")]:
        raise ValueError(f"its '{wrong[0]}' are of type {arrays[wrong[0]].dtype}, not numbers of that kind")
    count = shape[-2]
    parents = tree.get("parents", np.minimum(np.arange(count) - 1, 0))
    offsets = tree.get("offsets", np.zeros((count, 3))).astype(float)
    try:
        Skeleton(
            tuple(map(str, range(count))), tuple(parents.tolist()), tuple((x, y, z) for x, y, z in offsets.tolist())
        )
    except UserError as error:
        raise ValueError(f"{error}; or leave {' and '.join(tree)} out") from error


def _stated(arrays: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
    """What says how our joints rest, of a file that has them and a T-pose; raises ValueError for unsound rotations."""
    if not rests(arrays) or "joints" not in arrays:
        return {}
    check_rotations(arrays)
    tree = {key: arrays[key] for key in ("joint_names", "parents", "offsets", "format") if key in arrays}
    names, parents = (tree[key].tolist() if key in tree else [] for key in ("joint_names", "parents"))
    ours = names == list(HUMANML3D.names) and parents == list(HUMANML3D.parents)
    return tree if ours and (_word(arrays, "unit"), _word(arrays, "up")) == ("m", "y") else {}


def _ours(joints: np.ndarray, names: np.ndarray | None) -> np.ndarray:
    """Our 22 joints, in our order, of joints ``[*b, J, 3]`` with names; raises ValueError where they cannot be told."""
    count = joints.shape[-2]
    if names is None:
        if count != JOINTS:
            raise ValueError(
                f"it holds {count} joints without 'joint_names'; without them, joints are HumanML3D's {JOINTS} "
                "(the first of SMPL's)"
            )
        return joints
    if names.shape != (count,) or names.dtype.kind not in "US":
        raise ValueError(f"its 'joint_names' are no {count} names, one for each joint")
    words = names.astype(str).tolist()
    if words == list(HUMANML3D.names):
        return joints
    known = set(HUMANML3D.names) <= set(words)
    found = {name: words.index(name) for name in HUMANML3D.names} if known else match_joints(words)
    if missing := [name for name in DERIVED if name not in found]:
        raise ValueError(f"no joint found for {', '.join(missing)} among its 'joint_names'")
    return joints[..., [found[name] for name in HUMANML3D.names], :]


def _real(joints: np.ndarray, clock: Mapping[str, np.ndarray]) -> np.ndarray:
    """The frames ``[n, 22, 3]`` that are no padding; raises ValueError where there are none, or not finite."""
    if not np.isfinite(joints).all():
        raise ValueError("it holds joint positions that are not finite")
    if "valid" not in clock:
        return joints.reshape(-1, JOINTS, 3)
    if clock["valid"].dtype.kind not in "biu":
        raise ValueError(f"its 'valid' are of type {clock['valid'].dtype}, not true or false")
    valid = clock["valid"].astype(bool)
    check_valid(valid)
    real: np.ndarray = joints[valid]
    return real


def _word(arrays: Mapping[str, np.ndarray], key: str) -> str | None:
    """What a file says under a key that holds a word."""
    if key not in arrays:
        return None
    if arrays[key].size != 1 or arrays[key].dtype.kind not in "US":
        raise ValueError(f"its '{key}' is no word")
    return str(arrays[key].astype(str).item())
