"""Standing people who lean: over a table, back against a wall, to a side with a hand on a wall or counter."""

from __future__ import annotations

import random
from dataclasses import replace

import torch
from jaxtyping import Float
from torch import Tensor

from scenectl.data.corpus import Clip
from scenectl.data.edits.limbs import (
    ARMS,
    LEGS,
    SIDES,
    axes,
    bump,
    edited,
    pitched,
    rotate,
    with_arm,
    with_legs,
)
from scenectl.data.edits.timing import lingered, smooth
from scenectl.data.features import FPS, canonicalise
from scenes.motion.skeleton import HUMANML3D

QUIET = 0.25
"""m/s; feet and pelvis of a standing person stay below it, and hands below twice that."""
SHORTEST = 16
"""Frames of standing that are enough to lean in: they are played back and forth."""
WRIST = 0.05
"""Metres from a surface up to the wrist of a hand on it."""
TABLE = (0.65, 1.0)
"""Heights (m) of tables and counters that hands rest on."""
_TRUNK = [j for j in range(len(HUMANML3D.names)) if j not in (0, *LEGS[0], *LEGS[1])]


def leaning(clip: Clip, draw: random.Random) -> Clip | None:
    """A stretch of standing still in which the person leans for a while; None where the clip shows no such stretch."""
    still = _standing(clip.joints)
    if still is None:
        return None
    hold = draw.uniform(1.0, 4.0)
    joints = lingered(clip.joints[still], round((hold + draw.uniform(2.0, 4.0)) * FPS), draw.random())
    envelope = bump(joints, draw, hold=(hold, hold))
    if envelope is None:
        return None
    how = draw.choice([_forward, _back, _aside])
    led, texts = how(joints, envelope, draw)
    copy = edited(clip, "lean", "", led)
    return copy and replace(copy, joints=canonicalise(led), captions=tuple(draw.sample(texts, 3)), acts=())


def _standing(joints: Float[Tensor, "T 22 3"]) -> slice | None:
    """The longest stretch with both feet on the floor, an upright body and hands that hang and keep still."""
    feet = [foot for *_, foot in LEGS]
    wrists = [arm[2] for arm in ARMS.values()]
    speed = smooth(joints, 1.0).diff(dim=0).norm(dim=-1) * FPS
    fine = (speed[:, [0, *feet]] < QUIET).all(1) & (speed[:, wrists] < 2 * QUIET).all(1)
    pose = joints[1:]
    fine &= (pose[:, feet, 1] < 0.08).all(1) & (pose[:, 0, 1] > 0.86)
    fine &= (pose[:, wrists, 1] < pose[:, :1, 1] + 0.08).all(1)
    left, _ = axes(pose)
    fine &= ((pose[:, HUMANML3D.index("neck")] - pose[:, 0])[:, [0, 2]].norm(dim=-1) < 0.15) & (left[:, 1].abs() < 0.2)
    apart = ((pose[:, feet[0]] - pose[:, feet[1]]) * left).sum(-1)
    fine &= (apart > 0.06) & (apart < 0.45)
    for hip, _, ankle, _ in LEGS:
        fine &= (pose[:, hip] - pose[:, ankle]).norm(dim=-1) > 0.93 * float(HUMANML3D.bone_lengths[LEGS[0][1:3]].sum())
    best, begin = slice(0, 0), 0
    for i, good in enumerate([*fine.tolist(), False]):
        if not good:
            best = max(best, slice(begin, i), key=lambda part: part.stop - part.start)
            begin = i + 1
    return best if best.stop - best.start >= SHORTEST else None


def _forward(
    joints: Float[Tensor, "T 22 3"], envelope: Float[Tensor, " T"], draw: random.Random
) -> tuple[Float[Tensor, "T 22 3"], list[str]]:
    """Both hands on something as high as a table, the trunk over it."""
    left, forward = axes(joints)
    pitch = draw.uniform(0.45, 0.95)
    back = -0.16 * pitch * envelope[:, None] * forward - envelope[:, None] * joints.new_tensor([0.0, 0.02, 0.0])
    led = with_legs(pitched(joints, left, pitch * envelope), back, joints.new_zeros(len(joints), 2, 3))
    shoulders = led[_held(envelope), [arm[0] for arm in ARMS.values()], 1].mean()
    height = min(max(float(shoulders) - WRIST - draw.uniform(0.3, 0.44), TABLE[0]), TABLE[1])
    apart = draw.uniform(0.0, 0.1)
    for side in SIDES:
        led = _propped(led, side, height, (apart, 1.0), draw.uniform(0.9, 0.97), envelope)
    return led, [
        "a person leans forward with both hands on a table.",
        "someone leans over a table and rests their hands on it.",
        "a person bends forward, leans on a counter for a while and straightens up.",
        "standing at a desk, a person leans onto it with both hands.",
        "the person leans forward on their hands.",
    ]


def _back(
    joints: Float[Tensor, "T 22 3"], envelope: Float[Tensor, " T"], draw: random.Random
) -> tuple[Float[Tensor, "T 22 3"], list[str]]:
    """Back and seat against a wall behind, the feet a little before it."""
    left, forward = axes(joints)
    way = draw.uniform(0.12, 0.2)
    shift = -envelope[:, None] * (way * forward + joints.new_tensor([0.0, 0.12 * way + draw.uniform(0.0, 0.03), 0.0]))
    led = with_legs(pitched(joints, left, -0.6 * way * envelope), shift, joints.new_zeros(len(joints), 2, 3))
    return led, [
        "a person leans back against a wall.",
        "someone leans their back on a wall and rests.",
        "a person standing rests against the wall behind them.",
        "the person leans backwards against something for a moment.",
        "a person leans against a wall, then stands up straight.",
    ]


def _aside(
    joints: Float[Tensor, "T 22 3"], envelope: Float[Tensor, " T"], draw: random.Random
) -> tuple[Float[Tensor, "T 22 3"], list[str]]:
    """The weight to one side, that hand on a wall or a counter."""
    side, wall = draw.choice(SIDES), draw.random() < 0.6
    sign = 1.0 if side == "left" else -1.0
    left, forward = axes(joints)
    shift = envelope[:, None] * (sign * draw.uniform(0.04, 0.09) * left)
    led = joints.clone()
    rotate(led, 0, _TRUNK, forward, -sign * draw.uniform(0.12, 0.22) * envelope)
    led = with_legs(led, shift, joints.new_zeros(len(joints), 2, 3))
    height = draw.uniform(1.05, 1.3) if wall else draw.uniform(0.9, 1.0)
    way = (1.0, draw.uniform(0.1, 0.4))
    what = "a wall" if wall else "a counter"
    return _propped(led, side, height, way, draw.uniform(0.88, 0.96), envelope), [
        f"a person leans to the {side} with one hand on {what}.",
        f"someone leans on {what} with the {side} hand.",
        f"a person puts the {side} hand on {what} and leans against it.",
        f"standing, a person leans sideways to the {side}, resting on one hand.",
        f"the person leans on the {side} hand.",
    ]


def _held(envelope: Float[Tensor, " T"]) -> int:
    """The frame in the middle of the hold."""
    return int((envelope > 0.999).nonzero()[:, 0].float().mean())


def _propped(
    joints: Float[Tensor, "T 22 3"],
    side: str,
    height: float,
    way: tuple[float, float],
    stretched: float,
    envelope: Float[Tensor, " T"],
) -> Float[Tensor, "T 22 3"]:
    """A hand on something `height` m high that stays where it is, in the direction `way` (outwards, forward).

    The arm is as long as `stretched` says of its whole length, or hangs down where it does not reach so low.
    """
    shoulder, elbow, wrist = ARMS[side]
    middle = _held(envelope)
    left, forward = axes(joints)
    level = (way[0] if side == "left" else -way[0]) * left[middle] + way[1] * forward[middle]
    length = stretched * float(HUMANML3D.bone_lengths[elbow] + HUMANML3D.bone_lengths[wrist])
    drop = height + WRIST - float(joints[middle, shoulder, 1])
    reach = max(length**2 - drop**2, 0.1**2) ** 0.5
    goal = joints[middle, shoulder] + reach * level / level.norm() + drop * level.new_tensor([0.0, 1.0, 0.0])
    arm = goal - joints[:, shoulder]
    offset = torch.stack([(arm * left).sum(-1), arm[:, 1], (arm * forward).sum(-1)], -1)
    return with_arm(joints, side, offset, envelope, back=1.5)
