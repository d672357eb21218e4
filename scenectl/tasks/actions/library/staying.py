"""What is done on the spot: standing, turning, looking, waving, ducking, and whatever a sentence says."""

from __future__ import annotations

from typing import Literal

from objectives import Point, Term
from scenectl.tasks.actions.library._common import FULL, Place, Seconds, facing, free_hand, kept, side, turning
from scenectl.tasks.actions.registry import action
from scenectl.tasks.actions.state import Act, State, World, turn as between
from scenes.errors import UserError


@action()
def stand(world: World, state: State, *, seconds: Seconds = 2.0) -> Act:
    """Stand where one is, relaxed.

    Args:
        seconds: how long, s.
    """
    return Act("a person stands still.", seconds, state, kept(state, seconds))


@action()
def turn(
    world: World,
    state: State,
    *,
    to: Place | None = None,
    heading: float | None = None,
    seconds: Seconds | None = None,
) -> Act:
    """Turn on the spot, to a place or to a heading.

    Args:
        to: place to face, world m.
        heading: rad about +y to face instead, 0 is +z and pi/2 is +x.
        seconds: how long, s; by default what a turn by that angle takes.
    """
    if (to is None) == (heading is None):
        raise UserError("needs either 'to' or 'heading'")
    wanted = state.towards(to.x, to.z) if to is not None else float(heading or 0.0)
    way = between(wanted - state.heading)
    lasts = seconds or turning(way)
    text = "a person turns around." if abs(way) > FULL else f"a person turns to the {side(way)}."
    return Act(text, lasts, state.facing(wanted), (*kept(state, lasts), facing(wanted, (max(lasts - 0.3, 0.0), lasts))))


@action(posture=None)
def look_at(world: World, state: State, *, at: Point, seconds: Seconds = 2.0) -> Act:
    """Turn the chest to a place, and stay so.

    Args:
        at: place to look at, world m.
        seconds: how long, s.
    """
    x, z = at.x, at.z
    asked = {"part": "chest", "position": [x, z], "within": 25.0}
    looks = Term("face", asked, tolerance=15.0, window=(seconds / 2, seconds), name="looks")
    posture = "sits" if state.posture == "sitting" else "stands still"
    return Act(f"a person {posture}.", seconds, state, (*kept(state, seconds), looks))


@action(posture=None)
def wave(
    world: World, state: State, *, hand: Literal["left", "right", "both"] = "right", seconds: Seconds = 3.0
) -> Act:
    """Wave.

    Args:
        hand: with which.
        seconds: how long, s.
    """
    free_hand(state, hand)
    which = "both hands" if hand == "both" else f"the {hand} hand"
    sits = "sits and " if state.posture == "sitting" else ""
    return Act(f"a person {sits}waves with {which}.", seconds, state, kept(state, seconds))


@action()
def duck(world: World, state: State, *, below: float | None = None, seconds: Seconds = 3.0) -> Act:
    """Duck on the spot, and stand up again.

    Args:
        below: height over the ground that the head gets under, m; by default three quarters of the body's.
        seconds: how long, s.
    """
    limit = 0.75 * world.body.height if below is None else below
    if not 0.5 * world.body.height <= limit <= world.body.height:
        raise UserError(
            f"'below' is {limit:g} m; give {0.5 * world.body.height:.2f} to {world.body.height:.2f} m for this body"
        )
    asked = {"height": state.place[1] + limit - 0.15, "mode": "below"}
    low = Term("head_height", asked, 20.0, sometime=(0.3 * seconds, 0.7 * seconds), name="ducks")
    return Act("a person ducks and stands up again.", seconds, state, (*kept(state, seconds), low))


@action(posture=None)
def act(world: World, state: State, *, prompt: str, seconds: Seconds, stay: bool = True) -> Act:
    """Whatever a sentence says; [[action.goal]] tables ask for more.

    Args:
        prompt: the sentence.
        seconds: how long, s.
        stay: it is done on the spot; otherwise nobody knows where it ends, and it must be the last action.
    """
    if not prompt.strip():
        raise UserError("'prompt' is empty; say what the person does")
    return Act(prompt, seconds, state, kept(state, seconds) if stay else (), last=not stay)
