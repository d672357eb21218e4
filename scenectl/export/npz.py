"""NumPy archives out, as programs read them that bring motions to robots; nothing in them is pickled.

World coordinates, metres and z up by default, where a T-pose faces -y and has its left along x, as in AMASS.

`joints` (the default) was written for holosoma_retargeting of amazon-far/holosoma, whose formats "smplx" and those of
one's own (its ADD_MOTION_FORMAT_README.md) read `global_joint_positions` ``[T, J, 3]`` and `height`; names "humanml"
are in the order of its "smplx". That program takes all frames to be at 30 a second (`--fps 30`).

`bodies` was written for GMR (YanjieZe/GMR, `GeneralMotionRetargeting.retarget`), which takes a frame as
``{name: (position, quaternion w x y z)}`` under the names and frames of SMPL-X's joints. One of them, and its stature
for `actual_human_height`, are

    data = np.load("motion.npz")
    frame = dict(zip(data["body_names"].tolist(), zip(data["body_positions"][t], data["body_rotations"][t])))
    height = float(data["height"])

Both were written from the public sources and not run with these programs, which no package index has. SMPL's own
parameters (`poses`, `betas`) are not written: they are about its body model's joints, which lie elsewhere.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from scenectl.data.formats.people import UNITS
from scenectl.export.animation import Animation
from scenectl.export.settings import Settings
from scenes.body.body import DEFAULT_BODY
from scenes.errors import UserError, did_you_mean
from scenes.files import atomic_write
from scenes.mesh.scale import TO_Y_UP
from scenes.motion.frames import fine_enough

SEVERAL = False
TAKES = frozenset({"up", "unit", "layout"})
LAYOUTS = ("joints", "bodies")


def write(animations: Sequence[Animation], path: Path, settings: Settings) -> None:
    """Write one animation; raises UserError for an unknown layout and a path that cannot be written."""
    (animation,) = animations
    layout, unit, up = settings.layout or "joints", settings.unit or "m", settings.up or "z"
    if layout not in LAYOUTS:
        raise UserError(f"unknown layout '{layout}'{did_you_mean(layout, LAYOUTS)}")
    places = fine_enough(animation.joints / UNITS[unit] @ TO_Y_UP[up])
    names = np.array(animation.skeleton.names)
    arrays: dict[str, Any] = {"global_joint_positions": places, "joint_names": names}
    if layout == "bodies":
        turns = Rotation.from_quat(animation.orientations.reshape(-1, 4), scalar_first=True)
        turns = Rotation.from_matrix(TO_Y_UP[up].T) * turns  # frames of bodies stay those of the T-pose with y up
        quaternions = turns.as_quat(scalar_first=True).reshape(animation.orientations.shape)
        arrays = {"body_positions": places, "body_rotations": quaternions.astype(np.float32), "body_names": names}
    arrays |= {
        "height": np.float64(DEFAULT_BODY.height * animation.size / UNITS[unit]),
        "fps": np.float64(animation.fps),
        "unit": np.array(unit),
        "up": np.array(up),
    }
    with atomic_write(path) as out:
        np.savez_compressed(out, **arrays)
