"""Taking, carrying and putting down things of a scene."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Annotated, Any, Literal

import numpy as np
import torch
from pydantic import Field

from objectives import Context, Point, Term
from objectives.library.held import Grip, Hand
from scenectl.generators.prompts import Prompt
from scenectl.tasks.actions.library._common import (
    ABOUT,
    FULL,
    Place,
    Seconds,
    Speed,
    facing,
    kept,
    on_the_way_there,
    side,
    turning,
    upright,
)  # fmt: skip
from scenectl.tasks.actions.library.going import walk
from scenectl.tasks.actions.registry import action
from scenectl.tasks.actions.state import Act, State, World, turn as between
from scenectl.tasks.walk import room_of
from scenes.errors import UserError

TAKES, PUTS = 2.6, 2.6
"""Seconds in which something is taken and put down, about as long as in the edits of recordings that a model learns
(`scenectl bench data` draws them); halfway the hand is there. Ours."""
OPEN = 0.02
"""Metres between the middle of a palm and the side of a thing that it holds."""
FAR = 0.62
"""Metres from the vertical through an adult's pelvis to a thing that is taken without a step: an arm's length; who
bends or leans gets further (`hands.REACH`)."""
FURTHEST = 1.0
"""Metres from there to where somebody may have to stand before what is wide, as a table is."""
LEANING, TRIES = 2.0, 8
"""Metres that somebody walks rather than to stand a metre further away, and places to which ways are looked for."""
LOW, HIGH = 0.35, 1.7
"""Heights (m) over the ground below which a thing is taken from above, and up to which an adult takes things."""
LIFTED, CLEAR = 0.85, 0.1
"""Metres over the ground, and over where it was, at which an adult's wrists are at least with what was lifted."""
THICK = 0.12
"""Half of a thing's depth (m) that a hand gets over to hold it."""


@action()
def pick_up(world: World, state: State, *, what: str, hand: Hand = "right", seconds: Seconds = TAKES) -> Act:
    """Pick a thing up, walking there first where it is out of reach.

    Args:
        what: name of a [[scene.objects]] table that rests.
        hand: "left", "right", or "both" for what is wide.
        seconds: how long it takes once one is there, s.
    """
    if state.holds:
        raise UserError(f"the hands hold '{state.held}' already; put it down first")
    if what in state.put:
        raise UserError(f"'{what}' was put down before, and a script takes a thing once; end the script there")
    rest = _rest(world, what, hand, state)
    way, here = _beside(world, state, (float(rest[0]), float(rest[1]), float(rest[2])))
    wanted = here.towards(float(rest[0]), float(rest[2]))
    gripped = _gripped(world, what, hand, wanted, float(rest[1]) - here.place[1])
    told, begin, lasts = _told(way, here, wanted, f"a person picks up {_thing(hand)}.", seconds)
    taken, place = begin + seconds / 2, [float(value) for value in rest]
    takes = Term("hold", {**gripped, "position": place}, 10.0, at=taken, name="takes")
    holds = Term("hold", gripped, 5.0, name="holds")
    terms = (
        *on_the_way_there(way), *(t.during(begin, lasts) for t in kept(here, seconds)),
        facing(wanted, (taken - 0.1, taken + 0.1)), takes, replace(holds, window=(taken, lasts)),
        upright(world, here.place[1], (lasts - 0.2, lasts)),
        _lifted(world, hand, max(here.place[1] + LIFTED * world.body.size, place[1] + CLEAR), (lasts - 0.2, lasts)),
    )  # fmt: skip
    then = replace(here.facing(wanted), holds=(holds,))
    return Act(told, lasts, then, terms, None if way is None else way.path, _hands(hand, (begin, lasts)))


@action()
def carry(
    world: World, state: State, *, to: Place, via: list[Place] = [], speed: Speed | None = None,  # noqa: B006  (read only)
    seconds: Seconds | None = None, tolerance: Annotated[float, Field(gt=0)] = 0.1,
) -> Act:  # fmt: skip
    """Walk with what the hands hold.

    Args:
        to: where the pelvis shall be in the end, world m; [x, y, z] says which storey.
        via: places to pass on the way, in order.
        speed: m/s; by default the usual one.
        seconds: how long, instead of a speed, s.
        tolerance: how near counts as there, m.
    """
    if not state.holds:
        raise UserError("the hands hold nothing; pick something up first")
    way: Act = walk(world, state, to=to, via=via, speed=speed, seconds=seconds, tolerance=tolerance)
    hand: Hand = state.holds[0].parameters["hand"]
    *before, last = way.prompts(0.0, way.seconds)
    return replace(way, sentence=(*before, replace(last, text=f"a person walks while carrying {_thing(hand)}.")))


@action()
def put_down(
    world: World, state: State, *, to: Point, seconds: Seconds = PUTS, tolerance: Annotated[float, Field(gt=0)] = 0.03
) -> Act:
    """Put down what the hands hold, walking there first where the place is out of reach.

    Args:
        to: the place on a surface on which it shall stand, world m.
        seconds: how long it takes once one is there, s.
        tolerance: how near counts as there, m.
    """
    if not state.holds:
        raise UserError("the hands hold nothing; pick something up first")
    gripped = dict(state.holds[0].parameters)
    hand: Hand = gripped["hand"]
    grip = Grip.of(gripped, Context(world.scene, world.body))
    way, here = _beside(world, state, (to.x, to.y, to.z))
    _within_reach(world, here, "the place", to.y)
    wanted = here.towards(to.x, to.z)
    told, begin, lasts = _told(way, here, wanted, f"a person puts down {_thing(hand)}.", seconds)
    place = [to.x, to.y + float(grip.halves[1]) + OPEN / 2, to.z]
    left = begin + seconds / 2
    puts = Term(
        "hold", {**gripped, "position": place, "turned": wanted}, 60.0, tolerance=tolerance, at=left, name="puts"
    )
    terms = (
        *on_the_way_there(way), *(t.during(begin, lasts) for t in kept(here, seconds)),
        facing(wanted, (left - 0.1, left + 0.1)), replace(state.holds[0], window=(0.0, left)), puts,
        upright(world, here.place[1], (lasts - 0.2, lasts)),
    )  # fmt: skip
    then = replace(here.facing(wanted), holds=(), put=(*state.put, state.held))
    return Act(told, lasts, then, terms, None if way is None else way.path, _hands(hand, (begin, lasts)))


def _lifted(world: World, hand: Hand, height: float, window: tuple[float, float]) -> Term:
    """The wrists of the hands that hold something at a height (m, world) or above."""
    wrists = [f"{side}_wrist" for side in (("left", "right") if hand == "both" else (hand,))]
    asked: dict[str, Any] = {"limit": height, "mode": "above", "joints": wrists}
    return Term("height_limit", asked, 20.0, tolerance=0.05, window=window, name="lifted")


def _within_reach(world: World, state: State, what: str, height: float) -> None:
    """Raises UserError for a height (m) that hands do not get to from where somebody stands."""
    over, most = height - state.place[1], HIGH * world.body.size
    if not -0.1 <= over <= most:
        raise UserError(f"{what} is {over:.2f} m over the ground, and hands get {most:.2f} m high")


def _rest(world: World, what: str, hand: Hand, state: State) -> torch.Tensor:
    """Middle of a thing at rest, ``[3]`` m, which hands can get to."""
    grip = Grip.of({"object": what, "hand": hand, "facing": state.heading}, Context(world.scene, world.body))
    rest, _, _ = grip.rest
    _within_reach(world, state, f"'{what}'", float(rest[1]))
    return rest


def _gripped(world: World, what: str, hand: Hand, wanted: float, over: float) -> dict[str, Any]:
    """The goal's parameters: from above what lies low, else at the near side, or at both sides."""
    told: dict[str, Any] = {"object": what, "hand": hand, "facing": wanted}
    halves = Grip.of(told, Context(world.scene, world.body)).halves
    if hand == "both":
        return told
    if over < LOW * world.body.size:
        return {**told, "up": -float(halves[1]) - OPEN}
    return {**told, "forward": min(float(halves[2]), THICK) + OPEN}


def _beside(world: World, state: State, point: tuple[float, float, float]) -> tuple[Act | None, State]:
    """The walk to where one stands before a point, None where one stands there; and the state then."""
    size = world.body.size
    if math.dist(state.place[::2], point[::2]) <= FAR * size:
        return None, state
    area, (x, _, z), here = world.area(*room_of(world.body)), point, state.place
    found, why = list[tuple[float, tuple[float, float, float]]](), "no free place to stand"
    for away in np.arange(0.35 * size, FURTHEST * size, 0.1):
        for angle in np.arange(0.0, 2 * math.pi, math.pi / 12):
            place = (x + float(away * np.sin(angle)), here[1], z + float(away * np.cos(angle)))
            if area.free(place):
                found.append((math.dist(here, place) + LEANING * float(away), place))
    for _, place in sorted(found)[:TRIES]:
        try:
            way: Act = walk(world, state, to=Point(*place))
        except UserError as error:  # as on the other side of a wall
            why = str(error)
            continue
        return way, way.then
    raise UserError(f"nowhere within {FURTHEST * size:.2f} m of [{x:.2f}, {z:.2f}] can somebody stand: {why}")


def _told(
    way: Act | None, here: State, wanted: float, says: str, seconds: float
) -> tuple[tuple[Prompt, ...], float, float]:
    """The sentences: the walk's, a turn where one is needed, and what is done; when that begins and ends (s)."""
    before, begin = ((), 0.0) if way is None else (way.prompts(0.0, way.seconds), way.seconds)
    turned = between(wanted - here.heading)
    if abs(turned) <= ABOUT:
        return (*before, Prompt(says, begin)), begin, begin + seconds
    turns = "turns around" if abs(turned) > FULL else f"turns to the {side(turned)}"
    then = begin + turning(turned)
    return (*before, Prompt(f"a person {turns}.", begin), Prompt(says, then)), then, then + seconds


def _thing(hand: Hand) -> str:
    return "a box with both hands" if hand == "both" else f"something with the {hand} hand"


def _hands(hand: Hand, window: tuple[float, float]) -> dict[str, tuple[float, float]]:
    """Parts of the body that touch things meanwhile."""
    sides: tuple[Literal["left", "right"], ...] = ("left", "right") if hand == "both" else (hand,)
    return {f"{side}_{joint}": window for side in sides for joint in ("wrist", "elbow")}
