"""Sitting down on what is in a scene, and getting up."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

from objectives import Point, Term
from objectives.library.contacts import OWNERS
from scenectl.generators.prompts import Prompt
from scenectl.tasks.actions.library._common import (
    ABOUT,
    FULL,
    NEAR,
    Seconds,
    facing,
    on_the_way_there,
    side,
    turning,
    upright,
)
from scenectl.tasks.actions.library.going import walk
from scenectl.tasks.actions.registry import action
from scenectl.tasks.actions.state import Act, State, World, turn as between
from scenectl.tasks.walk import room_of
from scenes.body.body import ProxyBody
from scenes.errors import UserError
from scenes.motion.skeleton import FEET
from scenes.world.seats import NARROW, Seat, find_seat

DOWN, UP = 1.5, 2.0
"""Seconds that sitting down and standing up take, about as long as in the pieces found in recordings (`scenectl bench
data` draws them): people shift their weight before and settle after. Ours."""
LEAVING = 0.2
"""Seconds for which one still stands, or sits, when one begins."""
HIPS = 0.10
"""Metres from a seat to the joints of the hips (`scenectl.data.edits.seats`)."""
AWAY, FAST = 2.0, 10.0
"""Metres from a seat, and metres a second, that are as good while one is on the way to it."""
THIGHS = OWNERS["seat"]
"""Joints whose part of the body is on a seat."""


@action()
def sit(world: World, state: State, *, on: str | Point, seconds: Seconds = 3.0, heading: float | None = None) -> Act:
    """Sit down on a part of the scene, or on the surface at a point, and stay there.

    Where to stand before it, which way to turn and how high it is are read off the scene; whoever stands elsewhere
    walks there first.

    Args:
        on: name of a part of the scene, such as a node of its file, or [x, y, z] on a surface, world m.
        seconds: how long to stay on the seat once one is down, s.
        heading: which way to sit, rad about +y; by default with the back to a backrest, or to where one comes from.
    """
    where = on if isinstance(on, str) else list(on)
    seat = find_seat(world.scene, world.area(*room_of(world.body)), where, state.place, heading)
    way, here = _approach(world, state, seat)
    turned = between(seat.heading - here.heading)
    begin = 0.0 if way is None else way.seconds
    down = begin + (turning(turned) if abs(turned) > ABOUT else 0.0)
    rests, lasts = down + DOWN, down + DOWN + seconds
    keeps = _seated(world.body, seat, on)
    terms = [replace(term, window=(rests, lasts)) for term in keeps]
    terms.append(facing(seat.heading, (down, lasts)))
    terms.append(upright(world, seat.stand[1], (begin, down)))
    terms += _on_the_way(keeps, (down + LEAVING, rests))
    place = (seat.hips[0], seat.stand[1], seat.hips[2])
    then = replace(
        state, place=place, heading=seat.heading, posture="sitting", keeps=keeps, touches=THIGHS, feet=seat.stand
    )
    before = () if way is None else way.prompts(0.0, begin)
    turns = "turns around" if abs(turned) > FULL else f"turns to the {side(turned)}"
    told = [Prompt(f"a person {turns}.", begin)] if down > begin else []
    told += [Prompt("a person sits down on a chair.", down), Prompt("a person sits on a chair.", rests)]
    path, first = None if way is None else way.path, on_the_way_there(way)
    return Act((*before, *told), lasts, then, (*first, *terms), path, dict.fromkeys(THIGHS, (down, lasts)))


@action(posture="sitting")
def stand_up(world: World, state: State, *, seconds: Seconds = UP) -> Act:
    """Stand up from a seat.

    Args:
        seconds: how long it takes, s.
    """
    if state.feet is None:
        raise UserError("nobody knows where the feet are; sit down by an action 'sit'")
    x, _, z = state.feet
    end = (max(seconds - 0.3, 0.0), seconds)
    target = Term("joint_target", {"joint": "pelvis", "position": [x, z]}, tolerance=0.2, window=end, name="up")
    still = [replace(term, window=(0.0, LEAVING)) for term in state.keeps]
    leaves, tall = _on_the_way(state.keeps, (LEAVING, 0.8 * seconds)), upright(world, state.feet[1], end)
    terms = (*still, *leaves, target, tall, facing(state.heading, end))
    touches = dict.fromkeys(THIGHS, (0.0, 0.8 * seconds))
    then = state.at(state.feet, state.heading)
    return Act("a person stands up from a chair.", seconds, then, terms, None, touches)


def _on_the_way(keeps: tuple[Term, ...], window: tuple[float, float]) -> list[Term]:
    """To a seat or from it: not in it, and carried by it as soon and as long as one touches it."""
    free = {"within": AWAY, "slide": FAST}
    return [
        replace(term, parameters={**term.parameters, **free}, window=window, name=f"{term.name} on the way")
        for term in keeps
        if term.support is not None
    ]


def _approach(world: World, state: State, seat: Seat) -> tuple[Act | None, State]:
    """The walk to where one stands before a seat, None where one stands there; and the state then."""
    x, _, z = seat.stand
    if (state.place[0] - x) ** 2 + (state.place[2] - z) ** 2 <= NEAR**2:
        return None, state
    way = walk(world, state, to=Point(*seat.stand), radius=NARROW)
    return way, way.then


def _seated(body: ProxyBody, seat: Seat, on: str | Point) -> tuple[Term, ...]:
    """What holds while one sits: seat and thighs on the surface, both feet down, nothing glides."""
    names, offsets = body.skeleton.names, body.skeleton.offsets
    rise = -float(offsets[names.index("left_hip")][1])
    x, y, z = seat.hips
    middle = {"joint": "pelvis", "position": [x, y + HIPS * body.size + rise, z]}
    surface = {"surface": on} if isinstance(on, str) else {}
    squares: dict[str, Any] = {"kernel": "squared", "reduction": "sum"}
    return (
        Term("joint_target", middle, 0.5, tolerance=0.1, name="seated"),
        Term("contact", {"part": "seat", **surface}, 20.0, tolerance=0.03, name="seat"),
        Term("foot_contact", {"feet": list(FEET), "each": True}, 100.0, tolerance=0.05, name="feet down", **squares),
    )
