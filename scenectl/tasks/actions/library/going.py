"""Getting somewhere on foot."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Annotated, Literal

import numpy as np
from pydantic import Field

from objectives import Term
from scenectl.generators.prompts import Prompt
from scenectl.tasks.actions.library._common import ABOUT, FULL, Place, Seconds, Speed, facing, side, turning
from scenectl.tasks.actions.registry import action
from scenectl.tasks.actions.state import Act, State, World, turn as between
from scenectl.tasks.walk import BRAKE, FASTEST_WALK, PACE, STAND, Walk, walk_terms
from scenes.errors import UserError
from scenes.world.floor.levels import STEP
from scenes.world.floor.planning import FreeArea
from scenes.world.floor.polyline import climbs, walked

Way = Literal["forwards", "backwards", "sideways"]
Radius = Annotated[float, Field(gt=0.05, le=1.0)]
Height = Annotated[float, Field(gt=0.3, le=3.0)]

SLOWER = {"forwards": 1.0, "backwards": 0.6, "sideways": 0.5}
"""Share of the usual pace at which people walk each way."""
ALONG = 4.0
"""Factor on the weight of a level way: without it, a walk that begins with a turn takes twice the passes to get on its
way (`examples/tasks/flat_six.toml`); with it, nobody comes to stand at the head of steps."""
STARTS = 0.5
"""Seconds that it takes to get going from where one stands, about as long as in the starts found in recordings
(`scenectl bench data` draws them). Ours."""
ONE_STEP = 0.35
"""Seconds that each step up or down takes besides: with 0.3 m of tread at the usual pace, about 0.6 s a step. Ours."""
OUT = 0.6
"""Metres within which somebody who stands close to a thing, as in front of a seat, steps away from it."""
AHEAD = 0.4
"""Metres of a path whose direction is that in which it begins or ends."""


@action()
def walk(
    world: World,
    state: State,
    *,
    to: Place,
    via: list[Place] = [],  # noqa: B006  (read only)
    how: Way = "forwards",
    speed: Speed | None = None,
    seconds: Seconds | None = None,
    radius: Radius | None = None,
    height: Height | None = None,
    tolerance: Annotated[float, Field(gt=0)] = 0.1,
) -> Act:
    """Walk to a place around what is in the way, over steps and slopes where no level way exists, and stop there.

    Args:
        to: where the pelvis shall be in the end, world m; [x, y, z] says which storey.
        via: places to pass on the way, in order.
        how: "forwards", "backwards" or "sideways".
        speed: m/s; by default the usual one of that way.
        seconds: how long, instead of a speed, s.
        radius: of what is kept free while planning, m; by default the body's.
        height: that shall be free over the way, m; less where the body shall duck.
        tolerance: how near counts as there, m.
    """
    if speed is not None and seconds is not None:
        raise UserError("needs 'speed' or 'seconds', not both")
    table = Walk(to=tuple(to), via=tuple(map(tuple, via)), radius=radius, height=height, tolerance=tolerance)
    area = world.area(*table.room(world.body))
    path = _way(table, area, state)
    length, pace = walked(path), PACE * world.body.size * SLOWER[how]
    first, last = _direction(path), _direction(path[::-1]) + math.pi
    offset = _offset(how, first, state)
    way = between(first + offset - state.heading)
    begin = turning(way) if abs(way) > ABOUT else 0.0
    lasts = (
        seconds or begin + STARTS + length / (speed or pace) + ONE_STEP * len(climbs(path, STEP)) + BRAKE / 2 + STAND
    )
    begin = min(begin, lasts / 2)
    if length > (most := FASTEST_WALK * world.body.size * 1.5) * (lasts - begin):
        raise UserError(
            f"the way is {length:.1f} m long, too far to walk in {lasts - begin:.1f} s; a walk goes at {most:.1f} m/s "
            "at most"
        )
    walking = walk_terms(table, path, lasts - begin, world.spec.fps, (), world.body)
    terms = [_among_acts(term, frame=1 / world.spec.fps).during(begin, lasts) for term in walking]
    if how != "forwards":
        terms += _turned(path, offset, (begin, lasts))
    then = state.at(path[-1], last + offset)
    goes = _goes(how, offset, path, height is not None and height < world.body.height)
    return Act(_told(goes, way, begin), lasts, then, tuple(terms), path)


@action()
def climb(world: World, state: State, *, to: Place, seconds: Seconds | None = None) -> Act:
    """Walk up or down steps to a place.

    Args:
        to: where the pelvis shall be in the end, world m; [x, y, z] says which storey.
        seconds: how long, s; by default what the way takes.
    """
    way: Act = walk(world, state, to=to, seconds=seconds)
    if way.path is None or not len(climbs(way.path, STEP)):
        raise UserError("the way there takes no steps; use 'walk'")
    return way


def _among_acts(term: Term, frame: float) -> Term:
    """A goal of a walk between other acts: level ways weigh more, and limits of speeds leave out their last frame (s),
    whose speed is that at which the next act begins."""
    if term.spec.name == "follow_path" and term.parameters.get("height") is None:
        return replace(term, weight=ALONG * term.weight)
    if term.spec.name != "speed_limit" or term.window is None:
        return term
    begin, end = term.window
    return replace(term, window=(begin, max(end - frame, begin)))


def _way(table: Walk, area: FreeArea, state: State) -> np.ndarray:
    """The planned way; from a place too close to a thing, over the nearest one that is free."""
    start = state.place
    if area.free(start):
        return table.path(area, start)
    x, y, z = start
    for away in np.arange(0.05, OUT + 0.01, 0.05):
        for angle in state.heading + np.linspace(0, 2 * np.pi, 16, endpoint=False):
            near = (x + float(away * np.sin(angle)), y, z + float(away * np.cos(angle)))
            if area.free(near):
                return np.concatenate([[start], table.path(area, near)])
    return table.path(area, start)  # which says what is in the way


def _direction(path: np.ndarray) -> float:
    """Heading (rad) from the first point of a path to one `AHEAD` of it."""
    flat = path[:, [0, 2]]
    ahead = next((p for p in flat if np.linalg.norm(p - flat[0]) >= AHEAD), flat[-1])
    return math.atan2(*(ahead - flat[0]))


def _offset(how: Way, first: float, state: State) -> float:
    """By how much (rad) the body faces another way than it goes; to the side that it has to turn less for."""
    if how == "forwards":
        return 0.0
    if how == "backwards":
        return math.pi
    return min((math.pi / 2, -math.pi / 2), key=lambda offset: abs(between(first + offset - state.heading)))


def _turned(path: np.ndarray, offset: float, window: tuple[float, float]) -> list[Term]:
    """Facing another way than one goes, all along a way that is nearly straight."""
    flat = path[:, [0, 2]]
    straight = math.atan2(*(flat[-1] - flat[0]))
    return [facing(straight + offset, window, within=30.0, weight=0.3)]


def _goes(how: Way, offset: float, path: np.ndarray, low: bool) -> str:
    """What is said of the way."""
    if how == "backwards":
        return "walks backwards"
    if how == "sideways":
        return f"steps sideways to the {side(-offset)}"
    return _climbed(path) or ("walks forward and ducks" if low else "walks forward")


def _told(goes: str, way: float, begin: float) -> tuple[Prompt, ...]:
    """Turning, where the way begins in another direction, and going."""
    if begin == 0.0:
        return (Prompt(f"a person {goes}."),)
    turns = "turns around" if abs(way) > FULL else f"turns to the {side(way)}"
    return Prompt(f"a person {turns}."), Prompt(f"a person {goes}.", begin)


def _climbed(path: np.ndarray) -> str | None:
    """What is said of a way over steps; None where it takes hardly any."""
    taken = climbs(path, STEP)
    if len(taken) < 2:
        return None
    return "walks up some steps" if taken.sum() > 0 else "descends some steps"
