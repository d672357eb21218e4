"""Sitting down, sitting and standing up, led onto seats of other heights over the same feet."""

from __future__ import annotations

import math
import random
import re
from dataclasses import dataclass, replace

import torch
from jaxtyping import Float
from torch import Tensor

from scenectl.data.corpus import Act, Clip
from scenectl.data.edits.limbs import (
    ARMS,
    LEGS,
    SIDES,
    axes,
    edited,
    pitched,
    with_arm,
    with_legs,
)
from scenectl.data.edits.timing import eased, smooth
from scenectl.data.features import FPS, canonicalise
from scenectl.data.found.holding import held, lasting
from scenectl.data.sentences import in_one
from scenes.motion.skeleton import HUMANML3D

SEAT = (0.35, 0.60)
"""Heights (m) of seats, from a stepstool to a high chair."""
HIPS = 0.10
"""Metres from the seat up to the joints of the hips: a thigh's radius (girth 0.62 m, ANSUR II, `scenes.body`). Seated
recordings agree: hips at 0.44 m on a stepstool, at 0.53 m on a chair."""
STANDING = 0.93
"""Metres from the floor to the pelvis of a person who stands, where a clip does not show it."""
UP, DOWN = 0.04, 0.09
"""Metres below its standing height within which a pelvis stands, and beyond which it may be on a seat."""
QUIET = 0.2
"""m/s; a pelvis that moves faster is on its way to the seat or from it."""
STILL = 0.4
"""m/s up to which the fastest joint of someone moves who sits still, nine tenths of the time."""
LASTING = 0.7
"""Share of the sittings down and standings up whose seat is kept for 1 to 4 s longer, where it is kept at all."""
PLANTED = 0.08
"""Metres below which the ball of a foot is on the floor."""
SHORTEST, LONG = 6, 20
"""Frames on a seat that end a sitting down, and that are enough to play back and forth."""
_SITS = re.compile(r"\bsit")
_CHAIRS = ((0.41, ("a low stool", "a stepstool", "a low bench")), (0.52, ("a chair", "a bench", "a seat")))
_HIGH = ("a high stool", "a high chair", "a tall seat")


@dataclass(frozen=True)
class _Sitting:
    """Frames on the seat (`begin` to `end`), and of the clip around them that may be shown (`first` to `last`).

    `down` is the last frame that still stands before, `up` the first one after; None where the clip shows none.
    """

    first: int
    down: int | None
    begin: int
    end: int
    up: int | None
    last: int


def seated(clip: Clip, draw: random.Random) -> Clip | None:
    """One sitting of a clip, or its beginning or end, on a seat of another height."""
    sittings = _sittings(clip)
    if not sittings:
        return None
    chosen = draw.choice(sittings)
    kinds = ["sit down"] * (chosen.down is not None) + ["stand up"] * (chosen.up is not None)
    if len(kinds) == 2:
        kinds.append("composed")
    kinds += ["sit"] * (chosen.end - chosen.begin >= LONG)
    if not kinds:
        return None
    name = draw.choice(kinds)
    begin, end = _cut(chosen, name, draw)
    height = draw.uniform(*SEAT)
    joints, onto = _led(clip.joints, chosen, height, draw)
    joints, onto = joints[begin:end], onto[begin:end]
    if name == "sit":
        joints = held(joints, draw.randint(int(3 * FPS), int(8 * FPS)), draw, sway=0.0)
    elif name != "composed" and draw.random() < LASTING:
        on = sum(begin <= frame < end for frame in range(chosen.begin, chosen.end))
        joints = lasting(joints, on, draw.randint(20, 80), draw, first=name == "stand up", sway=0.0)
    copy = edited(clip, name, "", joints)
    if copy is None:
        return None
    copy = replace(copy, joints=canonicalise(joints), acts=())
    seat = _seat(height, draw)
    if name == "composed":
        return _in_acts(copy, onto, seat, draw)
    texts = _said(name, seat, _turns(joints), draw)
    return replace(
        copy, captions=texts if name != "sit" or _still(joints) else tuple(t for t in texts if "still" not in t)
    )


def _sittings(clip: Clip) -> list[_Sitting]:
    """Where a clip that speaks of sitting shows a person on a seat."""
    if not _SITS.search(" ".join([clip.label, *clip.captions]).lower()):
        return []
    y = clip.joints[:, 0, 1]
    if float(y.max()) > 1.2 * STANDING:  # on something higher than the floor, which the clip does not show
        return []
    stand = _standing(clip.joints)
    speed = torch.gradient(smooth(y, 1.5))[0].abs() * FPS
    low = (y < stand - DOWN) & (speed < QUIET)
    # Who shifts on the seat or looks down has not got up: only a pelvis that stands ends a sitting.
    upright = [i for i in range(clip.frames) if y[i] > stand - UP]
    borders = [-1, *upright, clip.frames]
    out: list[_Sitting] = []
    for before, after in zip(borders[:-1], borders[1:], strict=True):
        on = low[before + 1 : after].nonzero()[:, 0] + before + 1
        if len(on) >= SHORTEST and (level := y[on].median()) < stand - DOWN:
            on = on[(y[on] - level).abs() < 0.05]
            if not _supported(clip.joints[on]):
                continue
            first = out[-1].end if out else 0
            down, up = (before if before >= 0 else None), (after if after < clip.frames else None)
            out.append(_Sitting(first, down, int(on[0]), int(on[-1]) + 1, up, clip.frames))
    for i, later in enumerate(out[1:]):
        out[i] = replace(out[i], last=later.down or later.begin)
        out[i + 1] = replace(later, first=out[i].up or out[i].end)
    return out


def _supported(joints: Float[Tensor, "T 22 3"]) -> bool:
    """Whether a foot is on the floor nearly all the time: legs that dangle do not say where they would stand."""
    low = joints[:, [ball for *_, ball in LEGS], 1].amin(1) < PLANTED
    return float(low.float().mean()) > 0.8


def _standing(joints: Float[Tensor, "T 22 3"]) -> float:
    tall = float(joints[:, 0, 1].quantile(0.95))
    return tall if tall > 0.8 else STANDING


def _cut(sitting: _Sitting, name: str, draw: random.Random) -> tuple[int, int]:
    """Frames of the clip that show what the name says, with a little before and after."""
    stay = (sitting.end - sitting.begin) // 2
    early, late = draw.randint(8, 40), draw.randint(14, 90)
    begin, end = sitting.begin, sitting.end
    if name in ("sit down", "composed") and sitting.down is not None:
        begin = max(sitting.first, sitting.down - early)
        end = sitting.begin + max(6, min(late, stay)) if name == "sit down" else end
    if name in ("stand up", "composed") and sitting.up is not None:
        end = min(sitting.last, sitting.up + early)
        begin = sitting.end - max(6, min(late, stay)) if name == "stand up" else begin
    return begin, end


def _led(
    joints: Float[Tensor, "T 22 3"], sitting: _Sitting, height: float, draw: random.Random
) -> tuple[Float[Tensor, "T 22 3"], Float[Tensor, " T"]]:
    """The clip with this sitting on a seat so high, and how far the body is on it (0 to 1) in every frame."""
    on = slice(sitting.begin, sitting.end)
    hips, ankles = ([leg[i] for leg in LEGS] for i in (0, 2))
    y, stand = joints[:, 0, 1], _standing(joints) - 0.5 * UP
    onto = eased((stand - y) / (stand - y[on].median()))
    _, forward = axes(joints)
    ahead = forward[on].mean(0)
    ahead = ahead / ahead.norm()
    rise = height + HIPS - float(joints[on][:, hips, 1].mean())
    back = _room(height, draw) - float(((joints[on][:, ankles] - joints[on][:, hips]) @ ahead).mean())
    shift = joints.new_tensor([0.0, rise, 0.0]) - max(-0.3, min(back, 0.3)) * ahead
    body = onto[:, None] * shift
    # A foot that is off the ground goes with the body.
    free = eased(joints[:, [leg[3] for leg in LEGS], 1] / 0.4)
    # The further down, the more the trunk comes forward on the way, or the body would fall onto the seat.
    lean = max(-rise, 0.0) * onto * (1 - onto) + draw.uniform(-0.08, 0.15) * onto
    left, _ = axes(joints)
    made = with_legs(pitched(joints, left, lean), body, free[..., None] * body[:, None])
    return _hands(made, height, onto, draw), onto


def _room(height: float, draw: random.Random) -> float:
    """Metres from the hips forward to the ankles at which knees are bent by a drawn angle."""
    thigh, shin = (float(HUMANML3D.bone_lengths[j]) for j in LEGS[0][1:3])
    # Who sits high has the legs further out than who sits low.
    knee = math.radians(draw.uniform(78, 108) + 150 * max(height - 0.45, 0.0))
    across = thigh**2 + shin**2 - 2 * thigh * shin * math.cos(knee)
    down = height + HIPS - 0.08
    return math.sqrt(max(across - down**2, 0.12**2))


def _hands(
    joints: Float[Tensor, "T 22 3"], height: float, onto: Float[Tensor, " T"], draw: random.Random
) -> Float[Tensor, "T 22 3"]:
    """Hands left as they were, on the thighs, or on the seat at the body's sides."""
    where = draw.choice(["recorded", "recorded", "thighs", "thighs", "sides"])
    if where == "recorded":
        return joints
    left, forward = axes(joints)
    up = joints.new_tensor([0.0, 1.0, 0.0])
    along, aside = draw.uniform(0.5, 0.85), draw.uniform(0.08, 0.16)
    for side, leg in zip(SIDES, LEGS, strict=True):
        outwards = left if side == "left" else -left
        hip, knee = joints[:, leg[0]], joints[:, leg[1]]
        if where == "thighs":
            goal = torch.lerp(hip, knee, along) + 0.11 * up + 0.02 * outwards
        else:
            goal = hip + aside * outwards - 0.04 * forward + (0.03 - HIPS) * up
        arm = goal - joints[:, ARMS[side][0]]
        offset = torch.stack([(arm * axis).sum(-1) for axis in (left, up.expand_as(left), forward)], -1)
        joints = with_arm(joints, side, offset, eased(onto), back=1.5)
    return joints


def _still(joints: Float[Tensor, "T 22 3"]) -> bool:
    """Whether someone who sits hardly moves."""
    return float(smooth(joints, 1.0).diff(dim=0).norm(dim=-1).amax(1).quantile(0.9)) * FPS < STILL


def _turns(joints: Float[Tensor, "T 22 3"]) -> bool:
    """Whether the body turns by more than 60 degrees."""
    _, forward = axes(joints)
    return bool((forward[0] * forward[-1]).sum() < 0.5)


def _seat(height: float, draw: random.Random) -> str:
    """A name for a seat so high."""
    return draw.choice(next((names for top, names in _CHAIRS if height < top), _HIGH))


def _said(name: str, seat: str, turns: bool, draw: random.Random) -> tuple[str, ...]:
    """Sentences for a sitting or a part of it."""
    turn = "turns around and " if turns else ""
    texts = {
        "sit down": [
            f"a person {turn}sits down on {seat}.",
            f"someone {turn}takes a seat.",
            f"a person {turn}lowers themselves onto {seat}.",
            f"the person {turn}sits down.",
            f"a person {turn}takes a seat on {seat}.",
        ],
        "sit": [
            f"a person sits on {seat}.",
            "someone sits still.",
            f"a person stays seated on {seat}.",
            "the person sits.",
            "a person remains sitting.",
        ],
        "stand up": [
            f"a person stands up from {seat}.",
            "someone gets up from their seat.",
            f"a person rises from {seat}.",
            "the person stands up.",
            "a person gets to their feet.",
        ],
    }[name]
    return tuple(draw.sample(texts, 4))


def _in_acts(clip: Clip, onto: Float[Tensor, " T"], seat: str, draw: random.Random) -> Clip:
    """The clip with the acts of a whole sitting: down, on the seat, up."""
    on = (onto > 0.97).nonzero()[:, 0]
    edges = [0, int(on[0]) + 2, int(on[-1]) - 1, clip.frames]
    names = ("sit down", "sit", "stand up")
    acts = tuple(
        Act(begin, end, _said(name, seat, False, draw))
        for name, begin, end in zip(names, edges[:-1], edges[1:], strict=True)
    )
    return replace(clip, acts=acts, captions=in_one([act.captions for act in acts]))
