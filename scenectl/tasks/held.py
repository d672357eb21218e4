"""Things that goals hold: gone from where they rested, on their way with the hands, and where they were put."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace

import numpy as np
import torch

from objectives import Context, Term
from objectives.library.held import Grip
from scenes.errors import UserError
from scenes.motion.headings import heading, rotation_about_y
from scenes.motion.motion import Motion
from scenes.motion.rotations import unit_quaternions
from scenes.world.moving import MovingObject, Trajectory
from scenes.world.scene import Scene

GOAL = "hold"
APART = 0.5
"""Seconds between goals of one thing from which on it would be held twice."""


@dataclass(frozen=True)
class Hold:
    """All that a task's goals say of one thing that is held.

    Attributes:
        terms: in the order of their times.
        begin, end: from when to when it is held, s.
    """

    terms: tuple[Term, ...]
    begin: float
    end: float

    @property
    def name(self) -> str:
        """The thing's."""
        return str(self.terms[0].parameters["object"])

    @property
    def put(self) -> Term | None:
        """The goal that says where it is put, of which its end is one; None where it stays in hand."""
        last = self.terms[-1]
        return last if last.parameters.get("position") is not None and _span(last, self.end)[0] > self.begin else None


def holds(terms: Iterable[Term], seconds: float) -> list[Hold]:
    """What is held in a motion of so many seconds, by thing.

    Raises:
        UserError: a thing that is taken twice.
    """
    found: dict[str, list[Term]] = {}
    for term in terms:
        if term.goal == GOAL and term.weight > 0:
            found.setdefault(str(term.parameters["object"]), []).append(term)
    made = []
    for several in found.values():
        ordered = sorted(several, key=lambda term: _span(term, seconds))
        spans = [_span(term, seconds) for term in ordered]
        if any(then > max(end for _, end in spans[: k + 1]) + APART for k, (then, _) in enumerate(spans[1:])):
            raise UserError(f"{ordered[0].label}: a thing is held once; let no time pass between its goals")
        made.append(Hold(tuple(ordered), spans[0][0], max(end for _, end in spans)))
    return made


def _span(term: Term, seconds: float) -> tuple[float, float]:
    if term.times:
        return min(term.times), max(term.times)
    span = term.window or term.sometime
    return (0.0, seconds) if span is None else (span[0], span[1])


def without_held(scene: Scene, found: Iterable[Hold], context: Context) -> Scene:
    """A scene in which things are gone while they are held, and stand where they were put from then on."""
    moved = {hold.name: _away(hold, context) for hold in found}
    if not moved:
        return scene
    return scene.with_objects([moved.get(thing.name, thing) for thing in scene.objects])


def _away(hold: Hold, context: Context) -> MovingObject:
    try:
        grip = Grip.of(hold.terms[0].parameters, context)
    except UserError as error:
        raise UserError(f"{hold.terms[0].label}: {error}") from error
    thing = grip.thing
    if len(thing.trajectory.times) > 1:
        raise UserError(f"{hold.terms[0].label}: '{hold.name}' moves by itself, and only what rests can be taken")
    begin = hold.begin if hold.begin > 0 else -np.inf  # who begins with it in hand had it before
    if hold.put is None:
        return replace(thing, gone=((begin, np.inf),))
    _, rotation, own = grip.rest
    turned = hold.put.parameters.get("turned")
    if turned is not None:  # it turns as the body did on the way
        rotation = rotation_about_y(torch.tensor(turned - grip.facing, dtype=torch.float64)) @ rotation
    there = torch.tensor(hold.put.parameters["position"], dtype=torch.float64)
    places = [thing.trajectory.positions[0], tuple((there - rotation @ own).tolist())]
    turns = [unit_quaternions(each).tolist() for each in (grip.rest[1], rotation)]
    trajectory = Trajectory((hold.begin, hold.end), places, quaternions=turns)
    return replace(thing, trajectory=trajectory, gone=((begin, hold.end),))


def with_held(scene: Scene, terms: Iterable[Term], motion: Motion) -> Scene:
    """A scene with the things that a motion ``[T, J, 3]`` in its frame holds on their ways with the hands.

    Before it is taken a thing rests, and once it was put it stays as it left the hands.
    """
    found = holds(terms, motion.seconds)
    things = {thing.name: thing for thing in scene.objects}
    carried = {hold.name: _carried(hold, things[hold.name], motion) for hold in found if hold.name in things}
    return scene.with_objects([carried.get(thing.name, thing) for thing in scene.objects]) if carried else scene


def _carried(hold: Hold, thing: MovingObject, motion: Motion) -> MovingObject:
    resting = replace(thing, trajectory=_first(thing.trajectory), gone=())
    parameters = hold.terms[0].parameters
    offset = tuple(float(parameters.get(key, 0.0)) for key in ("left", "up", "forward"))
    grip = Grip(resting, parameters.get("hand", "right"), offset, float(parameters.get("facing", 0.0)))  # type: ignore[arg-type]
    frames = ((motion.times >= hold.begin - 1e-6) & (motion.times <= hold.end + 1e-6)).nonzero()[:, 0]
    if not len(frames):
        return resting
    _, rotation, own = grip.rest
    turns = rotation_about_y(heading(motion, ("hip",))[frames].double() - grip.facing) @ rotation
    places = grip.middle(motion)[frames].double() - turns @ own
    times, ways = motion.times[frames].double().tolist(), [tuple(place) for place in places.tolist()]
    quaternions = unit_quaternions(turns).tolist()
    if (just := times[0] - 0.5 / motion.fps) > 0:  # until just before it is taken, it rests
        times, ways = [just, *times], [tuple(resting.trajectory.positions[0]), *ways]
        quaternions = [unit_quaternions(rotation).tolist(), *quaternions]
    return replace(resting, trajectory=Trajectory(times, ways, quaternions=quaternions))


def _first(way: Trajectory) -> Trajectory:
    """Where it begins, for good."""
    headings = None if way.headings is None else way.headings[:1]
    quaternions = None if way.quaternions is None else way.quaternions[:1]
    return Trajectory(way.times[:1], way.positions[:1], headings, quaternions)
