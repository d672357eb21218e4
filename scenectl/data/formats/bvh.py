"""BVH files in: any channel order, any unit, y, z or x up, any frame rate, the joint names of the common skeletons.

`scenectl.data.joint_names` knows the names; the result is a `Motion` of the 22 joints in metres, y up.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import torch
from jaxtyping import Float

from scenectl.data.formats.people import check_legs, doubted_axis, leg_length, likely_unit, turned
from scenectl.data.joint_names import match_joints
from scenes.errors import UserError, did_you_mean
from scenes.motion.fitting import skeleton_of
from scenes.motion.frames import fine_enough
from scenes.motion.motion import Motion
from scenes.motion.rates import told
from scenes.motion.rotations import about
from scenes.motion.skeleton import HUMANML3D
from scenes.motion.sound import check_rate

_SPINE = ("spine1", "spine2", "spine3")
_MOST_BYTES = 10**8
"""Of a file: ten minutes at 120 frames a second with the fingers take a tenth of it."""
_MOST_JOINTS = 1000
_LARGEST = 1e12
"""Of any number in a file: a thousand kilometres in micrometres."""


@dataclass(frozen=True)
class BvhFile:
    """What a BVH file says, in its own units and axes.

    Attributes:
        names: joints, parents first; end sites are called ``<parent>.end``.
        parents: index of each joint's parent, -1 for the root.
        offsets: rest offset from the parent, file units, ``[J, 3]``.
        channels: channels of each joint in the order in which they are written and applied.
        values: one row a frame, all channels, file units and degrees, ``[F, C]``.
        frame_time: seconds from one frame to the next.
    """

    names: tuple[str, ...]
    parents: tuple[int, ...]
    offsets: Float[np.ndarray, "J 3"]
    channels: tuple[tuple[str, ...], ...]
    values: Float[np.ndarray, "F C"]
    frame_time: float

    @property
    def rate(self) -> float:
        """Frames a second; a whole number where the frame time is one's to the five digits that files write."""
        rate = 1.0 / self.frame_time
        return float(round(rate)) if abs(rate / max(round(rate), 1) - 1) < 1e-4 else rate

    def at_rate(self, fps: float | int) -> BvhFile:
        """The same frames at another rate than the file says; raises UserError for one that nobody records at."""
        try:
            check_rate(fps, len(self.values))
        except ValueError as error:
            raise UserError(f"BVH motion: {error}") from error
        return replace(self, frame_time=1.0 / fps)

    def positions(self) -> Float[np.ndarray, "F J 3"]:
        """World positions of all joints, file units and axes.

        A position channel replaces that component of the offset, as common tools have it.
        """
        frames = len(self.values)
        places, turns, columns = [np.zeros((frames, 3))], [np.tile(np.eye(3), (frames, 1, 1))], iter(self.values.T)
        for parent, offset, channels in zip(self.parents, self.offsets, self.channels, strict=True):
            place, turn = np.tile(offset, (frames, 1)), turns[parent + 1]
            for channel, column in zip(channels, columns, strict=False):
                axis = "xyz".index(channel[0])
                if channel.endswith("position"):
                    place[:, axis] = column
                else:
                    turn = turn @ about(axis, torch.from_numpy(np.radians(column))).numpy()
            places.append(places[parent + 1] + (turns[parent + 1] @ place[..., None])[..., 0])
            turns.append(turn)
        return np.stack(places[1:], axis=1)


@dataclass(frozen=True)
class BvhClip:
    """A converted file.

    Attributes:
        motion: 22 joints, metres, y up, in the file's own place and heading, on a skeleton of their own lengths.
        unit: the unit stated or guessed (a key of `UNITS`).
        joints: {our joint: their joint} as mapped; joints that were placed from others are missing.
        message: one sentence on what was decided.
        doubts: sentences on what looks wrong.
    """

    motion: Motion
    unit: str
    joints: dict[str, str]
    message: str
    doubts: tuple[str, ...] = ()


def load_bvh(
    path: str | Path,
    unit: str | None = None,
    up: str | None = None,
    fps: float = 20.0,
    joints: Mapping[str, str] | None = None,
) -> Motion:
    """The motion in a BVH file; see `convert_bvh`, which also tells what was decided."""
    return convert_bvh(read_bvh(path), unit, up, fps, joints, source=str(path)).motion


def convert_bvh(
    file: BvhFile,
    unit: str | None = None,
    up: str | None = None,
    fps: float | None = 20.0,
    joints: Mapping[str, str] | None = None,
    source: str = "",
) -> BvhClip:
    """Take a file's content to the 22 joints, metres, y up.

    Frames are dropped where the file's rate is a multiple of `fps`; otherwise they are interpolated
    (`Motion.resampled`).
    Spine joints are placed along the file's spine in the proportions of our skeleton, feet at the end sites of ankles
    and collars halfway from neck to shoulder where the file does not have them.

    Args:
        file: what `read_bvh` returned.
        unit: a key of `UNITS`; None guesses it from the length of the legs.
        up: the file's up axis, "x", "y" or "z"; None takes y, and doubts it where the head is not above the feet.
        fps: frames a second wanted; None keeps the file's own.
        joints: {our joint: their joint} where the names say too little.
        source: file name for messages.

    Raises:
        UserError: unknown unit or axis, joints that cannot be mapped (it names them), legs of an impossible length,
            or fewer than two frames left.
    """
    where = f"BVH file '{source}'" if source else "BVH motion"
    if fps is not None and not (math.isfinite(fps) and fps > 0):
        raise UserError(f"{where}: {fps:g} frames a second cannot be made; state a positive number")
    try:
        found = match_joints([name for name in file.names if not name.endswith(".end")], joints)
        real = [i for i, name in enumerate(file.names) if not name.endswith(".end")]
        found = {joint: real[index] for joint, index in found.items()}
        mapped = _map(file, file.positions(), found)
        stated, unit = unit, likely_unit(mapped) if unit is None else unit
        placed = turned(mapped, unit, up or "y")
        check_legs(placed, unit)
    except UserError as error:
        raise UserError(f"{where}: {error}") from error
    how = "stated" if stated else f"guessed: legs are {leg_length(placed):.2f} m"
    motion = Motion(torch.from_numpy(fine_enough(placed)), fps=file.rate)
    motion = motion if fps is None else motion.resampled(fps)
    if motion.frames < 2:
        raise UserError(
            f"{where} has {len(file.values)} frame(s), too few for a motion at {motion.fps:g} frames a second"
        )
    motion = replace(motion, skeleton=skeleton_of(motion))
    message = f"{where}: unit {unit} ({how}), up axis {up or 'y'}, {told(file.rate, motion.fps)}"
    names = {joint: file.names[index] for joint, index in found.items()}
    return BvhClip(motion, unit, names, message, () if up else doubted_axis(placed, where))


def _map(file: BvhFile, positions: Float[np.ndarray, "F J 3"], found: dict[str, int]) -> Float[np.ndarray, "F 22 3"]:
    """The 22 joints in file units; places those that the file lacks."""
    placed = {joint: positions[:, index] for joint, index in found.items()}
    for side in ("left", "right"):
        if f"{side}_foot" not in placed:
            end = f"{file.names[found[f'{side}_ankle']]}.end"
            if end not in file.names:
                raise UserError(f"no joint found for {side}_foot; state it in `joints`")
            placed[f"{side}_foot"] = positions[:, file.names.index(end)]

    def apart(part: str) -> float:
        return float(np.linalg.norm(placed[f"left_{part}"][0] - placed[f"right_{part}"][0]))

    # Some skeletons (CMU's) have both collars in one point at the neck, which gives them no direction.
    if not {"left_collar", "right_collar"} <= placed.keys() or apart("collar") < 0.1 * apart("shoulder"):
        for side in ("left", "right"):
            placed[f"{side}_collar"] = (placed["neck"] + placed[f"{side}_shoulder"]) / 2
    if not {*_SPINE} <= placed.keys():
        placed |= dict(zip(_SPINE, _spine(file, positions, found), strict=True))
    return np.stack([placed[name] for name in HUMANML3D.names], axis=1)


def _spine(file: BvhFile, positions: Float[np.ndarray, "F J 3"], found: dict[str, int]) -> Float[np.ndarray, "3 F 3"]:
    """spine1 to spine3 on the polyline from pelvis to neck, at the shares of its length they have in our skeleton.

    However many joints a file's spine has, each point stays at a fixed place on one of its rigid bones.
    """
    above_pelvis = [found["pelvis"]]
    while above_pelvis[-1] >= 0:
        above_pelvis.append(file.parents[above_pelvis[-1]])
    path, joint = [found["neck"]], file.parents[found["neck"]]
    while joint not in above_pelvis:
        path.insert(0, joint)
        joint = file.parents[joint]
    line = positions[:, [found["pelvis"], *path]]
    ends = np.concatenate([[0.0], np.linalg.norm(np.diff(line[0], axis=0), axis=-1).cumsum()])
    shares = HUMANML3D.bone_lengths[HUMANML3D.indices((*_SPINE, "neck"))].cumsum()
    at = shares[:3] / shares[3] * ends[-1]
    weights = np.stack([np.interp(at, ends, end) for end in np.eye(len(ends))])
    return np.einsum("fnc,ns->sfc", line, weights)


def read_bvh(path: str | Path) -> BvhFile:
    """Parse a BVH file.

    Raises:
        UserError: the file is missing, is not BVH, holds more than one skeleton, is cut short, or holds values that
            are not finite numbers.
    """
    path = Path(path)
    if not path.is_file():
        raise UserError(f"BVH file '{path}' does not exist")
    try:
        if (size := path.stat().st_size) > _MOST_BYTES:
            raise UserError(
                f"BVH file '{path}' has {size / 1e6:.0f} MB; {_MOST_BYTES / 1e6:.0f} MB are the most that is read"
            )
        text = path.read_text(encoding="utf-8-sig", errors="replace")
    except OSError as error:
        raise UserError(f"BVH file '{path}' cannot be read: {error.strerror or error}") from error
    head, *tail = re.split(r"^[ \t]*MOTION[ \t\r]*$", text, maxsplit=1, flags=re.MULTILINE)
    if not head.lstrip().upper().startswith("HIERARCHY") or not tail:
        raise UserError(f"file '{path}' is not BVH: it lacks the sections HIERARCHY and MOTION")
    try:
        names, parents, offsets, channels = _parse_hierarchy(head)
        values, frame_time = _parse_motion(tail[0], sum(map(len, channels)))
        check_rate(1.0 / frame_time, len(values))
    except ValueError as error:
        raise UserError(f"BVH file '{path}': {error}") from error
    return BvhFile(names, parents, offsets, channels, values, frame_time)


_Hierarchy = tuple[tuple[str, ...], tuple[int, ...], np.ndarray, tuple[tuple[str, ...], ...]]


def _parse_hierarchy(text: str) -> _Hierarchy:
    names: list[str] = []
    parents: list[int] = []
    offsets: list[list[float]] = []
    channels: list[tuple[str, ...]] = []
    open_joints: list[int] = []
    lines = text.replace("{", "\n{\n").replace("}", "\n}\n").splitlines()
    for line in map(str.strip, lines):
        word, rest = (*line.split(None, 1), "", "")[:2]
        match word.upper():
            case "ROOT" | "JOINT" | "END":
                parent = open_joints[-1] if open_joints else -1
                if names and parent < 0:
                    raise UserError("it holds more than one skeleton; split it into one file each")
                if word.upper() == "END" and parent < 0:
                    raise UserError("its hierarchy does not begin with a ROOT")
                if len(names) >= _MOST_JOINTS:
                    raise UserError(f"it has over {_MOST_JOINTS} joints")
                names.append(f"{names[parent]}.end" if word.upper() == "END" else rest)
                parents.append(parent)
                offsets.append([0.0, 0.0, 0.0])
                channels.append(())
            case "{" if names:
                open_joints.append(len(names) - 1)
            case "}":
                if not open_joints:
                    raise UserError("its braces do not match")
                open_joints.pop()
            case "OFFSET" if open_joints:
                offsets[open_joints[-1]] = _numbers(rest, 3, f"OFFSET of '{names[open_joints[-1]]}'")
            case "CHANNELS" if open_joints:
                channels[open_joints[-1]] = _channels(rest, names[open_joints[-1]])
            case "" | "HIERARCHY":
                pass
            case _:
                raise UserError(f"'{line[:40]}' is not understood in its hierarchy")
    if not names or open_joints:
        raise UserError("its hierarchy is cut short")
    return tuple(names), tuple(parents), np.array(offsets), tuple(channels)


def _channels(text: str, joint: str) -> tuple[str, ...]:
    count, *channels = text.lower().split() or ["no"]
    known = {f"{axis}{kind}" for axis in "xyz" for kind in ("position", "rotation")}
    for word in channels:
        if word not in known:
            raise UserError(f"joint '{joint}' has an unknown channel '{word}'{did_you_mean(word, known)}")
    if count != str(len(channels)):
        raise UserError(f"joint '{joint}' says it has {count} channels and lists {len(channels)}")
    return tuple(channels)


def _numbers(text: str, count: int, what: str) -> list[float]:
    try:
        numbers = [float(word) for word in text.replace(",", " ").split()]
    except ValueError:
        numbers = []
    if len(numbers) != count or not all(abs(number) <= _LARGEST for number in numbers):
        raise UserError(f"{what} is not {count} finite number(s)")
    return numbers


def _parse_motion(text: str, columns: int) -> tuple[np.ndarray, float]:
    start = re.match(r"\s*frames\s*:(.*)\n\s*frame time\s*:(.*)", text, re.IGNORECASE)
    if not start:
        raise UserError("its section MOTION does not begin with 'Frames:' and 'Frame Time:'")
    (frames,), (frame_time,) = _numbers(start[1], 1, "'Frames:'"), _numbers(start[2], 1, "'Frame Time:'")
    if frames < 1:
        raise UserError("it holds no frames")
    if frame_time < 1e-12:
        raise UserError(f"its frame time is {frame_time:g} s; it must be positive")
    try:
        words = text[start.end() :].split()
        values = np.fromiter(map(float, words), np.float64, len(words))
    except ValueError as error:
        raise UserError(f"its motion holds something that is not a number ({error})") from error
    if values.size != frames * columns or columns == 0:
        raise UserError(
            f"it promises {frames:g} frames of {columns} channels and holds {values.size} values; is it cut short?"
        )
    if not (np.abs(values) <= _LARGEST).all():
        raise UserError(f"its motion holds values that are not finite, or over {_LARGEST:g}")
    return values.reshape(int(frames), columns), frame_time
