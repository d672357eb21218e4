"""Walks edited: crouched, ducking, side-stepping, reaching (`scenectl.data.edits.limbs`)."""

from __future__ import annotations

import math
import random
from dataclasses import replace

import torch

from scenectl.data.corpus import Clip
from scenectl.data.edits.footfalls import calmed, feet_shift, flattened, places, walk_of
from scenectl.data.edits.limbs import SIDES, bump, edited, lowered, with_arm, with_legs
from scenectl.data.edits.timing import smooth
from scenectl.data.features import canonicalise

SIDE_STEP = (0.2, 0.5)
"""Metres from one place of a foot to its next in side-steps."""
APART = (0.14, 0.22)
"""Metres between the balls of both feet when they are beside each other; hips are 0.11 m apart."""


def crouched(clip: Clip, draw: random.Random) -> Clip | None:
    """The clip with bent knees and a trunk that leans forward, all the way through."""
    depth = draw.uniform(0.1, 0.32)
    how = draw.choice(["in a crouch", "while crouching low", "with bent knees, crouched"])
    envelope = clip.joints.new_ones(clip.frames)
    return edited(clip, "crouch", how, lowered(clip.joints, depth * envelope, 1.6 * depth * envelope))


def ducking(clip: Clip, draw: random.Random) -> Clip | None:
    """The clip with a duck somewhere in it, as under a bar."""
    depth = draw.uniform(0.2, 0.42)
    envelope = bump(clip.joints, draw, hold=(0.2, 0.7))
    if envelope is None:
        return None
    how = draw.choice(["and ducks under something", "and ducks down on the way", "ducking under a bar"])
    return edited(clip, "duck", how, lowered(clip.joints, depth * envelope, 2.0 * depth * envelope))


def sidestepping(clip: Clip, draw: random.Random) -> Clip | None:
    """A walk turned into side-steps that never cross: one foot goes out to its side, the other one is put beside it."""
    found = walk_of(clip, draw.uniform(1.0, 1.35), draw.randint(7, 16))
    if found is None or float(clip.joints[-1, 0, 2]) < 1.0 or float(clip.joints[:, 0, 0].abs().max()) > 0.7:
        return None
    walk, falls = found
    # Soles of side-steps stay flatter than those of strides, and arms quieter.
    joints = calmed(flattened(walk.joints, 0.5), 0.6)
    at = places(joints, falls)
    side, angle = draw.choice(SIDES), draw.choice([math.pi / 2, math.pi / 2, draw.uniform(0.7, 1.2)])
    leading, sign = SIDES.index(side), 1.0 if side == "left" else -1.0
    step, apart = draw.uniform(*SIDE_STEP), draw.uniform(*APART)
    out, ahead = step * math.sin(angle), step * math.cos(angle)
    # Both feet go as far with every pair of footfalls, the leading one first.
    pair = torch.tensor([sum(fall.side == leading for fall in falls[: i + 1]) for i in range(len(falls))])
    own = sign * apart / 2 * torch.tensor([1.0 if fall.side == leading else -1.0 for fall in falls])
    target = torch.stack([sign * out * pair + own, at[:, 1], ahead * pair], dim=-1).to(at)
    feet = feet_shift(joints, falls, target - at)
    body = smooth(feet.mean(1), 3.0) * feet.new_tensor([1.0, 0.0, 1.0])
    way = f"to the {side}" if angle > 1.4 else f"diagonally forward to the {side}"
    copy = edited(clip, "sidestep", "", with_legs(joints, body, feet, straight=0.99))
    texts = (
        f"a person sidesteps {way}.",
        f"someone steps sideways {way}.",
        f"a person takes side steps {way}, facing forward.",
        f"facing forward, the person moves {way} step by step.",
        f"a person shuffles {way}.",
    )
    return copy and replace(copy, joints=canonicalise(copy.joints), captions=tuple(draw.sample(texts, 3)), acts=())


def reaching(clip: Clip, draw: random.Random) -> Clip | None:
    """The clip with one hand stretched out to something for a moment."""
    side = draw.choice(SIDES)
    height, where = draw.choice([(-0.35, "down"), (0.0, "forward"), (0.45, "up")])
    envelope = bump(clip.joints, draw, hold=(0.3, 1.0))
    if envelope is None:
        return None
    outwards = draw.uniform(-0.1, 0.25) * (1.0 if side == "left" else -1.0)
    offset = clip.joints.new_tensor([outwards, height + draw.uniform(-0.12, 0.12), draw.uniform(0.3, 0.5)])
    lean = 0.35 * envelope if where == "down" else 0.1 * envelope
    bowed = lowered(clip.joints, 0.25 * lean, lean)
    how = f"and reaches {where} with the {side} hand"
    return edited(clip, "reach", how, with_arm(bowed, side, offset, envelope))
