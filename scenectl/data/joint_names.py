"""From the joint names of other people's skeletons to the 22 joints.

Mixamo, LAFAN1, NVIDIA's SOMA, the two common conversions of CMU's captures, 3ds Max, Bandai Namco, Acclaim bones and
SMPL name the same joints differently, and one word can mean two joints: ``LeftShoulder`` is the collar where there is a
``LeftArm``, and the shoulder where there is a ``LeftCollar``. Names are therefore reduced to a side and a part, and the
parts of a joint are tried in order, each file joint being used once.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from os.path import commonprefix

from scenes.errors import UserError, did_you_mean
from scenes.motion.skeleton import HUMANML3D

# The order matters: a joint takes the first part that is there and not taken by a joint above it.
_LIMBS: tuple[tuple[str, tuple[str, ...]], ...] = (
    ("hip", ("upleg", "upperleg", "thigh", "thighbend", "femur", "hip", "leg")),  # of SOMA, whose knees are shins
    ("knee", ("knee", "lowleg", "lowerleg", "shin", "calf", "tibia", "leg")),
    ("ankle", ("ankle", "foot")),
    ("foot", ("toebase", "toe", "toes", "toe0", "ball", "forefoot", "foot")),
    ("shoulder", ("uparm", "upperarm", "shldr", "shldrbend", "humerus", "arm", "shoulder")),
    ("collar", ("collar", "clavicle", "collarbone", "shoulder")),
    ("elbow", ("elbow", "forearm", "forearmbend", "lowarm", "lowerarm", "radius")),
    ("wrist", ("wrist", "hand")),
)
_MIDDLE: tuple[tuple[str, tuple[str, ...]], ...] = (
    ("pelvis", ("hips", "pelvis", "hip", "centerhip", "root", "")),
    ("neck", ("neck", "lowerneck", "neck1", "necklower", "neck0", "neck01")),
    ("head", ("head",)),
)
_PARTS = frozenset(part for _, parts in _LIMBS for part in parts)
_SIDES = {"left": "left", "right": "right", "l": "left", "r": "right"}
_SPINE = ("spine1", "spine2", "spine3")

DERIVED = ("spine1", "spine2", "spine3", "left_foot", "right_foot", "left_collar", "right_collar")
"""Joints that can be placed from others where a file does not name them."""


def match_joints(names: Sequence[str], stated: Mapping[str, str] | None = None) -> dict[str, int]:
    """Which of a file's joints is which of the 22.

    Args:
        names: the file's joints, parents before children.
        stated: {our joint: their joint} for what the table would get wrong.

    Returns:
        Index into `names` for every joint found; those in `DERIVED` may be missing.

    Raises:
        UserError: a stated joint does not exist, or joints that cannot be derived were not found (it names them).
    """
    found = _stated(names, stated or {})
    keys: dict[tuple[str, str], int] = {}
    for index, key in enumerate(_reduce(names)):
        keys.setdefault(key, index)  # the one nearest to the root
    wanted = [(f"{side}_{joint}", side, parts) for side in ("left", "right") for joint, parts in _LIMBS]
    wanted += [(joint, "", parts) for joint, parts in _MIDDLE]
    # SMPL's spine names mean exactly our joints; elsewhere 'Spine1' is just the second of some number of them.
    if all(("", part) in keys for part in _SPINE) and ("", "spine") not in keys:
        wanted += [(joint, "", (joint,)) for joint in _SPINE]
    for joint, side, parts in wanted:
        free = [keys[side, part] for part in parts if (side, part) in keys and keys[side, part] not in found.values()]
        if joint not in found and free:
            found[joint] = free[0]
    missing = [name for name in HUMANML3D.names if name not in found and name not in DERIVED]
    if missing:
        raise UserError(
            f"no joint found for {', '.join(missing)} among {listed(names)}; "
            "rename them or state which is which in `joints`"
        )
    return found


def listed(names: Sequence[str]) -> str:
    """Names in one sentence, the first dozen of them, each cut short."""
    more = f" and {len(names) - 12} more" if len(names) > 12 else ""
    return ", ".join(name if len(name) <= 30 else name[:27] + "..." for name in names[:12]) + more


def _stated(names: Sequence[str], stated: Mapping[str, str]) -> dict[str, int]:
    found = {}
    for joint, name in stated.items():
        HUMANML3D.index(joint)
        if name not in names:
            raise UserError(f"joint '{name}', stated as {joint}, is not in the file{did_you_mean(name, names)}")
        found[joint] = list(names).index(name)
    return found


def _reduce(names: Sequence[str]) -> list[tuple[str, str]]:
    """(side, part) of each name; side is "left", "right" or ""."""
    # 'mixamorig:Hips', 'Model_Hips' and 'Bip01 Spine' carry a prefix that all joints share
    shared = len(commonprefix([name.lower() for name in names])) if len(names) > 1 else 0  # noqa: RUF071 - letters are meant
    return [_side_and_part(name[shared:].rpartition(":")[2]) for name in names]


def _side_and_part(name: str) -> tuple[str, str]:
    words = [word.lower() for word in re.findall(r"[A-Z]+(?=[A-Z][a-z])|[A-Z]?[a-z]+|[A-Z]+|\d+", name)]
    for word, side in _SIDES.items():
        if word in words:
            words.remove(word)
            return side, "".join(words)
    part = "".join(words)
    for start, side in _SIDES.items():  # written together, as in 'lefthip' and 'lfemur'
        if part.startswith(start) and part.removeprefix(start) in _PARTS:
            return side, part.removeprefix(start)
    return "", part
