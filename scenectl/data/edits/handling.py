"""What edits with hands are made of: people who stand long enough, hands led from place to place, ways to hold things.

A person stands in a stretch of a recording; held, it is walked through back and forth, so it goes on and never freezes.
A hand is led by `Place`s one after another: where it is anyway, where a thing lies, where a thing is held.
"""

from __future__ import annotations

import math
import random
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Float
from scipy.ndimage import gaussian_filter1d, label
from scipy.signal import savgol_filter
from torch import Tensor

from scenectl.data.corpus import Clip
from scenectl.data.edits.limbs import (
    ARMS,
    SIDES,
    STRAIGHT,
    axes,
    chest,
    clear_of_trunk,
    elbow_side,
    perpendicular,
    pitched,
    turned_trunk,
    with_hand,
    with_legs,
)
from scenectl.data.edits.timing import minimum_jerk
from scenectl.data.features import FPS, canonicalise, to_uniform_skeleton
from scenectl.data.kinds import kind_of
from scenes.motion.skeleton import HUMANML3D

STILL = 0.3
"""m/s: feet and pelvis of a person who stands are slower, and the wrists than twice that."""
SHORTEST = 10
"""Frames a person must stand for a stretch to be held longer."""
LONGEST = 190
"""Frames (9.5 s) of an edit that stands."""
POSED = frozenset(["dance", "acrobatics", "mimicry", "fight", "climb"])
"""Kinds of motion in which who keeps still strikes a pose."""
REACH = 0.94
"""Share of the arm's length at which hands take things: an arm that takes something is not quite straight."""

Side = str
Joints = Float[Tensor, "T 22 3"]
Track = Float[Tensor, " T"]


def smooth(t: Tensor, begin: int, end: int) -> Tensor:
    """0 before `begin`, 1 after `end`, with the least jerk between."""
    return minimum_jerk((t - begin) / (end - begin))


def stands(joints: Joints) -> list[tuple[int, int]]:
    """Stretches (frames, up to and without the end) in which a person stands upright with hanging arms, both feet
    planted."""
    speed = joints.diff(dim=0).norm(dim=-1) * FPS
    speed = torch.cat([speed, speed[-1:]])
    pelvis, head = joints[:, 0], joints[:, 15]
    legs = joints[:, 0, 1] - joints[:, [7, 8], 1].amax(1)
    quiet = (speed[:, [0, 7, 8, 10, 11]] < STILL).all(1) & (speed[:, [20, 21]] < 2 * STILL).all(1)
    upright = (head[:, 1] - pelvis[:, 1] > 0.56) & (legs > 0.7)
    hanging = (joints[:, [20, 21], 1] < joints[:, [16, 17], 1] - 0.3).all(1)
    level = ((joints[:, 7] - joints[:, 8]).norm(dim=-1) < 0.5) & (joints[:, [7, 8, 10, 11], 1].amax(1) < 0.2)
    found, count = label((quiet & upright & hanging & level).cpu().numpy())
    edges = [np.flatnonzero(found == i + 1)[[0, -1]] for i in range(count)]
    return [(int(a), int(b) + 1) for a, b in edges if b + 1 - a >= SHORTEST]


@dataclass(frozen=True)
class Stop:
    """A motion in which a person stands in some stretches (frames), and may walk before, between and after."""

    joints: Joints
    stands: tuple[tuple[int, int], ...]


def walks(clip: Clip) -> bool:
    """Whether it is a clip of a person who walks."""
    return kind_of(clip).removeprefix("bandai: ").split("-")[0] in ("walk", "turn")


def standing(clip: Clip, draw: random.Random, hold: int) -> Stop | None:
    """A stretch in which the person stands, for `hold` frames; None where the clip has none."""
    found = stands(clip.joints) if kind_of(clip) not in POSED else []
    return _held(clip, [draw.choice(found)], [hold], 0, 0) if found else None


def stopping(clip: Clip, draw: random.Random, hold: int) -> Stop | None:
    """The same with the walk before and after; None where there is no walk."""
    found = [(a, b) for a, b in stands(clip.joints) if _travels(clip, 0, a) or _travels(clip, b, clip.frames)]
    if not found:
        return None
    begin, end = draw.choice(found)
    spare = max(0, LONGEST - hold)
    before = min(begin, round(draw.uniform(0.35, 0.65) * spare))
    after = min(clip.frames - end, spare - before)
    before, after = before * _travels(clip, begin - before, begin), after * _travels(clip, end, end + after)
    return _held(clip, [(begin, end)], [hold], before, after) if before or after else None


def stopping_twice(clip: Clip, draw: random.Random, holds: tuple[int, int]) -> Stop | None:
    """A walk from one stretch in which the person stands to the next; None where none is short enough."""
    found = stands(clip.joints)
    pairs = [
        (a, b)
        for a, b in zip(found, found[1:], strict=False)
        if b[0] - a[1] + sum(holds) <= LONGEST and _travels(clip, a[1], b[0])
    ]
    return _held(clip, draw.choice(pairs), holds, 0, 0) if pairs else None


def _travels(clip: Clip, begin: int, end: int) -> bool:
    """Whether the person walks in those frames."""
    path = clip.joints[begin:end, 0, [0, 2]].diff(dim=0).norm(dim=-1).sum()
    return walks(clip) and bool(path > 0.6)


def _held(clip: Clip, stretches: Sequence[tuple[int, int]], holds: Sequence[int], before: int, after: int) -> Stop:
    """Stretches shown back and forth for so many frames each, with what lies between, `before` and `after`."""
    at, where = [np.arange(stretches[0][0] - before, stretches[0][0])], []
    for i, ((begin, end), hold) in enumerate(zip(stretches, holds, strict=True)):
        if end - begin > hold and (not before or i + 1 < len(holds)):
            begin = end - hold
        elif end - begin > hold:
            end, after = begin + hold, 0
        if i:
            at.append(np.arange(stretches[i - 1][1], begin))
        first = sum(map(len, at))
        where.append((first, first + hold))
        last = end - 1 - begin
        rounds = max(1, 2 * round((0.7 * hold / last - 1) / 2) + 1)
        way = np.linspace(0, rounds * last, hold)
        at.append(begin + last - np.abs(np.mod(way, 2 * last) - last))
    at.append(np.arange(stretches[-1][1], stretches[-1][1] + after))
    frames = torch.as_tensor(_eased(np.concatenate(at), before > 0, after > 0))
    low = frames.floor().long().clamp(0, clip.frames - 2)
    joints = torch.lerp(clip.joints[low], clip.joints[low + 1], (frames - low)[:, None, None].to(clip.joints))
    return Stop(canonicalise(to_uniform_skeleton(joints)), tuple(where))


def _eased(at: np.ndarray, walks_in: bool, walks_out: bool) -> np.ndarray:
    """The same frames with time that turns round smoothly, at full speed where the motion goes on beyond."""
    lead = np.arange(12, 0, -1.0)
    padded = np.concatenate([at[0] - lead * walks_in, at, at[-1] + lead[::-1] * walks_out])
    return np.clip(gaussian_filter1d(padded, 2.5)[12:-12], at.min(), at.max())


@dataclass(frozen=True)
class Place:
    """Where a hand is led.

    Attributes:
        wrist: in the world, ``[T, 3]``; None where the recording has it.
        elbow: which way the elbow points, ``[T, 3]``; None likewise.
    """

    wrist: Float[Tensor, "T 3"] | None = None
    elbow: Float[Tensor, "T 3"] | None = None


FREE = Place()
"""The arm as recorded."""


def led(joints: Joints, side: Side, places: Sequence[tuple[Place, Track]]) -> Joints:
    """The arm led through places, each with how far the hand has come to it from the one before."""
    led_away = torch.zeros(len(joints))
    for place, share in places:
        led_away = torch.lerp(led_away, torch.full_like(share, float(place.wrist is not None)), share)
    shoulder, free = joints[:, ARMS[side][0]], joints[:, ARMS[side][2]]
    now = free
    for place, share in places:
        now = torch.lerp(now, free if place.wrist is None else place.wrist, share[:, None])
    now = clear_of_trunk(joints, now)
    own = _along(elbow_side(joints, side, led_away), free - shoulder, now - shoulder)
    pole = own
    for place, share in places:
        its = own if place.elbow is None else place.elbow
        if place.wrist is not None and place.elbow is not None:
            its = _along(place.elbow, place.wrist - shoulder, now - shoulder)
        pole = torch.lerp(pole, its, share[:, None])
    # Between opposite sides an elbow would swing round in a frame.
    calm = pole.new_tensor(gaussian_filter1d(pole.cpu().numpy(), 2.5, axis=0))
    return with_hand(joints, side, now, torch.lerp(pole, calm, led_away[:, None]))


def _along(pole: Float[Tensor, "T 3"], arm: Float[Tensor, "T 3"], now: Float[Tensor, "T 3"]) -> Float[Tensor, "T 3"]:
    """Which way the elbow of one arm points, turned with that arm to where it is now; unit vectors."""
    a, b = (v / v.norm(dim=-1, keepdim=True).clamp_min(1e-6) for v in (arm, now))
    pole = perpendicular(pole, a)
    pole = pole / pole.norm(dim=-1, keepdim=True).clamp_min(1e-6)
    return pole - (b * pole).sum(-1, keepdim=True) / (1 + (a * b).sum(-1, keepdim=True)).clamp_min(0.05) * (a + b)


def bowed(joints: Joints, share: Track, depth: float, pitch: float, turn: float) -> Joints:
    """Knees bent by `depth` (m), the trunk by `pitch` and turned to the left by `turn` (rad), over the same feet."""
    left, forward = axes(joints)
    leant = turned_trunk(pitched(joints, left, pitch * share), left.new_tensor([0.0, 1.0, 0.0]), turn * share)
    # Seat and hips go back as the chest comes forward, or the body would topple.
    back = (0.25 * depth + 0.1 * math.sin(pitch)) * share
    down = left.new_tensor([0.0, 1.0, 0.0]) * (depth * share)[:, None]
    return with_legs(leant, -down - back[:, None] * forward, joints.new_zeros(len(joints), 2, 3))


def bow_to(
    pose: Float[Tensor, "22 3"], goals: dict[Side, Float[Tensor, "3"]], squat: float, turn: float
) -> tuple[float, float] | None:
    """The least depth (m) and pitch (rad) by which the hands come to their goals; None where they don't.

    `squat` is 0 for a person who bends the back and 1 for one who bends the knees.
    """
    amount = torch.linspace(0.0, 1.0, 41)
    depth, pitch = amount * (0.1 + 0.45 * squat), amount * (1.5 - 0.3 * squat)
    still = pose.expand(len(amount), 22, 3)
    left, forward = axes(still)
    turned = turned_trunk(
        pitched(still, left, pitch), left.new_tensor([0.0, 1.0, 0.0]), turn * amount.clamp_max(0.2) * 5
    )
    back = 0.25 * depth + 0.1 * pitch.sin()
    moved = turned - back[:, None, None] * forward[:, None] - depth[:, None, None] * left.new_tensor([0.0, 1.0, 0.0])
    far = torch.stack(
        [(goal - moved[:, ARMS[side][0]]).norm(dim=-1) / arm_length(side) for side, goal in goals.items()]
    )
    near = (far.amax(0) < REACH).nonzero()
    return (float(depth[near[0]]), float(pitch[near[0]])) if len(near) else None


def arm_length(side: Side) -> float:
    """How far (m) a wrist comes from its shoulder."""
    _, elbow, wrist = ARMS[side]
    return STRAIGHT * float(HUMANML3D.bone_lengths[elbow] + HUMANML3D.bone_lengths[wrist])


@dataclass(frozen=True)
class Hold:
    """A way to hold a thing.

    Attributes:
        sides: the hands.
        at: of the wrists' middle (or the wrist) from the hip's height on the spine to the left (or outwards, for one
            hand), up and forward, m.
        width: between the wrists, m.
        elbow: which way elbows point: outwards, up and forward of the chest.
        where: in words.
    """

    sides: tuple[Side, ...]
    at: tuple[float, float, float]
    width: float
    elbow: tuple[float, float, float]
    where: str


def any_hold(draw: random.Random, sides: tuple[Side, ...] | None = None) -> Hold:
    """A way to hold a thing, drawn."""
    u: Callable[[float, float], float] = draw.uniform
    sides = sides or draw.choice([SIDES, SIDES, ("left",), ("right",)])
    if len(sides) == 2:
        where, up, ahead = draw.choice(
            [
                ("belly", u(0.0, 0.15), u(0.26, 0.36)),
                ("chest", u(0.18, 0.3), u(0.26, 0.34)),
                ("low", u(-0.16, -0.04), u(0.2, 0.28)),
            ]
        )
        return Hold(sides, (0.0, up, ahead), u(0.2, 0.48), (u(0.4, 0.9), -0.7, -0.5), where)
    where, at, elbow = draw.choice(
        [
            ("side", (u(0.24, 0.34), u(-0.34, -0.26), u(-0.03, 0.08)), (0.4, 0.0, -0.9)),
            ("side", (u(0.24, 0.34), u(-0.34, -0.26), u(-0.03, 0.08)), (0.4, 0.0, -0.9)),
            ("belly", (u(0.05, 0.2), u(0.04, 0.16), u(0.22, 0.32)), (0.6, -0.6, -0.6)),
            ("shoulder", (u(0.16, 0.22), u(0.42, 0.5), u(0.14, 0.2)), (0.3, -0.7, 0.7)),
        ]
    )
    return Hold(sides, at, 0.0, elbow, where)


def holding(joints: Joints, before: Joints, hold: Hold, swing: float) -> dict[Side, Place]:
    """Where the hands are that hold a thing: in front of a body that moves, with a part of the swing of `before`.

    Args:
        joints: the body that holds.
        before: the same as recorded, with free arms.
        hold: the way.
        swing: share of the arms' own swing that is left.
    """
    left, up, forward = (_calm(axis) for axis in chest(joints))
    spine = _calm(joints[:, 0] + 0.5 * (joints[:, 6] - joints[:, 0]))
    swings = {side: _swing(before, side) for side in hold.sides}
    own = sum(swings.values(), start=torch.zeros_like(spine)) / len(swings)
    places = {}
    for side in hold.sides:
        out = left if side == "left" else -left
        aside = hold.at[0] * (out if len(hold.sides) == 1 else left) + 0.5 * hold.width * out
        wrist = spine + aside + hold.at[1] * up + hold.at[2] * forward + swing * own
        elbow = torch.stack([out, *chest(joints)[1:]], -1) @ joints.new_tensor(hold.elbow)
        places[side] = Place(wrist, elbow / elbow.norm(dim=-1, keepdim=True).clamp_min(1e-6))
    return places


def _calm(track: Float[Tensor, "T 3"]) -> Float[Tensor, "T 3"]:
    """Without what shakes faster than a held thing does (low pass of about 2 Hz, without lag)."""
    if len(track) < 9:
        return track
    return track.new_tensor(savgol_filter(track.cpu().numpy(), 9, 2, axis=0))


def _swing(joints: Joints, side: Side) -> Float[Tensor, "T 3"]:
    shoulder, _, wrist = ARMS[side]
    arm = joints[:, wrist] - joints[:, shoulder]
    slow = gaussian_filter1d(arm.cpu().numpy(), 0.6 * FPS, axis=0)
    return _calm(arm - arm.new_tensor(slow))


SUBJECTS = ("a person", "a person", "someone")


def thing_for(hold: Hold, draw: random.Random) -> str:
    """Something that people hold this way."""
    if len(hold.sides) == 2:
        return draw.choice(
            ["a box", "a box", "a crate", "a heavy box", "something", "a basket", "an object", "a parcel"]
        )
    things = {
        "side": ["a bucket", "a bag", "a suitcase", "something", "an object"],
        "belly": ["a cup", "a bottle", "a book", "something", "an object", "a small box"],
        "shoulder": ["a sack", "a box", "a beam", "something"],
    }
    return draw.choice(things[hold.where])
