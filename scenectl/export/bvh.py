"""BVH files in and out.

Reading: any channel order, any unit, y, z or x up, any frame rate, and the joint names of the common skeletons
(`scenectl.data.joint_names`); the result is a `Motion` of the 22 joints in metres, y up, at 20 frames a second.
Writing: rotations for animation tools, from which the joints come back.
"""

from __future__ import annotations

import math
import re
import warnings
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch
from jaxtyping import Float
from scipy.interpolate import interp1d
from scipy.spatial.transform import Rotation

from scenectl.data.joint_names import match_joints
from scenes.errors import UserError, did_you_mean
from scenes.files import atomic_write
from scenes.motion.bones import bone_lengths
from scenes.motion.frames import fine_enough
from scenes.motion.motion import Motion
from scenes.motion.rotations import rotation_between
from scenes.motion.skeleton import HUMANML3D

UNITS = {"m": 1.0, "cm": 0.01, "mm": 0.001, "in": 0.0254, "ft": 0.3048, "cmu": 0.0254 / 0.45}
"""Metres in a unit. "cmu" is the unit of CMU's Acclaim files and of the conversions that kept it (1/0.45 inch)."""

_TO_Y_UP = {
    "y": np.eye(3),
    "z": np.array([[1.0, 0, 0], [0, 0, 1], [0, -1, 0]]),  # (x, y, z) -> (x, z, -y)
    "x": np.array([[0.0, -1, 0], [1, 0, 0], [0, 0, 1]]),  # (x, y, z) -> (-y, x, z)
}
_LEG = (0.55, 1.2)  # metres from hip to ankle that a person may have, children included
_TYPICAL_LEG = 0.82
_SPINE = ("spine1", "spine2", "spine3")
_RATE_SLACK = 0.005  # 59.94 is taken as 60 frames a second: at 20 fps that is 1 ms in a second


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
                    turn = turn @ _about(axis, np.radians(column))
            places.append(places[parent + 1] + (turns[parent + 1] @ place[..., None])[..., 0])
            turns.append(turn)
        return np.stack(places[1:], axis=1)


@dataclass(frozen=True)
class BvhClip:
    """A converted file.

    Attributes:
        motion: 22 joints, metres, y up, in the file's own place and heading.
        unit: the unit stated or guessed (a key of `UNITS`).
        joints: {our joint: their joint} as mapped; joints that were placed from others are missing.
        message: one sentence on what was decided.
    """

    motion: Motion
    unit: str
    joints: dict[str, str]
    message: str


def load_bvh(
    path: str | Path,
    unit: str | None = None,
    up: str = "y",
    fps: float = 20.0,
    joints: Mapping[str, str] | None = None,
) -> Motion:
    """The motion in a BVH file; see `convert_bvh`, which also tells what was decided."""
    return convert_bvh(read_bvh(path), unit, up, fps, joints, source=str(path)).motion


def convert_bvh(
    file: BvhFile,
    unit: str | None = None,
    up: str = "y",
    fps: float = 20.0,
    joints: Mapping[str, str] | None = None,
    source: str = "",
) -> BvhClip:
    """Take a file's content to the 22 joints, metres, y up.

    Frames are dropped where the file's rate is a multiple of `fps`; otherwise positions are interpolated linearly.
    Spine joints are placed along the file's spine in the proportions of our skeleton, feet at the end sites of ankles
    and collars halfway from neck to shoulder where the file does not have them.

    Args:
        file: what `read_bvh` returned.
        unit: a key of `UNITS`; None guesses it from the length of the legs.
        up: the file's up axis, "x", "y" or "z".
        fps: frames a second wanted.
        joints: {our joint: their joint} where the names say too little.
        source: file name for messages.

    Raises:
        UserError: unknown unit or axis, joints that cannot be mapped (it names them), legs of an impossible length,
            or fewer than two frames left.
    """
    where = f"BVH file '{source}'" if source else "BVH motion"
    if up not in _TO_Y_UP:
        raise UserError(f"{where}: unknown up axis '{up}'{did_you_mean(up, _TO_Y_UP)}")
    if not (math.isfinite(fps) and fps > 0):
        raise UserError(f"{where}: {fps:g} frames a second cannot be made; state a positive number")
    try:
        found = match_joints([name for name in file.names if not name.endswith(".end")], joints)
    except UserError as error:
        raise UserError(f"{where}: {error}") from error
    real = [i for i, name in enumerate(file.names) if not name.endswith(".end")]
    found = {joint: real[index] for joint, index in found.items()}
    mapped = _map(file, file.positions(), found, where)
    unit, how = _scale(mapped, unit, where)
    placed = mapped * UNITS[unit] @ _TO_Y_UP[up].T
    resampled, kept = _resample(placed, 1.0 / file.frame_time, fps)
    if len(resampled) < 2:
        raise UserError(f"{where} has {len(file.values)} frame(s), too few for a motion at {fps:g} frames a second")
    motion = Motion(torch.from_numpy(fine_enough(resampled)), fps=fps)
    message = f"{where}: unit {unit} ({how}), up axis {up}{_axis_doubt(placed)}, {kept}"
    return BvhClip(motion, unit, {joint: file.names[index] for joint, index in found.items()}, message)


def _scale(mapped: Float[np.ndarray, "F 22 3"], unit: str | None, where: str) -> tuple[str, str]:
    """The unit, and whether it was stated or guessed."""
    chain = HUMANML3D.indices(("left_hip", "left_knee", "left_ankle"))
    leg = float(np.linalg.norm(np.diff(mapped[0, chain], axis=0), axis=-1).sum())
    if unit is not None and unit not in UNITS:
        raise UserError(f"{where}: unknown unit '{unit}'{did_you_mean(unit, UNITS)}")
    best = unit or min(UNITS, key=lambda key: abs(math.log(max(leg, 1e-9) * UNITS[key] / _TYPICAL_LEG)))
    metres = leg * UNITS[best]
    if unit is None and not _LEG[0] <= metres <= _LEG[1]:
        raise UserError(f"{where}: legs of {leg:.4g} units fit no known unit; state one of {', '.join(UNITS)}")
    if not 0.2 <= metres <= 3:
        raise UserError(f"{where}: legs would be {metres:.3g} m long in unit '{unit}'; state another unit or none")
    return best, "stated" if unit else f"guessed: legs are {metres:.2f} m"


def _axis_doubt(placed: Float[np.ndarray, "F 22 3"]) -> str:
    head, feet = HUMANML3D.index("head"), HUMANML3D.indices(("left_ankle", "right_ankle"))
    rise = np.median(placed[:, head] - placed[:, feet].mean(axis=1), axis=0)
    upright = rise[1] >= np.abs(rise).max()
    return "" if upright else " (the head is not above the feet for most of it: check the axis)"


def _resample(joints: Float[np.ndarray, "F 22 3"], rate: float, fps: float) -> tuple[Float[np.ndarray, "G 22 3"], str]:
    stride = max(round(rate / fps), 1)
    if len(joints) < 2 or abs(rate / fps / stride - 1) < _RATE_SLACK:
        kept = f", every {stride}. frame kept" if stride > 1 else ""
        return joints[::stride], f"{rate:.4g} fps{kept}"
    last = (len(joints) - 1) / rate
    at = np.arange(math.floor(last * fps + 1e-6) + 1) / fps
    between = interp1d(np.arange(len(joints)) / rate, joints, axis=0, fill_value="extrapolate")
    return between(at), f"{rate:.4g} fps, interpolated to {fps:g} fps"


def _map(
    file: BvhFile, positions: Float[np.ndarray, "F J 3"], found: dict[str, int], where: str
) -> Float[np.ndarray, "F 22 3"]:
    """The 22 joints in file units; places those that the file lacks."""
    placed = {joint: positions[:, index] for joint, index in found.items()}
    for side in ("left", "right"):
        if f"{side}_foot" not in placed:
            end = f"{file.names[found[f'{side}_ankle']]}.end"
            if end not in file.names:
                raise UserError(f"{where}: no joint found for {side}_foot; state it in `joints`")
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


def _about(axis: int, angle: Float[np.ndarray, " F"]) -> Float[np.ndarray, "F 3 3"]:
    """Rotations about a coordinate axis, radians."""
    cross, angle = np.cross(np.eye(3)[axis], np.eye(3)).T, angle[:, None, None]
    return np.eye(3) + np.sin(angle) * cross + (1 - np.cos(angle)) * (cross @ cross)  # Rodrigues


# ---------------------------------------------------------------------------------------------------------- parsing


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
        text = path.read_text(encoding="utf-8-sig", errors="replace")
    except OSError as error:
        raise UserError(f"BVH file '{path}' cannot be read: {error.strerror or error}") from error
    head, *tail = re.split(r"^\s*MOTION\s*$", text, maxsplit=1, flags=re.MULTILINE)
    if not head.lstrip().upper().startswith("HIERARCHY") or not tail:
        raise UserError(f"file '{path}' is not BVH: it lacks the sections HIERARCHY and MOTION")
    try:
        names, parents, offsets, channels = _parse_hierarchy(head)
        values, frame_time = _parse_motion(tail[0], sum(map(len, channels)))
    except UserError as error:
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
                names.append(f"{names[parent]}.end" if word.upper() == "END" else rest)
                parents.append(parent)
                offsets.append([0.0, 0.0, 0.0])
                channels.append(())
            case "{":
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
    if len(numbers) != count or not all(map(math.isfinite, numbers)):
        raise UserError(f"{what} is not {count} finite number(s)")
    return numbers


def _parse_motion(text: str, columns: int) -> tuple[np.ndarray, float]:
    start = re.match(r"\s*frames\s*:(.*)\n\s*frame time\s*:(.*)", text, re.IGNORECASE)
    if not start:
        raise UserError("its section MOTION does not begin with 'Frames:' and 'Frame Time:'")
    (frames,), (frame_time,) = _numbers(start[1], 1, "'Frames:'"), _numbers(start[2], 1, "'Frame Time:'")
    if frames < 1:
        raise UserError("it holds no frames")
    if frame_time <= 0:
        raise UserError(f"its frame time is {frame_time:g} s; it must be positive")
    try:
        values = np.array(text[start.end() :].split(), dtype=np.float64)
    except ValueError as error:
        raise UserError(f"its motion holds something that is not a number ({error})") from error
    if values.size != frames * columns or columns == 0:
        raise UserError(
            f"it promises {frames:g} frames of {columns} channels and holds {values.size} values; is it cut short?"
        )
    if not np.isfinite(values).all():
        raise UserError("its motion holds values that are not finite")
    return values.reshape(int(frames), columns), frame_time


# ---------------------------------------------------------------------------------------------------------- writing


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
