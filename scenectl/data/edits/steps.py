"""Stairs made of straight walks: every foot on a tread of its own, and the body led up or down with them."""

from __future__ import annotations

import random
from collections.abc import Sequence
from dataclasses import dataclass, replace

import torch
from jaxtyping import Float
from torch import Tensor

from scenectl.data.corpus import Clip
from scenectl.data.edits.footfalls import ANKLE, Fall, feet_shift, places, walk_of
from scenectl.data.edits.limbs import LEGS, axes, edited, pitched, with_legs
from scenectl.data.edits.timing import eased, smooth
from scenectl.data.features import canonicalise

RISE = (0.10, 0.22)
"""Metres from tread to tread: from a kerb's 0.1 to the most that building codes allow in dwellings (0.22, DIN 18065 and
UK Approved Document K)."""
TREAD = (0.30, 0.38)
"""Metres from edge to edge: a foot (0.26) with room before and behind it."""
HEEL, TOES = 0.06, 0.067
"""Metres from the ankle back to the end of the heel (with the 0.13 from ball to ankle and the toes a foot of 0.26) and
from the ball to the tip of the toes (`scenectl.measures.believability.evidence.TOES`)."""
CLEAR = 0.015
"""Metres by which a foot passes over an edge at least."""
SOLE = 0.055
"""Metres from the ankle down to where a flat foot's ball is: 0.047 in HumanML3D's people, with the ankle's spread."""
LAG = 0.4
"""Share of a rise by which the body stays below the mean of both feet: it climbs over the foot that stands."""
STRAIGHT = 0.985
"""Largest share of a leg's length on stairs: a knee straightened further snaps from frame to frame."""


@dataclass(frozen=True)
class Stairs:
    """Treads along z: from `edges[i]` on the ground is `levels[i + 1]` high, `levels[0]` before the first."""

    edges: Float[Tensor, " E"]
    levels: Float[Tensor, " L"]

    def height(self, z: Float[Tensor, "*b"]) -> Float[Tensor, "*b"]:
        """Height of the ground at places."""
        return self.levels[torch.searchsorted(self.edges, z.contiguous(), right=True)]


def climbing(clip: Clip, draw: random.Random) -> Clip | None:
    """A straight walk led up or down a flight of steps, with a landing before and after."""
    found = climbed(clip, draw)
    return found and replace(found[0], joints=canonicalise(found[0].joints))


def climbed(clip: Clip, draw: random.Random) -> tuple[Clip, Stairs] | None:
    """The clip on its steps and where they are, both in the frame of the recording; None where it does not suit."""
    pelvis = clip.joints[:, 0]
    travel, sideways = float(pelvis[-1, 2] - pelvis[0, 2]), float(pelvis[:, 0].abs().max())
    up, rise, tread = draw.random() < 0.5, draw.uniform(*RISE), draw.uniform(*TREAD)
    walk = walk_of(clip, draw.uniform(1.15, 1.6), draw.randint(8, 18))
    if travel < 1.0 or sideways > 0.35 * travel or walk is None:
        return None
    slowed, falls = walk
    # Two or more footfalls stand before the steps when the clip begins, and may follow them on the other landing.
    count = draw.randint(2, len(falls) - 2)
    first = draw.randint(2, min(4, len(falls) - count))
    steps = [min(max(i - first + 1, 0), count) for i in range(len(falls))]
    joints = slowed.joints
    at = places(joints, falls)
    if float(at[:, 2].diff().min()) < 0.2:  # a walk in which a foot is not put before the other
        return None
    target, stairs = _flight(joints, falls, at, steps, tread, rise if up else -rise)
    made = _led(joints, falls, target - at * at.new_tensor([0.0, 0.0, 1.0]), stairs, up)
    if made is None:
        return None
    lowest = stairs.levels.min()
    copy = edited(clip, "climb", "", made - made.new_tensor([0.0, 1.0, 0.0]) * lowest)
    if copy is None:
        return None
    return replace(copy, captions=_said(up, count, draw), acts=()), replace(stairs, levels=stairs.levels - lowest)


def _flight(
    joints: Float[Tensor, "T 22 3"],
    falls: Sequence[Fall],
    at: Float[Tensor, "N 3"],
    steps: Sequence[int],
    tread: float,
    rise: float,
) -> tuple[Float[Tensor, "N 3"], Stairs]:
    """Where every footfall goes (z of the ball, and height), and the steps between them."""
    z, level = [float(at[0, 2])], [0.0]
    for i in range(1, len(falls)):
        own = float(at[i, 2] - at[i - 1, 2])
        stepping = steps[i] != steps[i - 1]
        # Strides shorten towards the steps and are a tread long on them.
        z.append(z[-1] + (tread if stepping else min(own, 0.45)))
        level.append(rise * steps[i])
    edges = []
    for i in range(1, len(falls)):
        if steps[i] != steps[i - 1]:
            toes = z[i - 1] + TOES
            fall = falls[i]
            middle = (fall.begin + fall.end - 1) // 2
            ball, ankle = joints[middle, LEGS[fall.side][3]], joints[middle, LEGS[fall.side][2]]
            heel = z[i] - float(ball[2] - ankle[2]) - HEEL
            edges.append((toes + heel) / 2)
    target = at.new_tensor([[0.0, y, forward] for y, forward in zip(level, z, strict=True)])
    return target, Stairs(at.new_tensor(edges), at.new_tensor(sorted(set(level), reverse=rise < 0)))


def _led(
    joints: Float[Tensor, "T 22 3"],
    falls: Sequence[Fall],
    shifts: Float[Tensor, "N 3"],
    stairs: Stairs,
    up: bool,
) -> Float[Tensor, "T 22 3"] | None:
    """The walk on its new footfalls; None where a foot would go through a step."""
    feet = feet_shift(joints, falls, shifts)
    body = smooth(feet.mean(1), 4.0)
    for side in range(len(LEGS)):
        own = [i for i, fall in enumerate(falls) if fall.side == side]
        for i, j in zip(own[:-1], own[1:], strict=True):
            if float(shifts[i, 1]) != float(shifts[j, 1]):
                swing = slice(falls[i].end - 1, falls[j].begin + 1)
                over = _over(joints[swing][:, LEGS[side][2:]], shifts[i], shifts[j], stairs)
                if over is None:
                    return None
                feet[swing, side] = over
    rise = float(stairs.levels.diff().abs().mean())
    on_steps = smooth((feet[:, 0, 1] - feet[:, 1, 1]).abs().clamp_max(rise) / rise, 5.0)
    body[:, 1] -= LAG * rise * on_steps
    left, _ = axes(joints)
    leant = pitched(joints, left, (0.16 if up else 0.04) * on_steps)
    return with_legs(leant, body, feet, STRAIGHT)


def _over(
    foot: Float[Tensor, "T 2 3"], start: Float[Tensor, "3"], end: Float[Tensor, "3"], stairs: Stairs
) -> Float[Tensor, "T 3"] | None:
    """Shifts that lead a swinging foot (ankle, ball) over edges: up and then forward, or forward and then down."""
    time = torch.linspace(0, 1, len(foot), device=foot.device)
    up = bool(end[1] > start[1])
    ball = foot[:, 1]
    for lift in (0.0, 0.02, 0.04, 0.06, 0.08, 0.1, 0.12):
        for wait in (0.1, 0.2, 0.3, 0.4):
            onwards = eased((time - wait) / (0.97 - wait)) if up else eased((time - 0.03) / (0.97 - wait))
            rising = eased(time / 0.6) if up else eased((time - 0.4) / 0.6)
            shift = torch.lerp(ball[0] + start, ball[-1] + end, onwards[:, None]) - ball
            shift[:, 1] = torch.lerp(start[1], end[1], rising) + lift * (4 * time * (1 - time)) ** 1.5
            if _clear(foot + shift[:, None], stairs, (float(start[1]), float(end[1]))):
                return shift
    return None


def _clear(foot: Float[Tensor, "T 2 3"], stairs: Stairs, ends: tuple[float, float]) -> bool:
    """Whether a foot (ankle, ball) passes over every step from heel to toes; `ends`: heights it leaves and lands on."""
    ankle, ball = foot[1:-1].unbind(1)
    along = torch.linspace(0, 1, 8, device=foot.device)
    z = torch.lerp((ankle[:, 2] - HEEL)[:, None], (ball[:, 2] + TOES)[:, None], along)
    # Feet that stand with the ankle lower than most have as much less below it.
    sunk = min(SOLE, float((foot[[0, -1], 0, 1] - foot[[0, -1], 1, 1]).min()) + SOLE - ANKLE)
    sole = torch.lerp((ankle[:, 1] - sunk)[:, None], ball[:, 1, None], along)
    ground = stairs.height(z)
    own = ((ground - ends[0]).abs() < 1e-3) | ((ground - ends[1]).abs() < 1e-3)
    return bool((sole - ground - torch.where(own, -CLEAR, CLEAR) > 0).all())


def _said(up: bool, count: int, draw: random.Random) -> tuple[str, ...]:
    """Sentences for a flight of so many steps."""
    way = "up" if up else "down"
    verb = draw.choice(["climbs", "goes up", "steps up"] if up else ["descends", "goes down", "steps down"])
    numbers = ("two", "three", "four", "five", "six", "seven", "eight", "nine", "ten", "eleven", "twelve")
    number = numbers[count - 2] if count - 2 < len(numbers) else str(count)
    texts = [
        f"a person walks {way} the stairs.",
        f"someone {verb} a staircase.",
        f"a person {verb} {number} steps.",
        f"a person takes {number} stairs {way}.",
        f"a person walks {way} a flight of stairs.",
        f"someone walks forward and {verb} the steps.",
        f"a person {'ascends' if up else 'descends'} some steps.",
        f"walking {way} {number} steps, a person gets to the {'top' if up else 'bottom'}.",
    ]
    return tuple(draw.sample(texts, 4))
