"""The goals of a walk: a corridor with a schedule, places on the way, the place at its end, and standing there."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import chain, pairwise
from typing import Annotated, Any, TypeAlias

import numpy as np
from pydantic import Field

from objectives import Term
from objectives.checks import places
from objectives.parameters import Time, instances, stated
from objectives.tracks import TrackBase
from scenes.body.body import DEFAULT_BODY, ProxyBody
from scenes.motion.frames import Place
from scenes.motion.skeleton import FEET
from scenes.tables import Table
from scenes.world.floor.levels import STEP
from scenes.world.floor.mapping import HEIGHT, RADIUS
from scenes.world.floor.planning import FreeArea
from scenes.world.floor.polyline import resample, sloped, walked

Spot: TypeAlias = tuple[float, float] | tuple[float, float, float]
"""A place on the ground: [x, z], or [x, y, z] where y tells storeys apart, world metres."""

# Lengths and speeds here are an adult's: those of a body go with its legs (`ProxyBody.size`), since it takes as many
# steps a second (`scenectl.control.figure`).
FASTEST_WALK = 1.6
"""Metres a second beyond which a path is refused as too long for its task: a brisk walk."""
PACE = 1.4
"""Metres a second at which tasks without `seconds` are timed: a person's usual pace. The shipped generators', standing
included, is a little less (`scenectl bench rooms` prints it); a body that is led more slowly steps lower."""
PELVIS = 0.91
"""Height (m) of the pelvis over the lowest foot joint of a person who walks: the mean over what the shipped generator
makes of "a person walks forward" on level ground, whose standard deviation is 0.02 m."""
STRIDE = 0.7
"""Length (m) of a step of a person who walks, over which the body's middle rises with the ground."""
BRAKE = 0.7
"""Seconds over which a walk that stops slows down, a step and a half: with 1.0 the corridor is left more often."""
STAND = 0.3
"""Seconds for which a walk that stops stands at least."""
STILL, DOWN = 3.0, 300.0
"""Weights of standing still and of feet on the ground: with three times as much, walks down stairs end in a riser."""
REACH = 0.9
"""Metres over the floor to where a hand reaches of a person who stands and leans: an arm of 0.65 m, and a little."""
LEGS = {"pelvis", *(f"{side}_{part}" for side in ("left", "right") for part in ("hip", "knee", "ankle", "foot"))}
"""Joints that a walk holds after it has arrived."""
LAG = 0.8
"""Metres by which a walk may be before or behind its schedule: a step, so that it can wait for what comes its way."""
WAIT = 1.0
"""Seconds added to tasks without `seconds` in which things move: without them, a walk that must wait is late."""
ABOUT = 0.4
"""Seconds by which a place on the way may be passed before or after the schedule does."""


class Walk(Table):
    """Walk to a place and stop there: a planned path around what is in the way, and its end.

    Attributes:
        to: where the pelvis shall be in the end, [x, z], world metres; [x, y, z] with the height of the ground there
            says which storey.
        via: places to pass on the way, in order, a list of them.
        via_tolerance: how near counts as passed (m).
        radius: of the body while planning (m); by default 0.3 for an adult, others as broad as they are.
        height: that shall be free along the path (m); by default 1.8 for an adult of 1.7, others as tall as they are.
            Less where the person shall duck.
        arrive: when (s); by default at the end, or in time to stop there. Where other goals ask for something later,
            the walk holds nothing from there on.
        stop: it ends standing, both feet on the ground; false walks on to the end.
        half_width: of the corridor around the path (m).
        tolerance: how near counts as reached (m).
        weight: of all its goals.
    """

    to: Spot
    via: tuple[Spot, ...] = ()
    radius: Annotated[float | None, Field(gt=0.05, le=1.0)] = None
    height: Annotated[float | None, Field(gt=0.3, le=3.0)] = None
    via_tolerance: Annotated[float, Field(gt=0)] = 0.15
    arrive: float | None = None
    stop: bool = True
    half_width: Annotated[float, Field(gt=0)] = 0.2
    tolerance: Annotated[float, Field(gt=0)] = 0.1
    weight: Annotated[float, Field(ge=0)] = 1.0

    def moved(self, by: Place) -> Walk:
        """The same walk so much (m) further."""
        return self.model_copy(
            update={"to": moved_spot(self.to, by), "via": tuple(moved_spot(p, by) for p in self.via)}
        )

    def room(self, body: ProxyBody) -> tuple[float, float]:
        """Radius and height (m) of what is kept free: as stated, or as a body needs."""
        radius, height = room_of(body)
        return self.radius or radius, self.height or height

    def path(self, area: FreeArea, start: Spot) -> np.ndarray:
        """The planner's way from `start` over `via` to `to`, ``[P, 3]``, with the area's room; UserError if none."""
        stops = [start, *self.via, self.to]
        legs = [area.path(a, b) for a, b in pairwise(stops)]
        return np.concatenate([legs[0], *(leg[1:] for leg in legs[1:])])


def room_of(body: ProxyBody) -> tuple[float, float]:
    """Radius and height (m) of what is kept free for a body that walks."""
    radius, height = RADIUS * body.breadth / DEFAULT_BODY.breadth, HEIGHT * body.height / DEFAULT_BODY.height
    return round(radius, 3), round(height, 3)


def moved_spot(place: Sequence[float], by: Place) -> tuple[float, ...]:
    """[x, z] or [x, y, z] moved by so much (m)."""
    return tuple(a + b for a, b in zip(place, by if len(place) == 3 else by[::2], strict=True))


@dataclass(frozen=True)
class Schedule:
    """When a walk is where.

    Attributes:
        arrive: when it is at its end, s.
        last: the time of the last frame, s.
        brake: over how long it slows down before, s.
    """

    arrive: float
    last: float
    brake: float

    @classmethod
    def of(cls, walk: Walk, seconds: float, fps: float) -> Schedule:
        """Of a walk within so many seconds: earlier than its end, where it stops, by the time of standing there."""
        last = seconds - 1 / fps
        latest = max(last - STAND, last / 2) if walk.stop else last
        arrive = latest if walk.arrive is None else min(walk.arrive, latest)
        return cls(arrive, last, min(BRAKE, arrive) if walk.stop else 0.0)

    @property
    def walking(self) -> float:
        """Seconds that the path takes at its constant speed: slowing down counts half."""
        return self.arrive - self.brake / 2

    def passed(self, share: float) -> float:
        """When a share of the path has been passed, s (the inverse of `follow_path`'s own)."""
        even = share * self.walking
        if even <= self.arrive - self.brake:
            return even
        return self.arrive - float(np.sqrt(max(2 * self.brake * (self.walking - even), 0.0)))


def seconds_for(walk: Walk, length: float, body: ProxyBody = DEFAULT_BODY) -> float:
    """Seconds that a path of so many metres takes at a body's usual pace, with time to stop where it does."""
    return length / (body.size * PACE) + (BRAKE / 2 + STAND if walk.stop else 0.0)


def walk_terms(
    walk: Walk,
    path: np.ndarray,
    seconds: float,
    fps: float,
    goals: Sequence[Term] = (),
    body: ProxyBody = DEFAULT_BODY,
) -> list[Term]:
    """The goals of a walk along a planned path.

    Where the ground rises or falls by more than `STEP`, the pelvis keeps its height over it. Goals that ask for a leg,
    the pelvis or a place out of reach once a walk has arrived when its table says find it over; others find a person
    who stands there.

    Args:
        walk: its table.
        path: from its start over the places on the way to its end, ``[P, 3]`` metres.
        seconds, fps: of the motion.
        goals: the task's other goals.
        body: that walks.
    """
    schedule = Schedule.of(walk, seconds, fps)
    x, _, z = path[-1].tolist()
    reach = REACH * body.size
    asked = None if walk.arrive is None else _first_asked(goals, schedule.arrive, (x, z), reach)
    until = schedule.last if asked is None else max(min(schedule.arrive + STAND, asked), schedule.arrive + 1 / fps)
    terms = _way(walk, path, schedule, None if asked is None else until, fps, body)
    rest = (schedule.arrive, min(schedule.arrive + STAND, until))
    held: dict[str, Any] = {"window": rest} if walk.stop else {"at": schedule.arrive}
    target = {"joint": "pelvis", "position": [x, z]}
    terms.append(Term("joint_target", target, walk.weight, walk.tolerance, name="walk: arrive", **held))
    return [*terms, *_standing(walk, schedule.arrive, until)]


def _way(
    walk: Walk, path: np.ndarray, schedule: Schedule, until: float | None, fps: float, body: ProxyBody
) -> list[Term]:
    """The corridor, and the places to pass in the order in which they are passed."""
    legs = _legs(path, walk.via)
    lengths = [walked(leg) for leg in legs]
    if sum(lengths) < 0.05:
        return []
    rises = bool(np.ptp(path[:, 1]) > STEP)
    # 5 cm between vertices would only cost time; the places that are passed stay among them.
    flat = [resample(leg[:, [0, 2]], 0.2) for leg in legs]
    line = sloped(path, STRIDE * body.size) if rises else np.concatenate([flat[0], *(leg[1:] for leg in flat[1:])])
    corridor = {
        "path": line.tolist(),
        "half_width": walk.half_width,
        "begin": 0.0,
        "end": schedule.arrive,
        "brake": schedule.brake,
        "lag": LAG * body.size,
        "height": PELVIS * body.size + body.sole_offset if rises else None,
    }
    window = None if until is None else (0.0, until)
    terms = [Term("follow_path", corridor, walk.weight, window=window, name="walk: path")]
    times = [schedule.passed(share) for share in np.cumsum(lengths[:-1]) / sum(lengths)]
    between = [0.0, *((a + b) / 2 for a, b in pairwise(times)), schedule.arrive]
    for k, (leg, time) in enumerate(zip(legs, times, strict=False)):
        x, _, z = leg[-1].tolist()
        before, after = min(time - between[k], ABOUT), min(between[k + 1] - time, ABOUT)
        about = (max(time - max(before, 1 / fps), 0.0), time + max(after, 1 / fps))  # a frame at least
        options: dict[str, Any] = {"sometime": about, "name": f"walk: via {k + 1}"}
        place = {"joint": "pelvis", "position": [x, z]}
        terms.append(Term("joint_target", place, walk.weight, walk.via_tolerance, **options))
    return terms


def _standing(walk: Walk, arrive: float, until: float) -> Iterator[Term]:
    """A pelvis that rests from arrival on, and feet and neck that do at last: without the neck, a third of them bow."""
    if not walk.stop:
        return
    feet, last = list(FEET), (max(arrive, until - STAND), until)
    pelvis = {"joints": "pelvis", "axes": "xz"}
    yield Term("speed_limit", pelvis, STILL * walk.weight, window=(arrive, until), name="walk: stop")
    yield Term("speed_limit", {"joints": [*feet, "neck"]}, STILL * walk.weight, window=last, name="walk: standing")
    squares: dict[str, Any] = {"kernel": "squared", "reduction": "sum", "window": last, "name": "walk: feet down"}
    yield Term("foot_contact", {"feet": feet, "each": True}, DOWN * walk.weight, **squares)


def _legs(path: np.ndarray, via: Sequence[Spot]) -> list[np.ndarray]:
    """A path ``[P, 3]`` cut where it first comes to each of the places that it passes in turn."""
    cuts = [0]
    for place in via:
        rest = path[cuts[-1] :, [0, 2] if len(place) == 2 else [0, 1, 2]]
        away = np.linalg.norm(rest - np.asarray(place), axis=1)
        cuts.append(cuts[-1] + int(np.argmax(away <= away.min() + 1e-3)))
    return [path[a : b + 1] for a, b in pairwise([*cuts, len(path) - 1])]


def _first_asked(goals: Sequence[Term], arrive: float, end: tuple[float, float], reach: float) -> float | None:
    """When (s) the first goal after arrival asks for what a walk holds, which ends at x and z (m); None if none does.

    Such a goal begins after it, or draws beyond it; by more than a hand's `reach` (m), where it draws to a place.
    """
    found = [
        max(begin, arrive)
        for term in goals
        if term.weight > 0 and _asks(term, end, reach)
        for begin, finish in _spans(term)
        if begin > arrive or (term.spec.draws and finish > arrive)
    ]
    return min(found, default=None)


def _asks(term: Term, end: tuple[float, float], reach: float) -> bool:
    """Whether a goal is about the pelvis or legs, or draws to a place that is out of reach from a place [x, z] (m)."""
    named = {*term.joints, *chain(*(_names(term.parameters.get(key)) for key in ("joints", "feet")))}
    away = [place[[0, 2]] - end for place in places(dict(term.parameters))] if term.spec.draws else []
    return bool(named & LEGS) or any(np.linalg.norm(offset) > reach for offset in away)


def _names(joints: str | Sequence[str] | None) -> Sequence[str]:
    return (joints,) if isinstance(joints, str) else joints or ()


def _spans(term: Term) -> Iterator[tuple[float, float]]:
    """From when to when (s) a term applies, as far as it states times."""
    yield from ((time, time) for time in term.times)
    yield from ((span[0], span[1]) for span in (term.window, term.sometime) if span is not None)
    yield from (track.span for track in instances(dict(term.parameters), TrackBase))
    given = [
        time for name, p in term.spec.parameters.items() for time in stated(p.hint, term.parameters.get(name), Time)
    ]
    if given:
        yield min(given), max(given)
