"""From the joint names of other people's skeletons to the 22 joints.

Mixamo, LAFAN1, NVIDIA's SOMA, the two common conversions of CMU's captures, 3ds Max, Bandai Namco, Acclaim bones and
SMPL name the same joints differently, and one word can mean two joints: ``LeftShoulder`` is the collar where there is a
``LeftArm``, and the shoulder where there is a ``LeftCollar``. Names are therefore reduced to a side and a part, and the
parts of a joint are tried in order, each file joint being used once.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path

from scenes.errors import UserError, did_you_mean
from scenes.files import read_json, read_toml
from scenes.motion.skeleton import HUMANML3D

# The order matters: a joint takes the first part that is there and not taken by a joint above it.
_LIMBS: tuple[tuple[str, tuple[str, ...]], ...] = (
    ("hip", ("upleg", "upperleg", "thigh", "thighbend", "femur", "hip", "leg")),  # of SOMA, whose knees are shins
    ("knee", ("knee", "lowleg", "lowerleg", "shin", "calf", "tibia", "leg")),
    ("ankle", ("ankle", "foot")),
    ("foot", ("toebase", "toe", "toes", "toe0", "ball", "forefoot", "foot")),
    ("shoulder", ("uparm", "upperarm", "shldr", "shldrbend", "humerus", "arm", "shoulder")),
    ("collar", ("collar", "clavicle", "collarbone", "scapula", "shoulder")),
    ("elbow", ("elbow", "forearm", "forearmbend", "lowarm", "lowerarm", "radius")),
    ("wrist", ("wrist", "hand", "palm")),
)
_MIDDLE: tuple[tuple[str, tuple[str, ...]], ...] = (
    ("pelvis", ("hips", "pelvis", "hip", "centerhip", "root", "")),
    ("neck", ("neck", "lowerneck", "neck1", "necklower", "neck0", "necktwist")),
    ("head", ("head",)),
)
_PARTS = frozenset(part for _, parts in _LIMBS for part in parts)
_CENTRE = frozenset(part for _, parts in _MIDDLE for part in parts if part)
_SIDES = {"left": "left", "right": "right", "l": "left", "r": "right"}
_AMID = ("c", "m")  # as in 'J_Bip_C_Hips' and 'Root_M'
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
    found = find_joints(names, stated)
    refuse_missing(found, names)
    return found


def find_joints(names: Sequence[str], stated: Mapping[str, str] | None = None) -> dict[str, int]:
    """`match_joints` without its refusal of what is missing: all joints that names tell."""
    found = _stated(names, stated or {})
    keys = _reduce(names)
    wanted = [(f"{side}_{joint}", side, parts) for side in ("left", "right") for joint, parts in _LIMBS]
    wanted += [(joint, "", parts) for joint, parts in _MIDDLE]
    # SMPL's spine names mean exactly our joints; elsewhere 'Spine1' is just the second of some number of them.
    if all(("", part) in keys for part in _SPINE) and ("", "spine") not in keys:
        wanted += [(joint, "", (joint,)) for joint in _SPINE]
    for joint, side, parts in wanted:
        free = [keys[side, part] for part in parts if (side, part) in keys and keys[side, part] not in found.values()]
        if joint not in found and free:
            found[joint] = free[0]
    return found


def refuse_missing(found: Mapping[str, int], names: Sequence[str]) -> None:
    """Raise UserError that names joints which were not found and cannot be derived."""
    missing = [name for name in HUMANML3D.names if name not in found and name not in DERIVED]
    if missing:
        raise UserError(
            f"no joint found for {', '.join(missing)} among {listed(names)}; "
            "rename them or state which is which in `joints`"
        )


def read_mapping(path: str | Path) -> dict[str, str]:
    """{our joint: theirs} of a TOML or JSON file; raises UserError for anything else."""
    what, path = "joint mapping", Path(path)
    table = read_json(path, what, "correct it") if path.suffix.lower() == ".json" else read_toml(path, what)
    if not isinstance(table, dict) or not all(isinstance(name, str) for name in table.values()):
        raise UserError(f"{what} '{path}' is no table of names; write lines such as left_knee = \"LeftLeg\"")
    try:
        HUMANML3D.indices([*table])
    except UserError as error:
        raise UserError(f"{what} '{path}': {error}") from error
    return table


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


def _reduce(names: Sequence[str]) -> dict[tuple[str, str], int]:
    """Index of the name of each (side, part), the nearest to the root; side is "left", "right" or "".

    'mixamorig:Hips', 'CC_Base_L_Thigh' and 'DEF-shin.L' carry a prefix, not on every name of a file: the words are left
    out with which most joints are found. Numbers behind a part ('thigh.L.001', 'Hips_01') count where nothing has it
    without them.
    """
    split = [_side_and_words(name) for name in names]
    found = Counter[tuple[str, ...]]()
    for before, _, _ in {(words[:k], side, part) for side, words in split for k, part in _endings(side, words)}:
        found[before] += 1
    prefix = min(found, key=lambda before: (-found[before], len(before), before), default=())
    own = [(side, words[len(prefix) :]) if words[: len(prefix)] == prefix else None for side, words in split]
    whole = [(side, words[: 0 if words == prefix else None]) for side, words in split]
    keys: dict[tuple[str, str], int] = {}
    for told in (own, whole):
        for index, key in enumerate(told):
            if key is not None:
                keys.setdefault((key[0], "".join(key[1])), index)
        for index, key in enumerate(told):
            part = _numberless(key[1]) if key is not None else ""
            if key is not None and part in _vocabulary(key[0]):
                keys.setdefault((key[0], part), index)
    return keys


def _endings(side: str, words: tuple[str, ...]) -> list[tuple[int, str]]:
    """Where parts of ours begin that the words end with, and those."""
    ends = [(k, part) for k in range(len(words)) for part in ("".join(words[k:]), _numberless(words[k:]))]
    return [(k, part) for k, part in ends if part in _vocabulary(side)]


def _vocabulary(side: str) -> frozenset[str]:
    return _PARTS if side else _CENTRE


def _numberless(words: Sequence[str]) -> str:
    return "".join(words).rstrip("0123456789")


def _side_and_words(name: str) -> tuple[str, tuple[str, ...]]:
    words = [word.lower() for word in re.findall(r"[A-Z]+(?=[A-Z][a-z])|[A-Z]?[a-z]+|[A-Z]+|\d+", name)]
    for word, side in _SIDES.items():
        if word in words:
            words.remove(word)
            return side, tuple(words)
    words = [word for word in words if word not in _AMID]
    for k, part in enumerate(words):  # written together, as in 'lefthip' and 'lfemur'
        for start, side in _SIDES.items():
            if part.startswith(start) and "".join((part.removeprefix(start), *words[k + 1 :])) in _PARTS:
                return side, (*words[:k], part.removeprefix(start), *words[k + 1 :])
    return "", tuple(words)
