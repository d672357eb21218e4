"""Walks: they end standing, pass places in order, and let go of what later goals ask for."""

from __future__ import annotations

from itertools import pairwise
from typing import Any

import numpy as np
import pytest
import torch
from hypothesis import given, settings, strategies as st

from objectives import Term
from objectives.library.paths import path_point
from scenectl.tasks.setup import Setup
from scenectl.tasks.task import Task
from scenectl.tasks.walk import BRAKE, PACE, STAND, Schedule, Walk, walk_terms
from scenes.body.body import DEFAULT_BODY, ProxyBody
from scenes.errors import UserError
from scenes.motion.motion import Motion
from scenes.world.scene import Scene
from tests.objectives.cases import context, standing

FPS = 20.0
END = {"walk: stop", "walk: standing", "walk: feet down"}


def built(walk: dict[str, Any], seconds: float | None = None, goals: tuple[Any, ...] = (), **more: Any) -> Setup:
    table = {"to": [0.0, 4.0], **walk}
    given = {"seconds": seconds, "walk": table, "goals": goals, **more}
    return Task(prompt="x", scene=Scene.empty(), start=[0.0, 0.0], **given).build()


def by_name(setup: Setup) -> dict[str, Term]:
    return {term.name: term for term in setup.objective.terms}


def straight(*places: tuple[float, float]) -> np.ndarray:
    """A path through places, a vertex every 5 cm."""
    legs = [
        np.linspace(a, b, max(2, int(np.hypot(*np.subtract(b, a)) / 0.05)))
        for a, b in zip(places, places[1:], strict=False)
    ]
    flat = np.concatenate([legs[0], *(leg[1:] for leg in legs[1:])])
    return np.stack([flat[:, 0], np.zeros(len(flat)), flat[:, 1]], axis=1)


@settings(deadline=None, max_examples=40)
@given(st.floats(1.8, 60.0), st.booleans(), st.floats(0.0, 1.0), st.none() | st.floats(0.1, 60.0))
def test_a_schedule_is_the_corridors(seconds: float, stop: bool, share: float, arrive: float | None) -> None:
    schedule = Schedule.of(Walk(to=(0.0, 4.0), stop=stop, arrive=arrive), seconds, FPS)
    assert 0 < schedule.arrive <= schedule.last and 0 <= schedule.brake <= schedule.arrive
    assert not stop or schedule.last - schedule.arrive >= STAND - 1e-9
    corridor = walk_terms(Walk(to=(0.0, 4.0), stop=stop, arrive=arrive), straight((0, 0), (0, 4)), seconds, FPS)[0]
    time = schedule.passed(share)
    motion = Motion(standing(1).float(), fps=FPS, t0=time)
    found = corridor.evaluate(motion, context())
    assert found.targets is not None
    assert float(found.targets[0, 1, 2]) == pytest.approx(4.0 * share, abs=2e-3)


def test_time_is_added_for_the_stop() -> None:
    stops, goes = built({}), built({"stop": False})
    assert stops.seconds - goes.seconds == pytest.approx(BRAKE / 2 + STAND, abs=0.11)
    assert goes.seconds == pytest.approx(4.0 / PACE, abs=0.06)
    assert set(by_name(stops)) - set(by_name(goes)) == END
    early, late = built({}, seconds=5.0), built({"stop": False}, seconds=5.0)
    assert early.seconds == late.seconds == 5.0
    assert by_name(late)["walk: arrive"].times == (4.95,)
    assert by_name(early)["walk: arrive"].window == pytest.approx((4.95 - STAND, 4.95))
    assert by_name(early)["walk: path"].parameters["end"] == pytest.approx(4.95 - STAND)


def test_too_far_to_stop_is_said() -> None:
    assert built({"stop": False}, seconds=2.6).seconds == 2.6
    with pytest.raises(UserError, match=r"too far to walk in 2.6 s and stop \(stop = false walks on\)"):
        built({}, seconds=2.6)


def ending(speed: float, high: float) -> Motion:
    """A person who walks 4 m in 4.6 s and is at the end then, at this speed and with the left foot so high."""
    joints = standing(100).float()
    far = torch.linspace(0.0, 4.0, 94)
    z = torch.cat([far, 4.0 + speed / FPS * torch.arange(1, 7)])
    joints = joints - joints[:, :1] * torch.tensor([1.0, 0.0, 1.0])
    joints[..., 2] += z[:, None]
    joints[-9:, 10, 1] += high
    return Motion(joints, fps=FPS)


@pytest.mark.parametrize(
    ("speed", "high", "unmet"),
    [
        (0.0, 0.0, set()),
        (0.15, 0.0, set()),
        (0.3, 0.0, {"walk: stop", "walk: standing"}),
        (1.2, 0.0, {"walk: stop", "walk: standing", "walk: arrive"}),
        (0.0, 0.2, {"walk: feet down"}),
    ],
)
def test_who_walks_on_has_not_stopped(speed: float, high: float, unmet: set[str]) -> None:
    setup = built({}, seconds=5.0)
    stop = [term for term in setup.objective.terms if term.name in END | {"walk: arrive"}]
    motion = ending(speed, high)
    lowest = motion.select(("left_foot", "right_foot"))[..., 1].min()
    motion = Motion(motion.joints - (lowest - DEFAULT_BODY.sole_offset) * torch.tensor([0.0, 1.0, 0.0]), fps=FPS)
    assert {term.name for term in stop if not term.met(motion, setup.context)} == unmet


PLACES = ((1.0, 1.0), (0.0, 2.0), (1.0, 1.0), (0.0, 3.0))


def test_places_on_the_way_are_goals_in_order() -> None:
    walk = Walk(to=(0.0, 4.0), via=PLACES, via_tolerance=0.12)
    terms = walk_terms(walk, straight((0, 0), *PLACES, (0, 4)), 9.0, FPS)
    vias = [term for term in terms if term.name.startswith("walk: via")]
    assert [term.name for term in vias] == [f"walk: via {k}" for k in (1, 2, 3, 4)]
    assert [tuple(term.parameters["position"]) for term in vias] == list(PLACES)
    assert {term.allowed for term in vias} == {0.12} and Walk(to=(0.0, 4.0)).via_tolerance == 0.15
    spans = [term.sometime for term in vias]
    assert all(a is not None and b is not None and a[1] <= b[0] + 1e-9 for a, b in pairwise(spans))


def test_who_cuts_a_corner_or_turns_the_order_around_misses_a_place() -> None:
    path = straight((0, 0), *PLACES, (0, 4))
    terms = walk_terms(Walk(to=(0.0, 4.0), via=PLACES, stop=False), path, 9.0, FPS)
    flat = torch.tensor(path[:, [0, 2]])

    def unmet(route: torch.Tensor) -> set[str]:
        joints = standing(180)
        joints = joints - joints[:, :1] * torch.tensor([1.0, 0.0, 1.0])
        joints[..., ::2] += path_point(route, torch.linspace(0, 1, 180, dtype=joints.dtype))[:, None]
        return {t.name for t in terms if not t.met(Motion(joints, fps=FPS), context()) and "via" in t.name}

    assert not unmet(flat)
    beside = flat.clone()
    beside[:, 0] = beside[:, 0].clamp_max(0.8)
    assert unmet(beside) == {"walk: via 1", "walk: via 3"}
    assert unmet(torch.tensor([[0.0, 0.0], [0.0, 3.0], [1.0, 1.0], [0.0, 2.0], [0.0, 4.0]], dtype=flat.dtype))


@pytest.mark.parametrize("via", [((0.0, 0.0),), ((0.0, 2.0), (0.0, 2.02)), ((0.0, 4.0),)])
def test_places_close_together_each_have_a_moment(via: tuple[tuple[float, float], ...]) -> None:
    setup = built({"via": [list(place) for place in via]}, seconds=6.0)
    assert sum("via" in name for name in by_name(setup)) == len(via)


WRIST = {"use": "joint_target", "joint": "right_wrist", "position": [0.3, 1.2, 4.5], "at": 4.5}
LATER = {
    "the pelvis": {"use": "joint_target", "position": [2.0, 4.0], "at": 4.5},
    "a foot": {"use": "joint_target", "joint": "left_foot", "position": [0.2, 0.5, 4.5], "at": 4.5},
    "a place out of reach": {**WRIST, "position": [2.0, 1.2, 4.0]},
    "a way": {"use": "follow_path", "path": [[0.0, 4.0], [2.0, 4.0]], "begin": 3.0, "end": 5.0},
    "a limit on a leg": {
        "use": "height_limit",
        "joints": ["left_foot"],
        "limit": 0.4,
        "mode": "above",
        "window": [4, 5],
    },
}


@pytest.mark.parametrize("what", LATER)
def test_after_arrival_nothing_is_held_that_a_later_goal_asks_for(what: str) -> None:
    setup = built({"arrive": 3.0}, seconds=6.0, goals=(LATER[what],))
    for term in setup.objective.terms:
        if term.name.startswith("walk"):
            last = term.times or term.window
            assert last is not None and max(last) <= 3.0 + STAND + 1e-6, term.name


@pytest.mark.parametrize("goal", [None, WRIST, {**LATER["the pelvis"], "at": 2.0, "position": [0.0, 2.6]}])
def test_others_find_a_person_who_stands_there(goal: dict[str, Any] | None) -> None:
    terms = by_name(built({"arrive": 3.0}, seconds=6.0, goals=() if goal is None else (goal,)))
    assert terms["walk: path"].window is None
    assert terms["walk: arrive"].window == pytest.approx((3.0, 3.0 + STAND))
    assert terms["walk: stop"].window == pytest.approx((3.0, 5.95))
    assert terms["walk: feet down"].window == pytest.approx((5.95 - STAND, 5.95))


@pytest.mark.parametrize("height", [1.25, 2.05])
def test_walks_go_with_the_legs(height: float) -> None:
    ratio, stop = height / 1.7, BRAKE / 2 + STAND
    adult, other = built({}), built({}, body={"height": height})
    assert other.seconds - stop == pytest.approx((adult.seconds - stop) / ratio, abs=0.11)
    assert other.start.position[1] == pytest.approx(ratio * adult.start.position[1])
    lag = [by_name(setup)["walk: path"].parameters["lag"] for setup in (adult, other)]
    assert lag[1] == pytest.approx(ratio * lag[0])
    enough = 4.0 / (1.6 * ratio) + 0.1
    assert built({"stop": False}, seconds=max(enough, 1.8), body={"height": height}).seconds
    if ratio < 1:
        with pytest.raises(UserError, match="too far to walk"):
            built({"stop": False}, seconds=2.6, body={"height": height})  # an adult can


def test_room_is_kept_for_the_body_unless_it_is_stated() -> None:
    child, giant = ProxyBody.human(1.25), ProxyBody.human(2.05)
    assert Walk(to=(0.0, 4.0)).room(DEFAULT_BODY) == (0.3, 1.8)
    assert Walk(to=(0.0, 4.0)).room(child) == pytest.approx((0.3 * 1.25 / 1.7, 1.8 * 1.25 / 1.7), abs=2e-3)
    assert Walk(to=(0.0, 4.0), radius=0.25, height=1.4).room(giant) == (0.25, 1.4)
