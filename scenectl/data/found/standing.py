"""Rests, stops, starts and turns in place, found by how bodies move alone."""

from __future__ import annotations

import math
import random
from collections.abc import Iterator, Sequence

import numpy as np
from jaxtyping import Float
from torch import Tensor

from scenectl.data.corpus import Act, Clip
from scenectl.data.edits.limbs import LEGS, with_legs
from scenectl.data.features import FPS
from scenectl.data.found.holding import SHORTEST_REST, held, lasting
from scenectl.data.found.pieces import SHORTEST, drawn_for, piece, said, widened
from scenectl.data.found.traits import ANKLES, FEET, HIPS, WRISTS, Traits, bends, runs, wander
from scenectl.data.kinds import kind_of
from scenectl.data.sentences import in_one
from scenes.motion.skeleton import HUMANML3D

STRAIGHT_KNEE = 20.0
"""Degrees up to which a knee counts as straight, as issue 24 asks of people who stand."""
RELAXED_KNEE = 12.0
"""Degrees to which the straighter knee is brought where a capture's skeleton keeps both bent; SNU's people stand so."""
BENT_BY_CAPTURE = 40.0
"""Degrees of bend that skeletons of captures account for at most; more is a crouch."""
PLANTED = 0.03
"""How far (m) a foot of someone who stands gets from its mean."""
JERK = 0.01
"""What a foot that stands moves from one frame to the next at most, m; captures of toes jerk."""
HANGING = 0.08
"""How far (m) a wrist of someone who lets the arms hang gets from its mean."""
LOWERED = 75.0
"""Degrees from hanging straight down to which arms of someone who stands may be bent or held."""
HOLDS = (60, 200)
"""Frames that a rest is held for."""
_OTHERWISE = (
    "dance", "acrobatics", "fight", "ball", "exercise", "mimicry", "get up", "hop", "squat", "climb", "gesture",
    "sneak",
)  # fmt: skip
"""Kinds of clips whose steps and turns are parts of something else."""

IDLE = (
    "stands still", "stands relaxed", "stands with both arms hanging down", "stands in place and waits", "stands idle",
    "is standing still with relaxed arms", "stands upright and does nothing", "stands quietly", "waits, standing",
    "stands calmly with the arms at the sides", "stays in place, standing upright", "rests on both feet",
    "just stands there", "stands around", "is waiting", "stands at ease", "remains standing without a step",
)  # fmt: skip
STANDS = (
    "stands still", "stands", "is standing", "stands and waits", "remains standing", "stands quietly",
)  # fmt: skip
STOPS = ("stops and stands still", "stops", "comes to a stop", "comes to a halt and stands", "slows down and stops")
STOPPING = ("{gait} and stops", "{gait}, then stops and stands still", "{gait} and comes to a halt",
            "stops after a few steps",
            "{gait}, slows down and stands still")  # fmt: skip
STARTING = ("stands, then {gait}", "starts to {plain}", "sets off and {gait}", "stands still and then {gait}",
            "starts to {plain} from standing", "begins to {plain}")  # fmt: skip


def _shows_something_else(clip: Clip) -> bool:
    return kind_of(clip).removeprefix("bandai: ").split("-")[0] in _OTHERWISE


def idles(clip: Clip) -> Iterator[Clip]:
    """Rests of people who stand upright with hanging arms, straight knees and planted feet, held for longer."""
    traits = Traits.of(clip.joints)
    upright = (traits.trunk > 0.95) & (traits.arms < 48) & (traits.knees < BENT_BY_CAPTURE)
    for begin, end in runs(upright & _quiet(traits), SHORTEST_REST):
        joints = relaxed(clip.joints[begin:end])
        calm = wander(joints, FEET) < PLANTED and wander(joints, WRISTS) < HANGING
        calm &= float(joints[:, FEET].diff(dim=0).norm(dim=-1).max()) < JERK
        if not calm or bends(joints.double().numpy()).max() > STRAIGHT_KNEE:
            continue
        draw = drawn_for(clip, "idle", begin)
        for i in range(1 + (end - begin) // 30):
            moving = held(joints, draw.randint(*HOLDS), draw)
            yield piece(clip, moving, "idle", begin + i, said(IDLE, draw, 5))


def _quiet(traits: Traits) -> np.ndarray:
    return (traits.quickest < 0.5) & (traits.feet < 0.15) & (traits.speed < 0.15)


def relaxed(joints: Float[Tensor, "T 22 3"]) -> Float[Tensor, "T 22 3"]:
    """The body raised over its feet until its straighter leg is as straight as that of people who stand."""
    if bends(joints.double().numpy()).max() <= STRAIGHT_KNEE:
        return joints
    thigh, shin = (float(HUMANML3D.bone_lengths[joint]) for joint in LEGS[0][1:3])
    chord = math.sqrt(thigh**2 + shin**2 + 2 * thigh * shin * math.cos(math.radians(RELAXED_KNEE)))
    leg = (joints[:, HIPS] - joints[:, ANKLES]).norm(dim=-1).mean(0)
    lift = (chord - float(leg.max())) * joints.new_tensor([0.0, 1.0, 0.0])
    return with_legs(joints, lift.expand(len(joints), 3), joints.new_zeros(len(joints), 2, 3))


def stops_and_starts(clip: Clip) -> Iterator[Clip]:
    """Walks and runs that end in a rest, and rests that end in them; the rest is held for a while."""
    if _shows_something_else(clip):
        return
    yield from _stops(clip, clip.joints, "stop")
    yield from _stops(clip, clip.joints.flip(0), "start")


def _stops(clip: Clip, joints: Float[Tensor, "T 22 3"], name: str) -> Iterator[Clip]:
    """Stops in a motion, or starts in one that runs backwards."""
    traits = Traits.of(joints)
    still = (traits.trunk > 0.9) & (traits.knees < 60) & (traits.feet < 0.3) & (traits.speed < 0.2)
    still &= traits.arms < LOWERED
    going = runs(traits.speed > 0.5, round(0.8 * FPS), gap=4)
    for rest, end in runs(still, 10):
        walk = next((w for w in reversed(going) if w[1] <= rest + 4 and rest - w[1] < FPS), None)
        if walk is None:
            continue
        draw = drawn_for(clip, name, rest)
        begin = max(walk[0], rest - draw.randint(30, 80))
        gait = _gait(traits, begin, walk[1], 1.0 if name == "stop" else -1.0)
        end = min(end, rest + 50)
        if gait is None or end - begin < SHORTEST:
            continue
        moving = joints[begin:end]
        if end - rest >= SHORTEST_REST and wander(moving[rest - begin :], FEET) < PLANTED:
            moving = held(moving, rest - begin + draw.randint(20, 60), draw, lead=rest - begin)
        # Someone still walks at half their speed, and no more below it.
        slow = np.flatnonzero(traits.speed[begin:rest] > 0.5 * np.median(traits.speed[begin : walk[1]]))[-1] + 1
        yield _told(clip, moving, name, rest, int(slow), gait, draw)


def _told(
    clip: Clip,
    moving: Float[Tensor, "T 22 3"],
    name: str,
    at: int,
    edge: int,
    gait: tuple[str, str],
    draw: random.Random,
) -> Clip:
    goes, plain = gait
    steps = ("moves forward", "takes some steps forward") if goes == "walks forward" else ()
    walks = said([goes, *steps], draw)
    if name == "stop":
        acts = Act(0, edge, walks), Act(edge, len(moving), said(STOPS, draw))
        whole = said([text.format(gait=goes, plain=plain) for text in STOPPING], draw, 3)
    else:
        moving, edge = moving.flip(0), len(moving) - edge
        acts = Act(0, edge, said(STANDS, draw)), Act(edge, len(moving), walks)
        whole = said([text.format(gait=goes, plain=plain) for text in STARTING], draw, 3)
    return piece(clip, moving, name, at, (*whole, *in_one([act.captions for act in acts], 3)), acts)


def _gait(traits: Traits, begin: int, end: int, time: float) -> tuple[str, str] | None:
    """What someone does who goes forward ("walks forward"), and the same after "to"; None of other ways."""
    speed, ahead = float(np.median(traits.speed[begin:end])), float(np.median(traits.ahead[begin:end])) * time
    if ahead < 0.7 * speed:
        return None
    turn = math.degrees(traits.heading[end - 1] - traits.heading[begin]) * time
    side = "left" if turn > 0 else "right"
    curve = f" in a curve to the {side}" if abs(turn) < 120 else f" along a wide curve to the {side}"
    how = " forward" if abs(turn) < 30 else curve
    verb = "walk" if speed < 1.7 else "jog" if speed < 2.5 else "run"
    how = " slowly" + how if speed < 0.7 else how
    return f"{verb}s{how}", f"{verb}{how}"


def turns_in_place(clip: Clip) -> Iterator[Clip]:
    """Turns by 40 to 200 degrees while the pelvis hardly travels."""
    if _shows_something_else(clip):
        return
    traits = Traits.of(clip.joints)
    rate = np.degrees(np.gradient(traits.heading)) * FPS
    upright = (traits.trunk > 0.9) & (traits.speed < 0.45) & (traits.knees < 80) & (traits.arms < 60)
    for way, side in ((1.0, "left"), (-1.0, "right")):
        for begin, end in runs(way * rate > 20, 8, gap=3):
            angle = way * math.degrees(traits.heading[end - 1] - traits.heading[begin])
            travel = float((clip.joints[begin:end, 0] - clip.joints[begin, 0])[:, [0, 2]].norm(dim=-1).max())
            if not 40 <= angle <= 200 or travel > 0.3 or upright[begin:end].mean() < 0.95:
                continue
            first, last = widened(max(0, begin - 5), min(clip.frames, end + 5), clip.frames)
            if last - first < SHORTEST or max(traits.speed[first:last]) > 0.8:
                first, last = max(0, begin - 4), min(clip.frames, end + 4)
            if last - first >= SHORTEST:
                draw = drawn_for(clip, "turn in place", begin)
                captions = said(_turning(angle, side), draw, 5)
                yield piece(clip, clip.joints[first:last], "turn in place", begin, captions)
                yield from _turn_between_rests(clip, traits, (begin, end), captions, draw)


def _turn_between_rests(
    clip: Clip, traits: Traits, turn: tuple[int, int], captions: Sequence[str], draw: random.Random
) -> Iterator[Clip]:
    """The turn with the standing before it and after it, one of them held for longer, where there is any."""
    begin, end = turn
    still = (traits.feet < 0.3) & (traits.speed < 0.2) & (traits.arms < LOWERED)
    before = next((run for run in runs(still, SHORTEST_REST) if 0 <= begin - run[1] < 12), None)
    after = next((run for run in runs(still, SHORTEST_REST) if 0 <= run[0] - end < 12), None)
    if before is not None:
        first, last = max(before[0], before[1] - 40), min(clip.frames, end + 5)
        moving = lasting(clip.joints[first:last], before[1] - first, draw.randint(20, 60), draw, first=True)
        yield piece(clip, moving, "turn in place", begin + 1, captions)
    if after is not None:
        first, last = max(0, begin - 5), min(after[1], after[0] + 40)
        moving = lasting(clip.joints[first:last], last - after[0], draw.randint(20, 60), draw)
        yield piece(clip, moving, "turn in place", begin + 2, captions)


def _turning(angle: float, side: str) -> Sequence[str]:
    about = (
        ("45", "forty-five"),
        ("90", "ninety"),
        ("135", "a hundred and thirty-five"),
        ("180", "a hundred and eighty"),
    )
    number, words = about[min(range(4), key=lambda i: abs(int(about[i][0]) - angle))]
    said_otherwise = {
        "45": "turns a little",
        "90": "makes a quarter turn",
        "135": "turns more than a quarter turn",
        "180": "turns around",
    }
    plain = said_otherwise[number]
    return (
        f"turns to the {side} in place", f"turns {side} on the spot", f"turns about {words} degrees to the {side}",
        f"turns {number} degrees to the {side} in place", f"{plain} to the {side}", f"stands and {plain} to the {side}",
        f"{plain} to the {side} without walking away", f"stays in place and turns {side}",
    )  # fmt: skip
