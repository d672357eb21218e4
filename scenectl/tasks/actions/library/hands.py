"""What hands do."""

from __future__ import annotations

import math
from typing import Annotated, Literal

from pydantic import Field

from objectives import Point, Term
from scenectl.tasks.actions.library._common import Seconds, kept
from scenectl.tasks.actions.registry import action
from scenectl.tasks.actions.state import Act, State, World
from scenes.errors import UserError

REACH = 1.0
"""Metres from the vertical through the pelvis to where the hand of an adult gets who leans: an arm of 0.65 m, and
0.35 m by which the shoulder comes forward."""
OVER = (0.0, 2.0)
"""Heights (m) over the ground at which an adult's hand gets."""


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
