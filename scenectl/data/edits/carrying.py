"""Clips edited so that people carry things: in one hand or both, at the side, at the belly, on the shoulder."""

from __future__ import annotations

import random
from dataclasses import replace

from scenectl.data.corpus import Clip
from scenectl.data.edits.handling import (
    SUBJECTS,
    Hold,
    Joints,
    any_hold,
    holding,
    led,
    standing,
    thing_for,
    walks,
)
from scenectl.data.edits.limbs import axes, edited, turned_trunk

SHORTEST = 40
"""Frames of a walk in which carrying shows."""


def carrying(clip: Clip, draw: random.Random) -> Clip | None:
    """A walk, or a stretch in which the person stands, with a thing in the hands all through."""
    hold = any_hold(draw)
    moves = walks(clip) and clip.frames >= SHORTEST
    if moves:
        joints = clip.joints
    elif (stop := standing(clip, draw, draw.randint(50, 120))) is not None:
        joints = stop.joints
    else:
        return None
    thing = thing_for(hold, draw)
    copy = edited(
        clip,
        "carry",
        f"{draw.choice(['while carrying', 'carrying'])} {thing} {said(hold, draw)}",
        carried(joints, hold, draw),
    )
    return copy and replace(copy, captions=carry_captions(hold, thing, draw, moves) + copy.captions * moves, acts=())


def carried(joints: Joints, hold: Hold, draw: random.Random) -> Joints:
    """The body with a thing in its hands: they are held, and the trunk leans away from the load."""
    _, forward = axes(joints)
    ones = joints.new_ones(len(joints))
    weight = draw.uniform(0.0, 1.0)
    lean = {"side": 0.07, "shoulder": -0.05}.get(hold.where, 0.0) * weight * (1 if hold.sides[0] == "left" else -1)
    body = turned_trunk(joints, forward, lean * ones) if lean else joints
    for side, place in holding(body, joints, hold, draw.uniform(0.08, 0.25)).items():
        body = led(body, side, [(place, ones)])
    return body


def carry_captions(hold: Hold, thing: str, draw: random.Random, moves: bool) -> tuple[str, ...]:
    """Sentences that say it."""
    how = said(hold, draw)
    verbs = (
        ["walks while carrying", "carries", "walks along carrying"] if moves else ["holds", "keeps holding", "carries"]
    )
    texts = [f"{draw.choice(SUBJECTS)} {verb} {thing} {how}." for verb in verbs]
    return (*texts, f"{draw.choice(SUBJECTS)} {draw.choice(verbs)} {thing}.")


def said(hold: Hold, draw: random.Random) -> str:
    """How a thing is held, in words."""
    if len(hold.sides) == 2:
        where = {"belly": "in front of the belly", "chest": "in front of the chest", "low": "low in front of the body"}
        return draw.choice(["with both hands", "with both hands", "in both arms", where[hold.where]])
    side = hold.sides[0]
    if hold.where == "shoulder":
        return draw.choice([f"on the {side} shoulder", f"on the shoulder with the {side} hand"])
    return draw.choice([f"in the {side} hand", f"with the {side} hand", "in one hand"][: 2 + (hold.where == "belly")])
