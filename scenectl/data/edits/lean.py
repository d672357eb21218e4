"""Standing people who lean: over a table, back against a wall, to a side with a hand on a wall or counter."""

from __future__ import annotations

import random
from dataclasses import replace

import torch
from jaxtyping import Float
from torch import Tensor

from scenectl.data.corpus import Clip
from scenectl.data.edits.footfalls import smooth
from scenectl.data.edits.limbs import (
    ARMS,
    LEGS,
    SIDES,
    axes,
    bump,
    edited,
    lingered,
    pitched,
    rotate,
    with_arm,
    with_legs,
)
from scenectl.data.features import FPS, canonicalise
from scenes.motion.skeleton import HUMANML3D

QUIET = 0.25
"""m/s; feet and pelvis of a standing person stay below it, and hands below twice that."""
SHORTEST = 24
"""Frames of standing that are enough to lean in: they are played back and forth."""
TABLE = (0.70, 0.95)
"""Heights (m) of tables and counters that hands rest on."""
_TRUNK = [j for j in range(len(HUMANML3D.names)) if j not in (0, *LEGS[0], *LEGS[1])]


def leaning(clip: Clip, draw: random.Random) -> Clip | None:
    """A stretch of standing still in which the person leans for a while; None where the clip shows no such stretch."""
    still = _standing(clip.joints)
    if still is None:
        return None
    joints = lingered(clip.joints[still], draw.randint(int(3 * FPS), int(7 * FPS)), draw.random())
    envelope = bump(joints, draw, hold=(1.0, 4.0))
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
    fine &= (pose[:, feet, 1] < 0.08).all(1) & (pose[:, 0, 1] > 0.82)
    fine &= (pose[:, wrists, 1] < pose[:, :1, 1] + 0.2).all(1)
    left, _ = axes(pose)
    fine &= ((pose[:, HUMANML3D.index("neck")] - pose[:, 0])[:, [0, 2]].norm(dim=-1) < 0.15) & (left[:, 1].abs() < 0.2)
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
    height = draw.uniform(*TABLE)
    pitch = 1.7 * (1.3 - height) * draw.uniform(0.8, 1.05)
    back = -0.16 * pitch * envelope[:, None] * forward - envelope[:, None] * joints.new_tensor([0.0, 0.02, 0.0])
    led = with_legs(pitched(joints, left, pitch * envelope), back, joints.new_zeros(len(joints), 2, 3))
    reach, apart = draw.uniform(0.12, 0.28), draw.uniform(0.0, 0.1)
    for side in SIDES:
        shoulder = led[:, ARMS[side][0]]
        outwards = apart if side == "left" else -apart
        drop = height + 0.05 - shoulder[:, 1]
        offset = torch.stack([drop.new_full(drop.shape, outwards), drop, drop.new_full(drop.shape, reach)], -1)
        led = with_arm(led, side, offset, envelope)
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
    shoulder = led[:, ARMS[side][0]]
    height = draw.uniform(1.1, 1.45) if wall else draw.uniform(0.9, 1.05)
    drop = height - shoulder[:, 1]
    aside = draw.uniform(0.38, 0.46) if wall else draw.uniform(0.22, 0.32)
    ones = torch.ones_like(drop)
    offset = torch.stack([sign * aside * ones, drop, draw.uniform(0.0, 0.15) * ones], -1)
    what = "a wall" if wall else "a counter"
    return with_arm(led, side, offset, envelope), [
        f"a person leans to the {side} with one hand on {what}.",
        f"someone leans on {what} with the {side} hand.",
        f"a person puts the {side} hand on {what} and leans against it.",
        f"standing, a person leans sideways to the {side}, resting on one hand.",
        f"the person leans on the {side} hand.",
    ]
