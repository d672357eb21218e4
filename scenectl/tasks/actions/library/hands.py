"""What hands do."""

from __future__ import annotations

import math
from typing import Annotated, Literal

from pydantic import Field

from objectives import Point, Term
from scenectl.tasks.actions.library._common import Seconds, facing, free_hand, kept
from scenectl.tasks.actions.registry import action
from scenectl.tasks.actions.state import Act, State, World
from scenes.errors import UserError

REACH = 1.0
"""Metres from the vertical through the pelvis to where the hand of an adult gets who leans: an arm of 0.65 m, and
0.35 m by which the shoulder comes forward."""
OVER = (0.0, 2.0)
"""Heights (m) over the ground at which an adult's hand gets."""
LEANT, APART = (0.6, 1.5), 0.18
"""Heights (m) over the ground at which an adult leans on hands, and metres of each from the middle between both: those
of the edits of recordings that a model learns (`scenectl/data/edits/lean.py`). Ours."""


@action()
def reach(
    world: World,
    state: State,
    *,
    to: Point,
    hand: Literal["left", "right"] = "right",
    hold: Annotated[float, Field(ge=0, le=60)] = 0.3,
    seconds: Seconds = 2.7,
    tolerance: Annotated[float, Field(gt=0)] = 0.05,
) -> Act:
    """Reach for a point with a hand, whose wrist comes there.

    Args:
        to: the point, world m.
        hand: "left" or "right".
        hold: how long the wrist stays there, s.
        seconds: how long all of it takes, s.
        tolerance: how near counts as there, m.
    """
    free_hand(state, hand)
    away, over = math.dist(state.place[::2], (to.x, to.z)), to.y - state.place[1]
    size = world.body.size
    if away > REACH * size or not OVER[0] <= over <= OVER[1] * size:
        raise UserError(
            f"the point is {away:.2f} m away and {over:.2f} m high, and a hand gets {REACH * size:.2f} m far and "
            f"{OVER[1] * size:.2f} m high; walk nearer first"
        )
    if hold >= 0.8 * seconds:
        raise UserError(f"'hold' is {hold:g} s of {seconds:g} s; leave time to get there")
    middle = (seconds - hold) * 0.6
    wrist = {"joint": f"{hand}_wrist", "position": list(to)}
    there = Term("joint_target", wrist, tolerance=tolerance, window=(middle, middle + hold), name="reaches")
    arm = (f"{hand}_wrist", f"{hand}_elbow")
    return Act(
        f"a person reaches out with the {hand} hand.", seconds, state, (*kept(state, seconds), there), None,
        dict.fromkeys(arm, (0.3 * seconds, seconds)),
    )  # fmt: skip


@action()
def lean(
    world: World, state: State, *, on: Point, hand: Literal["left", "right", "both"] = "both", seconds: Seconds = 4.0
) -> Act:
    """Lean on a surface with one hand or both, such as a table's edge or a wall, and straighten up again.

    Args:
        on: a point of the surface, world m; both hands rest beside it.
        hand: "left", "right" or "both".
        seconds: how long all of it takes, s; the hands rest for the middle half.
    """
    free_hand(state, hand)
    away, over = math.dist(state.place[::2], (on.x, on.z)), on.y - state.place[1]
    size = world.body.size
    if away > REACH * size or not LEANT[0] * size <= over <= LEANT[1] * size:
        raise UserError(
            f"the point is {away:.2f} m away and {over:.2f} m high, and hands that lean get {REACH * size:.2f} m far, "
            f"{LEANT[0] * size:.2f} to {LEANT[1] * size:.2f} m high; walk nearer first"
        )
    rests, wanted = (0.25 * seconds, 0.75 * seconds), state.towards(on.x, on.z)
    sides: tuple[Literal["left", "right"], ...] = ("left", "right") if hand == "both" else (hand,)
    terms = [*kept(state, seconds), facing(wanted, rests)]
    for side in sides:
        aside = 0.0 if len(sides) == 1 else (APART if side == "left" else -APART)
        place = [on.x + aside * math.cos(wanted), on.y, on.z - aside * math.sin(wanted)]
        asked = {"part": f"{side}_hand", "position": place}
        terms.append(Term("contact", asked, 5.0, tolerance=0.03, window=rests, name=f"{side} hand rests"))
    what = (
        "both hands on a table" if hand == "both" else f"one hand on {'a wall' if over > 1.0 * size else 'a counter'}"
    )
    way = "forward with" if hand == "both" else f"to the {hand} with"
    arms = [f"{side}_{joint}" for side in sides for joint in ("wrist", "elbow")]
    then = state.facing(wanted)
    return Act(
        f"a person leans {way} {what}.", seconds, then, tuple(terms), None, dict.fromkeys(arms, (0.0, 0.85 * seconds))
    )
