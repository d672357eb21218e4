"""What a motion from a file must be before anything is computed from it: numbers of a person, in a bounded time."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

FEWEST = 2
"""Frames of the shortest motion: one is a pose, which has neither a speed nor a duration."""
SLOWEST, FASTEST = 1.0, 1000.0
"""Frames a second: slower, nothing is known of a step (one takes half a second); faster, no capture system records."""
LONGEST = 3600.0
"""Seconds of the longest motion, and of the latest that one may begin: an hour, 60 times what is made."""
FARTHEST = 1e8
"""Metres from the origin: ten times the largest coordinates of maps (UTM's northings, 10^7 m)."""
WIDEST = 10.0
"""Metres from the pelvis to any joint: several times the tallest person."""
UNIT = 1e-3
"""By how much a quaternion's length may be off 1: what half precision stores is off by less."""
JOINTS = 1000
"""Joints of a skeleton at most."""

Shapes = Mapping[str, tuple[int, ...]]


def check_shapes(shapes: Shapes) -> None:
    """Hold arrays of a motion file against each other by their shapes alone; raises ValueError for what does not fit.

    Args:
        shapes: of `joints` ``[T, J, 3]`` or ``[S, T, J, 3]``, and of what else is there: `valid` ``[T]`` or ``[S, T]``,
            `joint_names` and `parents` ``[J]``, `offsets` ``[J, 3]``, `fps` and `t0` one number each.
    """
    joints = shapes["joints"]
    if len(joints) not in (3, 4) or joints[-1] != 3 or not 1 <= joints[-2] <= JOINTS:
        raise ValueError(f"its joints have shape {joints}; give [frames, joints, 3] or [samples, frames, joints, 3]")
    if len(joints) == 4 and joints[0] == 0:
        raise ValueError("it holds no motion")
    frames, count = joints[-3:-1]
    if frames < FEWEST:
        raise ValueError(f"it holds {frames or 'no'} frame{'' if frames == 1 else 's'}; a motion has {FEWEST} or more")
    wanted = {"valid": joints[:-2], "joint_names": (count,), "parents": (count,), "offsets": (count, 3)}
    for key, shape in wanted.items():
        if shapes.get(key, shape) != shape:
            raise ValueError(f"its '{key}' have shape {shapes[key]}; with joints of {joints} they are {shape}")
    for key in ("fps", "t0"):
        if shapes.get(key, ()) not in ((), (1,)):
            raise ValueError(f"its '{key}' has shape {shapes[key]}; give one number")


def check_rate(fps: float | int, frames: int) -> None:
    """Raise ValueError for frames a second that nobody records, or so few that the motion would last for hours."""
    if not SLOWEST <= fps <= FASTEST:
        raise ValueError(f"it has {fps:g} frames a second; {SLOWEST:g} to {FASTEST:g} are read")
    if frames / fps > LONGEST:
        raise ValueError(f"it lasts {frames / fps:.0f} s; {LONGEST:g} s are the most that is read")


def check_times(t0: float) -> None:
    """Raise ValueError for a motion that begins at no time."""
    if not abs(t0) <= LONGEST:
        raise ValueError(f"it begins at {t0:g} s; times from {-LONGEST:g} to {LONGEST:g} s are read")


def check_valid(valid: np.ndarray) -> None:
    """Raise ValueError for motions without `FEWEST` real frames, or with real frames after padding; ``[*b, T]``."""
    counts = valid.sum(axis=-1)
    if (least := int(counts.min())) < FEWEST:
        raise ValueError(f"it holds a motion of {least} real frames ('valid'); a motion has {FEWEST} or more")
    if (valid[..., 1:] & ~valid[..., :-1]).any():
        raise ValueError("it has real frames after padding ('valid'); cut the padding out")


def check_rotations(arrays: Mapping[str, np.ndarray]) -> None:
    """Raise ValueError for `rotations` that are no unit quaternions, one for each of `joints` ``[*b, T, J, 3]``."""
    if "rotations" not in arrays:
        return
    rotations, wanted = arrays["rotations"], (*arrays["joints"].shape[:-1], 4)
    if rotations.shape != wanted:
        raise ValueError(f"its 'rotations' have shape {rotations.shape}; they are quaternions w, x, y, z, {wanted}")
    if not np.isfinite(rotations).all():
        raise ValueError("its 'rotations' are not finite numbers; leave them out, and they are made of the joints")
    if (off := float(np.abs(np.linalg.norm(rotations, axis=-1) - 1).max())) > UNIT:
        raise ValueError(f"its 'rotations' are off unit length by {off:.2g}; leave them out, and they are made anew")


def check_places(joints: np.ndarray, names: tuple[str, ...]) -> None:
    """Raise ValueError for joints ``[*b, T, J, 3]`` (m) that are not finite, out of this world, or of no person."""
    if not np.isfinite(joints).all():
        raise ValueError("it holds joint positions that are not finite")
    if (largest := float(np.abs(joints).max())) > FARTHEST:
        raise ValueError(f"it holds a joint {largest:.3g} m from the origin; {FARTHEST:g} m are the most that is read")
    away = np.linalg.norm(joints - joints[..., :1, :], axis=-1)
    if (widest := float(away.max())) > WIDEST:
        *_, frame, joint = np.unravel_index(away.argmax(), away.shape)
        raise ValueError(
            f"its {names[joint]} is {widest:.3g} m from its {names[0]} at frame {frame}; {WIDEST:g} m are read at most"
        )
