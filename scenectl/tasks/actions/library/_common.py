"""What several actions ask for: staying at a place, facing a way, and places of both kinds."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Annotated, Any

from pydantic import Field

from objectives import FloorPoint, Point, Term
from scenectl.tasks.actions.state import Act, State, World
from scenes.errors import UserError

Place = Point | FloorPoint
"""[x, z] on the floor, or [x, y, z], world m."""
Seconds = Annotated[float, Field(gt=0, le=120)]
"""A duration."""
Speed = Annotated[float, Field(gt=0.1, le=4.0)]
"""Metres a second on foot."""

FULL, ABOUT = math.radians(120), math.radians(35)
"""Turns from which on a sentence says "turns around", and from which on it says that somebody turns (rad)."""
TURNING, SETTLING = math.radians(105), 0.6
"""Turns in place take the time for this rate (rad/s) and so much longer (s), about as long as those found in
recordings (`scenectl bench data` draws them); ours."""
UPRIGHT = 0.85
"""Metres over the ground of an adult's pelvis that stands or bends the knees a little; with straight legs it is at
0.93."""
NEAR = 0.25
"""Metres within which somebody stays who does something on the spot."""


def kept(state: State, seconds: float) -> tuple[Term, ...]:
    """What holds while the body stays as it is: the pelvis near its place, and what its posture keeps."""
    x, _, z = state.place
    near: dict[str, Any] = {"path": [[x - 1e-3, z], [x + 1e-3, z]], "half_width": NEAR}
    stays = Term("follow_path", near, 0.5, tolerance=0.05, window=(0.0, seconds), name="stays")
    return stays, *(replace(term, window=(0.0, seconds)) for term in state.keeps)


def facing(heading: float, window: tuple[float, float], within: float = 20.0, weight: float = 1.0) -> Term:
    """The pelvis turned to a heading (rad) within so many degrees."""
    asked = {"part": "pelvis", "heading": heading, "within": within}
    return Term("face", asked, weight, tolerance=15.0, window=window, name="faces")


def upright(world: World, ground: float, window: tuple[float, float]) -> Term:
    """The pelvis as high over the ground (m, world) as that of somebody who stands, or nearly."""
    tall: dict[str, Any] = {"limit": ground + UPRIGHT * world.body.size, "mode": "above", "joints": "pelvis"}
    return Term("height_limit", tall, 200.0, tolerance=0.05, window=window, name="upright")


def on_the_way_there(way: Act | None) -> tuple[Term, ...]:
    """Goals of the walk that an act begins with; nobody stands still at its end who goes on to do something there."""
    if way is None:
        return ()
    return tuple(term.during(0.0, way.seconds) for term in way.terms if term.spec.name != "speed_limit")


def free_hand(state: State, hand: str) -> None:
    """Raises UserError where a hand, or one of "both", holds something."""
    if state.holds and (hand == "both" or state.holds[0].parameters["hand"] in (hand, "both")):
        raise UserError(f"the hand holds '{state.held}'; put it down first, or use another hand")


def turning(way: float) -> float:
    """Seconds in which somebody turns by an angle (rad) in place."""
    return abs(way) / TURNING + SETTLING


def side(way: float) -> str:
    """ "left" or "right", of a turn (rad about +y)."""
    return "left" if way > 0 else "right"
