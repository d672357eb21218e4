"""Walks edited: crouched, ducking, side-stepping, reaching (`scenectl.data.edits.limbs`)."""

from __future__ import annotations

import math
import random
from dataclasses import replace

import torch

from scenectl.data.corpus import Clip
from scenectl.data.edits.limbs import LEGS, SIDES, bump, edited, lowered, with_arm, with_legs


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
    """A straight walk led off to one side while the body goes on facing forward."""
    pelvis = clip.joints[:, 0]
    travel, sideways = float(pelvis[-1, 2] - pelvis[0, 2]), float(pelvis[:, 0].abs().max())
    if travel < 1.0 or sideways > 0.35 * travel:
        return None
    angle, side = draw.uniform(0.5, math.pi / 2), draw.choice(SIDES)
    # The more sideways, the shorter: long steps would cross the legs.
    stride = 1.0 - 0.65 * math.sin(angle) ** 2
    across = stride * math.sin(angle) * (1.0 if side == "left" else -1.0)
    ground = clip.joints * clip.joints.new_tensor([0.0, 0.0, 1.0])
    shift = ground[..., 2:] * clip.joints.new_tensor([across, 0.0, stride * math.cos(angle) - 1.0])
    joints = with_legs(clip.joints, shift[:, 0], torch.stack([shift[:, foot] for *_, foot in LEGS], dim=1))
    way = f"to the {side}" if angle > 1.2 else f"diagonally to the {side}, facing forward"
    copy = edited(clip, "sidestep", "", joints)
    return copy and replace(copy, captions=(f"a person sidesteps {way}.", f"someone steps sideways {way}."))


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
