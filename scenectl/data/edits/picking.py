"""Clips edited so that people pick things up and put them down, from the floor up to a shelf of 1.2 m."""

from __future__ import annotations

import math
import random
from collections.abc import Sequence
from dataclasses import dataclass, replace

import torch
from jaxtyping import Float
from torch import Tensor

from scenectl.data.corpus import Act, Clip
from scenectl.data.edits.carrying import carry_captions
from scenectl.data.edits.handling import (
    FREE,
    SUBJECTS,
    Hold,
    Joints,
    Place,
    Track,
    any_hold,
    bow_to,
    bowed,
    holding,
    led,
    smooth,
    standing,
    stopping,
    stopping_twice,
    thing_for,
)
from scenectl.data.edits.limbs import axes, edited
from scenectl.data.features import FPS
from scenectl.data.sentences import in_one

GRASP = 0.08
"""How far (m) the wrist stays above where a thing lies: a fist's length."""
PLACES = {
    "the floor": ((0.0, 0.15), (0.3, 0.5)),
    "the ground": ((0.0, 0.15), (0.3, 0.5)),
    "a low stool": ((0.3, 0.5), (0.35, 0.55)),
    "a table": ((0.65, 0.85), (0.3, 0.5)),
    "a shelf": ((0.95, 1.2), (0.3, 0.55)),
}
"""Where things lie: in words, heights and distances ahead of the pelvis, m."""


@dataclass(frozen=True)
class Grasp:
    """Hands that go to a place and come back.

    Attributes:
        hold: how the thing is held elsewhere.
        thing, spot: what it is and where it lies, in words.
        height, ahead, aside: of the place from the floor, forward of the pelvis and to its left, m.
        squat: 0 for who bends the back, 1 for who bends the knees.
        times: frames after which the body goes there, is there, leaves and is back.
    """

    hold: Hold
    thing: str
    spot: str
    height: float
    ahead: float
    aside: float
    squat: float
    times: tuple[int, int, int, int]

    @property
    def frames(self) -> int:
        """For which the person must stand."""
        return self.times[3] + self.times[0]


def picking_up(clip: Clip, draw: random.Random) -> Clip | None:
    """The person stops, or stands, takes a thing and holds it; where the clip walks on, with it."""
    grasp = any_grasp(draw)
    return _with_stop(clip, draw, grasp, "pick up")


def putting_down(clip: Clip, draw: random.Random) -> Clip | None:
    """The person brings a thing, stops, or stands, puts it somewhere and lets go."""
    grasp = any_grasp(draw)
    return _with_stop(clip, draw, grasp, "put down")


def fetching(clip: Clip, draw: random.Random) -> Clip | None:
    """The person takes a thing from somewhere, walks with it and puts it down: a walk from one stand to another."""
    first = any_grasp(draw)
    second = replace(any_grasp(draw), hold=first.hold, thing=first.thing)
    stop = stopping_twice(clip, draw, (first.frames, second.frames))
    if stop is None:
        return None
    (a, end), (begin, _) = stop.stands
    t = torch.arange(len(stop.joints), dtype=torch.float32)
    joints = handled(
        stop.joints, [("pick up", first, t - a), ("put down", second, t - begin)], draw.uniform(0.08, 0.25)
    )
    acts = (
        Act(0, end, captions("pick up", first, draw)),
        Act(end, begin, carry_captions(first.hold, first.thing, draw, True)),
        Act(begin, len(stop.joints), captions("put down", second, draw)),
    )
    return _told(clip, "composed", joints, acts) if joints is not None else None


def any_grasp(draw: random.Random) -> Grasp:
    """A place, a thing and a way to take it, drawn."""
    hold = any_hold(draw)
    spot = draw.choice([*PLACES])
    heights, distances = PLACES[spot]
    height, ahead = draw.uniform(*heights), draw.uniform(*distances)
    out = 1.0 if hold.sides[0] == "left" else -1.0
    aside = out * draw.uniform(0.0, 0.35) if len(hold.sides) == 1 else draw.uniform(-0.15, 0.15)
    lead, low = draw.randint(5, 12), max(0.0, 1.0 - height)
    down, dwell, up = (
        draw.uniform(0.65, 0.9) + 0.45 * low,
        draw.uniform(0.2, 0.6),
        draw.uniform(0.7, 0.95) + 0.45 * low,
    )
    times = (
        lead,
        lead + round(down * FPS),
        lead + round((down + dwell) * FPS),
        lead + round((down + dwell + up) * FPS),
    )
    # Knees bend for what lies low; to a table people lean.
    squat = draw.uniform(0.4, 1.0) * min(1.0, max(0.0, (0.8 - height) / 0.5))
    return Grasp(hold, thing_for(hold, draw), spot, height, ahead, aside, squat, times)


def _with_stop(clip: Clip, draw: random.Random, grasp: Grasp, name: str) -> Clip | None:
    stop = stopping(clip, draw, grasp.frames) or standing(clip, draw, grasp.frames)
    if stop is None:
        return None
    (begin, end), frames = stop.stands[0], len(stop.joints)
    t = torch.arange(frames, dtype=torch.float32)
    joints = handled(stop.joints, [(name, grasp, t - begin)], draw.uniform(0.08, 0.25))
    if joints is None:
        return None
    with_it, without = carry_captions(grasp.hold, grasp.thing, draw, True), ("a person walks.", "someone walks.")
    before, after = (without, with_it) if name == "pick up" else (with_it, without)
    acts = [Act(0, begin, before), Act(begin, end, captions(name, grasp, draw)), Act(end, frames, after)]
    return _told(clip, name, joints, [act for act in acts if act.end > act.begin])


def _told(clip: Clip, name: str, joints: Joints, acts: Sequence[Act]) -> Clip | None:
    copy = edited(clip, name.replace(" ", "-"), "", joints)
    texts = in_one([act.captions for act in acts]) if len(acts) > 1 else acts[0].captions
    label = f"{clip.label}, {name if len(acts) < 3 else 'composed'}"
    return copy and replace(copy, captions=texts, label=label, acts=tuple(acts) if len(acts) > 1 else ())


def handled(joints: Joints, grasps: Sequence[tuple[str, Grasp, Track]], swing: float) -> Joints | None:
    """A body that stands while it takes and puts down things; None where it does not come to one.

    Args:
        joints: the body as recorded.
        grasps: "pick up" or "put down", the place, and frames since the body began to stand for it.
        swing: share of the arms' own swing that is left while they hold a thing.
    """
    body, goals = joints, []
    for _, grasp, t in grasps:
        found = _approached(joints[int((t - grasp.times[1]).abs().argmin())], grasp)
        if found is None:
            return None
        goal, bow, turn = found
        share = smooth(t, grasp.times[0], grasp.times[1]) - smooth(t, grasp.times[2], grasp.times[3])
        body = bowed(body, share, *bow, turn)
        goals.append(goal)
    hold = grasps[0][1].hold
    held = holding(body, joints, hold, swing)
    out = body
    for side in hold.sides:
        ways: list[tuple[Place, Track]] = [(held[side], torch.ones(len(joints)))] if grasps[0][0] == "put down" else []
        for (name, grasp, t), goal in zip(grasps, goals, strict=True):
            there = Place(goal[side].expand(len(joints), 3), held[side].elbow)
            ways.append((there, smooth(t, grasp.times[0] + 1, grasp.times[1])))
            ways.append((held[side] if name == "pick up" else FREE, smooth(t, grasp.times[2], grasp.times[3] + 2)))
        out = led(out, side, ways)
    return out


def _approached(
    pose: Float[Tensor, "22 3"], grasp: Grasp
) -> tuple[dict[str, Float[Tensor, "3"]], tuple[float, float], float] | None:
    """Where the wrists go, how far the body bows (depth, pitch) and turns; people stand near enough not to bow deeper
    than what lies so high asks for."""
    turn, most = 0.6 * math.atan2(grasp.aside, grasp.ahead), min(1.5, max(0.35, 1.6 - 1.25 * grasp.height))
    for near in (1.0, 0.8, 0.65, 0.5):
        goals = spots(pose, replace(grasp, ahead=max(0.25, near * grasp.ahead), aside=near * grasp.aside))
        bow = bow_to(pose, goals, grasp.squat, turn)
        if bow is not None and bow[1] <= most:
            return goals, bow, turn
    return None


def spots(pose: Float[Tensor, "22 3"], grasp: Grasp) -> dict[str, Float[Tensor, "3"]]:
    """Where the wrists are that grasp the thing."""
    left, forward = (axis[0] for axis in axes(pose[None]))
    ground = pose[0] * pose.new_tensor([1.0, 0.0, 1.0])
    ground[1] = pose[[10, 11], 1].min() + grasp.height + GRASP
    middle = ground + grasp.ahead * forward + grasp.aside * left
    return {side: middle + 0.5 * grasp.hold.width * (1 if side == "left" else -1) * left for side in grasp.hold.sides}


def captions(name: str, grasp: Grasp, draw: random.Random) -> tuple[str, ...]:
    """Sentences that say it: with the place or without, with the hand or without."""
    low = grasp.height < 0.6
    both = len(grasp.hold.sides) == 2
    hand = " with both hands" if both else f" with the {grasp.hold.sides[0]} hand"
    bends = ["crouches and ", "squats down and "] if grasp.squat > 0.5 else ["bends down and ", "bends over and "]
    if name == "pick up":
        where = f" {draw.choice(['from', 'off'])} {grasp.spot}"
        verbs = [
            f"picks up {grasp.thing}",
            f"picks {grasp.thing} up",
            f"lifts {grasp.thing}" if low else f"takes {grasp.thing}",
        ]
    else:
        where = f" on {grasp.spot}"
        verbs = [f"puts {grasp.thing} down", f"puts {grasp.thing}", f"places {grasp.thing}", f"sets {grasp.thing} down"]
    texts = []
    for i, said in enumerate(draw.sample([*verbs, verbs[0]], 4)):
        bare = " down" if name == "put down" and not said.endswith("down") else ""
        first = draw.choice(bends) if low and i % 2 else ""
        texts.append(
            f"{draw.choice(SUBJECTS)} {first}{said}{(where, bare)[i % 3 == 2]}{(hand, '')[draw.random() < 0.4]}."
        )
    return tuple(dict.fromkeys(texts))
