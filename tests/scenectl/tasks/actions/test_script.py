"""Scripts: actions are planned one from where the other ends, on one clock, and say what is wrong with them."""

from __future__ import annotations

import math
from collections.abc import Iterator
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch

from objectives import Term
from scenectl.tasks.actions import Act, State, World, action, actions, forget
from scenectl.tasks.setup import Setup
from scenectl.tasks.task import Task, load_task
from scenes.errors import UserError
from scenes.mesh.mesh import Mesh
from scenes.mesh.primitives import Box
from scenes.world.scene import Scene

FAR = (500_000.0, 0.0, 4_500_000.0)


def stool(o: tuple[float, float, float] = (0.0, 0.0, 0.0)) -> Scene:
    """A floor with a stool of 0.45 m at z = 2."""
    parts = [Box((0.0, -0.1, 0.0), (8.0, 0.2, 8.0)).mesh(), Box((0.0, 0.225, 2.0), (0.5, 0.45, 0.5)).mesh()]
    meshes = [Mesh(part.vertices + o, part.faces, name) for part, name in zip(parts, ("floor", "stool"), strict=True)]
    return Scene(meshes, resolution=64, cache=None)


def built(*tables: dict[str, Any], scene: Scene | None = None, **more: Any) -> Setup:
    start = more.pop("start", {"position": [0.0, 0.0], "heading": 0.0})
    return Task(actions=tables, scene=Scene.empty() if scene is None else scene, start=start, **more).build()


def refused(*tables: Any, **more: Any) -> str:
    with pytest.raises(UserError) as caught:
        built(*tables, **more)
    assert "\n" not in str(caught.value)
    return str(caught.value)


@pytest.fixture
def mine() -> Iterator[None]:
    """An action of a user's, in ten lines."""

    @action()
    def clap(world: World, state: State, *, times: int = 3) -> Act:
        """Clap the hands.

        Args:
            times: how often.
        """
        together = Term("joint_target", {"joint": "left_wrist", "position": [0.0, 1.2, 0.3]}, at=0.5 * times)
        return Act("a person claps.", 0.5 * times + 1.0, state, (together,))

    yield
    forget("clap")


def test_acts_follow_one_another_on_the_clock_of_the_frames() -> None:
    setup = built({"do": "walk", "to": [0.0, 2.01]}, {"do": "turn", "to": [2.0, 2.0]}, {"do": "stand", "seconds": 1.23})
    script = setup.script
    assert script is not None and setup.seconds == script.seconds == script.stretches[-1].end
    for one, other in pairwise(script.stretches):
        assert one.end == other.begin and one.act.then == other.before
    for one in script.stretches:
        assert math.isclose(one.end * 20, round(one.end * 20), abs_tol=1e-9)
    spans = [(p.begin, p.end) for p in setup.prompts.sentences]
    assert spans[0][0] == 0.0 and spans[-1][1] == setup.seconds
    assert all(a[1] == b[0] for a, b in pairwise(spans))


def test_a_walk_leads_on_from_where_the_one_before_ended() -> None:
    setup = built({"do": "walk", "to": [1.5, 0.0]}, {"do": "walk", "to": [1.5, 2.0]})
    assert setup.path is not None and setup.script is not None
    ways = [one.act.path for one in setup.script.stretches]
    assert all(way is not None for way in ways)
    np.testing.assert_allclose(ways[0][-1], ways[1][0], atol=1e-6)  # type: ignore[index]
    state = setup.script.stretches[-1].act.then
    assert state.place == pytest.approx((1.5, 0.0, 2.0)) and state.heading == pytest.approx(0.0, abs=0.05)


@pytest.mark.parametrize(("how", "heading"), [("backwards", math.pi), ("sideways", math.pi / 2)])
def test_who_walks_another_way_faces_another_way(how: str, heading: float) -> None:
    setup = built({"do": "walk", "to": [0.0, 2.0], "how": how}, start={"position": [0.0, 0.0], "heading": heading})
    assert setup.script is not None
    (one,) = setup.script.stretches
    assert one.act.then.heading == pytest.approx(heading if heading < math.pi else -math.pi)
    assert [prompt.text for prompt in setup.prompts.sentences] == [
        "a person walks backwards." if how == "backwards" else "a person steps sideways to the right."
    ]
    assert any(term.goal == "face" for term in setup.objective.terms)


def test_goals_of_an_action_count_from_where_it_begins() -> None:
    asked = {"use": "joint_target", "joint": "right_wrist", "position": [0.3, 1.2, 0.3], "at": 1.0}
    setup = built(
        {"do": "stand", "seconds": 2.0}, {"do": "act", "prompt": "a person points.", "seconds": 2, "goal": [asked]}
    )
    (term,) = (term for term in setup.objective.terms if term.name.endswith("joint_target"))
    assert term.times == (3.0,) and term.name == "2 act: joint_target"


def test_sitting_touches_the_seat_and_is_kept_by_what_follows() -> None:
    setup = built(
        {"do": "sit", "on": "stool", "seconds": 2.0}, {"do": "wave"}, {"do": "stand_up"}, {"do": "stand"}, scene=stool()
    )
    script = setup.script
    assert script is not None
    sits, waves, rises, stands = script.stretches
    assert [one.act.then.posture for one in script.stretches] == ["sitting", "sitting", "standing", "standing"]
    contacts = [t for t in setup.objective.terms if t.goal == "contact" and t.parameters.get("within", 0.0) == 0.0]
    assert [term.parameters["surface"] for term in contacts] == ["stool"] * 3
    assert contacts[1].window == pytest.approx((waves.begin, waves.end))
    assert contacts[2].window is not None and contacts[2].window[1] < rises.end
    assert all(end <= rises.end for windows in script.touches.values() for _, end in windows)
    assert stands.before.touches == ()
    (avoids,) = (term for term in setup.objective.terms if term.goal == "sdf_penetration")
    assert set(avoids.parameters["touches"]) == set(script.touches)
    assert sits.act.path is not None  # it walked there first


def test_a_script_far_from_the_origin_is_the_same_script() -> None:
    tables: list[dict[str, Any]] = [{"do": "walk", "to": [1.5, 1.0]}, {"do": "sit", "on": [0.0, 0.45, 2.0]}]
    there = [
        {"do": "walk", "to": [1.5 + FAR[0], 1.0 + FAR[2]]},
        {"do": "sit", "on": [FAR[0], 0.45 + FAR[1], 2.0 + FAR[2]]},
    ]
    begin = {"position": [-1.0, -1.0], "heading": 0.0}
    away = {"position": [FAR[0] - 1.0, FAR[2] - 1.0], "heading": 0.0}
    one, other = built(*tables, scene=stool(), start=begin), built(*there, scene=stool(FAR), start=away)
    assert other.origin != (0.0, 0.0, 0.0) and one.seconds == pytest.approx(other.seconds, abs=0.1)
    assert one.path is not None and other.path is not None
    np.testing.assert_allclose(one.path[-1], other.path[-1] + np.array(other.origin) - FAR, atol=0.06)


@pytest.mark.usefixtures("mine")
def test_an_action_of_ones_own() -> None:
    assert "clap" in {spec.name for spec in actions()}
    setup = built({"do": "stand"}, {"do": "clap", "times": 2})
    assert setup.prompts.sentences[-1].text == "a person claps."
    assert [term.times for term in setup.objective.terms if term.goal == "joint_target"] == [(3.0,)]
    assert "parameter 'times' must be a whole number" in refused({"do": "clap", "times": "two"})


@pytest.mark.parametrize(
    ("tables", "told"),
    [
        ([{"do": "wlak", "to": [0, 1]}], "action 1: unknown action 'wlak'; did you mean 'walk'?"),
        ([{"to": [0, 1]}], "action 1 needs 'do'"),
        (["walk"], "action 1 must be an [[action]] table"),
        ([{"do": "stand"}, {"do": "walk"}], "action 2: 'walk': parameter 'to' is missing"),
        ([{"do": "walk", "to": [0, 1], "sped": 1.0}], "unknown parameter 'sped'; did you mean 'speed'?"),
        ([{"do": "stand_up"}], "action 1 ('stand_up'): the body is standing when it begins; put an action 'sit'"),
        ([{"do": "turn"}], "needs either 'to' or 'heading'"),
        ([{"do": "reach", "to": [0.0, 1.2, 4.0]}], "the point is 4.00 m away"),
        ([{"do": "stand", "seconds": 1.0}], "the script lasts 1.00 s, and a motion lasts 1.8 s at least"),
        ([{"do": "stand", "seconds": 80}] * 2, "action 2 ('stand') ends at 160.0 s, and a motion lasts 120 s at most"),
        ([{"do": "stand", "goal": "x"}], "'goal' must be [[action.goal]] tables"),
        ([{"do": "walk", "to": [0, 5], "seconds": 1.0}], "too far to walk"),
        ([{"do": "act", "prompt": " ", "seconds": 2}], "'prompt' is empty"),
        (
            [{"do": "act", "prompt": "x", "seconds": 2, "stay": False}, {"do": "stand"}],
            "action 2 ('stand'): nobody knows where action 1 ('act') leaves the body",
        ),
        ([{"do": "duck", "below": 0.2}], "'below' is 0.2 m"),
    ],
)
def test_what_is_wrong_with_a_script_names_the_action(tables: list[Any], told: str) -> None:
    assert told in refused(*tables)


def test_a_seat_that_is_none() -> None:
    assert "scene 'scene' has no part 'stol'; did you mean 'stool'?" in refused(
        {"do": "sit", "on": "stol"}, scene=stool()
    )
    assert "'floor' has no surface between" in refused({"do": "sit", "on": "floor"}, scene=stool())
    assert "nothing to sit on" in refused({"do": "sit", "on": [2.0, 0.45, 2.0]}, scene=stool())


@pytest.mark.parametrize("key", ["prompt", "walk", "seconds"])
def test_a_script_excludes_what_it_states_itself(key: str) -> None:
    value: Any = {"prompt": "x", "walk": {"to": [0, 1]}, "seconds": 3.0}[key]
    assert f"'{key}' and [[action]] tables exclude each other" in refused({"do": "stand"}, **{key: value})


def test_a_script_in_a_file_is_dumped_and_read_again(tmp_path: Path) -> None:
    (tmp_path / "task.toml").write_text(
        'start = { position = [0.0, 0.0] }\n[[action]]\ndo = "walk"\nto = [0.0, 2.0]\n[[action]]\ndo = "wave"\n'
        '[[action.goal]]\nuse = "face"\nheading = 0.0\n'
    )
    task = load_task(tmp_path / "task.toml")
    again = Task(**task.dump())
    assert [(e.spec.name, e.parameters, e.goals) for e in again.script] == [
        (e.spec.name, e.parameters, e.goals) for e in task.script
    ]
    assert again.build().objective == task.build().objective


def test_a_finished_motion_is_judged_by_the_script_it_was_made_for() -> None:
    setup = built({"do": "walk", "to": [0.0, 2.0]}, {"do": "turn", "heading": 1.0})
    turned = setup.task.build(start=setup.start.moved((0.01, 0.0, 0.0)))
    assert turned.objective == setup.objective
    assert torch.equal(torch.tensor(turned.seconds), torch.tensor(setup.seconds))
