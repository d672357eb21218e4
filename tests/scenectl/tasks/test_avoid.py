"""A scene is avoided by default: which tasks do, by which goals, and how a task says otherwise."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from objectives import Term, get_goal
from scenectl.tasks.schema import AVOID, GROUND, PASSING
from scenectl.tasks.task import Task
from scenes.errors import UserError
from scenes.mesh.primitives import Box, Sphere
from scenes.world.moving import MovingObject, Trajectory
from scenes.world.scene import Scene, bundled

BALL = {"shape": "sphere", "center": [3.0, 1.0, 3.0], "radius": 0.3}
THING = {"primitive": BALL, "times": [0.0], "positions": [[0.0, 0.0, 0.0]]}
WALK = {"to": [0.0, 2.0]}
PATH = {"use": "follow_path", "path": [[0.0, 0.0], [0.0, 2.0]]}


def task(**more: Any) -> Task:
    return Task(**{"prompt": "x", "seconds": 4.0, "start": [0.0, 0.0], "scene": {"primitives": [BALL]}, **more})


def added(**more: Any) -> list[str]:
    return [str(term.goal) for term in task(**more).avoided]


@pytest.mark.parametrize(
    ("scene", "avoided"),
    [
        ("living_room", True),
        ({"file": "room.ply"}, True),
        ({"primitives": [BALL]}, True),
        ({"objects": [THING]}, True),
        ({}, False),
        ({"floor": 0.5}, False),
        (Scene.empty(), False),
        (Scene(primitives=[Sphere((3.0, 1.0, 3.0), 0.3)], floor=0.0), True),
        (Scene(objects=[MovingObject(Sphere((0.0, 0.0, 0.0), 0.3), Trajectory((0.0,), ((3.0, 1.0, 3.0),)))]), True),
        (bundled("pillars"), True),
    ],
)
def test_what_there_is_to_avoid(scene: Any, avoided: bool, tmp_path: Path) -> None:
    assert added(scene=scene, folder=tmp_path) == ["sdf_penetration"] * avoided
    assert added(scene=scene, folder=tmp_path, goals=[{**PATH, "weight": 0}]) == ["sdf_penetration"] * avoided
    for more in ({"walk": WALK}, {"goals": [PATH]}):  # goals push bodies into a bare floor, too
        assert added(scene=scene, folder=tmp_path, **more) == ["sdf_penetration", "foot_contact"]
        assert added(scene=scene, folder=tmp_path, **more, avoid=False) == []


def test_who_walks() -> None:
    assert added(goals=[PATH]) == ["sdf_penetration", "foot_contact"]
    for still in ({**PATH, "joint": "left_wrist"}, {**PATH, "weight": 0}, {"use": "square_region"}):
        assert added(goals=[still]) == ["sdf_penetration"]
    assert added(goals=[{"use": "joint_target", "position": [0.0, 1.0, 2.0], "at": 3.0}]) == [
        "sdf_penetration"
    ]  # a jump?


@pytest.mark.parametrize(("name", "works"), [("sdf_penetration", AVOID), ("foot_contact", GROUND)])
def test_a_goal_of_the_same_name_replaces_its_default(name: str, works: dict[str, Any]) -> None:
    both = task(walk=WALK)
    (default,) = (term for term in both.avoided if term.goal == name)
    assert default == Term.from_table({"use": name, **works}) and default.weight > 1
    (own,) = (t for t in task(walk=WALK, goals=[{"use": name}]).build().objective.terms if t.name == name)
    paper = get_goal(name)
    assert (own.weight, own.kernel, own.reduction) == (1.0, None, None)  # the paper's, as registered
    assert (paper.kernel, paper.reduction) == ("linear", "mean")
    assert name not in added(walk=WALK, goals=[{"use": name, "weight": 5.0}]) and len(added(walk=WALK)) == 2


def test_a_table_changes_some_of_it() -> None:
    (term, _) = task(walk=WALK, avoid={"exempt": ["right_wrist"], "margin": 0.01}).avoided
    assert term == Term.from_table({"use": "sdf_penetration", **AVOID, "margin": 0.01, "exempt": ["right_wrist"]})
    with pytest.raises(UserError, match=r"unknown parameter 'exemt'; did you mean 'exempt'\?"):
        task(avoid={"exemt": ["right_wrist"]})
    with pytest.raises(UserError, match="keep one of them"):
        task(avoid={"margin": 0.01}, goals=[{"use": "sdf_penetration"}])
    for wrong in ("no", 3, []):
        with pytest.raises(UserError, match="avoid"):
            task(avoid=wrong)


def test_a_walk_keeps_further_from_where_things_move() -> None:
    moves = {**THING, "times": [0.0, 1.0], "positions": [THING["positions"][0], [3.0, 0.0, 0.0]]}

    def margin(thing: dict[str, Any] = moves, **more: Any) -> float:
        (term,) = (t for t in task(scene={"objects": [thing]}, **more).avoided if t.goal == "sdf_penetration")
        return float(term.parameters["margin"])

    assert margin(walk=WALK) == margin(goals=[PATH]) == PASSING > AVOID["margin"] == margin()
    assert margin(walk=WALK, avoid={"margin": 0.01}) == 0.01
    assert margin(THING, walk=WALK) == AVOID["margin"], "what rests is passed as furniture is"


def test_defaults_are_goals_like_others_and_survive_a_dump() -> None:
    wall = Box((0.0, 1.0, 5.0), (2.0, 2.0, 0.2))
    for avoid in (True, False, {"exempt": ["right_wrist"]}):
        made = task(walk=WALK, avoid=avoid, scene=Scene(primitives=[wall], floor=0.0))
        again = Task(**made.dump())
        assert made.dump()["avoid"] == avoid == again.avoid and again.avoided == made.avoided
        names = [term.name for term in again.build().objective.counted]
        assert ("sdf_penetration" in names, "foot_contact" in names) == (avoid is not False,) * 2
