"""CSV files out: a row a frame, one line of headings, units in them; for spreadsheets, pandas and robots' scripts.

Columns are `time_s`, seconds from the first frame, and for every joint of the preset, the root first,

- `NAME_x_m`, `NAME_y_m`, `NAME_z_m`: its place in the world, in the unit that the heading ends with;
- `NAME_qw`, `NAME_qx`, `NAME_qy`, `NAME_qz`: how it is turned in the world, as a unit quaternion without changes of
  sign, against the T-pose, in which all are 1, 0, 0, 0.

All is in the world, so that a row needs no tree to be read: pelvis to wrist is a difference of two places, and what an
inverse kinematics wants of a body is seven columns. Local rotations are in BVH and `motion.npz`. y is up by default;
with `--up z` the axes are those of robots, x the left of a T-pose that faces -y.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from scenectl.data.formats.people import UNITS
from scenectl.export.animation import Animation
from scenectl.export.settings import Settings
from scenes.files import atomic_write

SEVERAL = False
TAKES = frozenset({"up", "unit"})


def write(animations: Sequence[Animation], path: Path, settings: Settings) -> None:
    """Write one animation; raises UserError for a path that cannot be written."""
    (animation,) = animations
    animation, unit = animation.turned(settings.up or "y"), settings.unit or "m"
    ends = [*(f"{axis}_{unit}" for axis in "xyz"), *(f"q{part}" for part in "wxyz")]
    heads = ["time_s", *(f"{name}_{end}" for name in animation.skeleton.names for end in ends)]
    joints = np.concatenate([animation.joints / UNITS[unit], animation.orientations], axis=-1)
    rows = np.concatenate([animation.times[:, None], joints.reshape(animation.frames, -1)], axis=1)
    with atomic_write(path, "w") as out:
        np.savetxt(out, rows + 0.0, "%.7g", ",", header=",".join(heads), comments="")
