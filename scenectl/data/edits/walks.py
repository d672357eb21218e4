"""Walks edited: crouched, ducking, side-stepping, reaching (`scenectl.data.edits.limbs`)."""

from __future__ import annotations

import math
import random
from dataclasses import replace

import torch

from scenectl.data.corpus import Clip
from scenectl.data.edits.footfalls import calmed, feet_shift, flattened, places, walk_of
from scenectl.data.edits.handling import Place, arm_length, bowed, led, standing, walks
from scenectl.data.edits.limbs import ARMS, SIDES, axes, bump, chest, edited, in_turn, lowered, with_legs
from scenectl.data.edits.timing import smooth
from scenectl.data.features import canonicalise
from scenectl.data.sentences import also

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
    hows = ["ducks under something", "ducks down on the way", "ducks under a bar"]
    how = draw.choice(hows)
    copy = edited(clip, "duck", "", lowered(clip.joints, depth * envelope, 2.0 * depth * envelope))
    doing = [f"{who} {how}." for who, how in zip(("a person", "someone", "the person"), hows, strict=True)]
    texts = tuple(also(text, how) for text in clip.captions)
    return copy and replace(copy, captions=texts, acts=in_turn(clip, doing, envelope))


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


REACHES = {
    "up": ((0.05, 0.42), (0.25, 0.46), (0.0, 0.16), (0.0, 0.06)),
    "forward": ((-0.2, 0.05), (0.4, 0.5), (-0.05, 0.15), (0.0, 0.3)),
    "down": ((-0.5, -0.35), (0.25, 0.4), (-0.05, 0.15), (0.35, 0.7)),
    "to the": ((-0.15, 0.3), (0.0, 0.2), (0.35, 0.48), (0.0, 0.1)),
}
"""Where hands reach: up, forward and outwards of the shoulder (m), and by how much the trunk bows (rad). HDM05's
people who grab high (17 training clips) have their wrists 0.05 to 0.19 m up, 0.37 to 0.48 forward, 0.05 to 0.16 out."""


def reaching(clip: Clip, draw: random.Random) -> Clip | None:
    """A walk, or a stretch in which the person stands, with one hand stretched out to something for a moment."""
    moves = walks(clip)
    stop = None if moves else standing(clip, draw, draw.randint(40, 70))
    if not moves and stop is None:
        return None
    joints = stop.joints if stop else clip.joints
    envelope = bump(joints, draw, hold=(0.25, 0.9) if moves else (0.2, 0.5))
    if envelope is None:
        return None
    if not moves and draw.random() < 0.2:  # stays there
        envelope = torch.cummax(envelope, 0).values
    side, where = draw.choice(SIDES), draw.choice([*REACHES])
    up, ahead, out, bow = (draw.uniform(*span) for span in REACHES[where])
    sign = 1.0 if side == "left" else -1.0
    body = bowed(joints, envelope, 0.15 * bow, bow, sign * draw.uniform(0.0, 0.25) * (1 if where == "to the" else -1))
    left, forward = axes(body)
    offset = sign * out * left + up * left.new_tensor([0.0, 1.0, 0.0]) + ahead * forward
    far = draw.uniform(0.85, 0.98) * arm_length(side)
    goal = body[:, ARMS[side][0]] + offset * far / offset.norm(dim=-1, keepdim=True)
    elbow = torch.stack([sign * left, *chest(body)[1:]], -1) @ left.new_tensor([0.8, -0.5, -0.4])
    copy = edited(clip, "reach", "", led(body, side, [(Place(goal, elbow), envelope)]))
    if where == "to the":
        where = f"to the {side}"
    stretched = f"out {where}" if where.startswith("to the") else where
    hows = [f"reaches {where} with the {side} hand", f"stretches the {side} arm {stretched}"]
    hows.append(f"reaches {where} to {draw.choice(['grab', 'touch', 'take', 'get'])} something with the {side} hand")
    if moves:
        texts = tuple(also(text, how) for text in clip.captions for how in draw.sample(hows, 2))
    else:
        texts = tuple(f"{who} {how}." for who in ("a person", "someone") for how in draw.sample(hows, 2))
    label = f"{clip.label}, {'reach' if moves else 'reach standing'}"
    doing = [f"{who} {how}." for who, how in zip(("a person", "someone", "the person"), hows, strict=True)]
    acts = in_turn(clip, doing, envelope) if moves else ()
    return copy and replace(copy, captions=texts, label=label, acts=acts)
