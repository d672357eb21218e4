"""Things that are picked up, carried and put down: planned, gone from where they rested, and shown in the hands."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
import torch

from scenectl.tasks.held import holds, with_held
from scenectl.tasks.setup import Setup
from scenectl.tasks.task import Task
from scenes.errors import UserError
from scenes.mesh.primitives import Box
from scenes.motion.bones import rest_pose
from scenes.motion.motion import Motion
from scenes.world.moving import MovingObject, Trajectory
from scenes.world.scene import Scene

PARCEL, TABLE = (0.0, 0.8, 0.7), (1.8, 0.7, 1.2)
TAKE, PUT = {"do": "pick_up", "what": "parcel"}, {"do": "put_down", "to": [1.8, 0.72, 0.95]}


def scene(*places: tuple[float, float, float]) -> Scene:
    way = Trajectory(tuple(float(k) for k in range(len(places) or 1)), places or (PARCEL,))
    box = MovingObject(Box((0.0, 0.0, 0.0), (0.2, 0.2, 0.2)), way, "parcel")
    tables = [Box((0.0, 0.35, 1.0), (0.8, 0.7, 0.8)), Box((TABLE[0], 0.35, TABLE[2]), (0.8, 0.7, 0.8))]
    return Scene(primitives=tables, objects=[box])


def built(*tables: dict[str, Any], where: Scene | None = None) -> Setup:
    start = {"position": [0.0, 0.1], "heading": 0.0}
    return Task(actions=tables, scene=scene() if where is None else where, start=start).build()


def refused(*tables: dict[str, Any], where: Scene | None = None) -> str:
    with pytest.raises(UserError) as caught:
        built(*tables, where=where)
    assert "\n" not in str(caught.value)
    return str(caught.value)


def test_a_thing_is_held_from_when_it_is_taken_to_when_it_is_put() -> None:
    setup = built(TAKE, {"do": "carry", "to": [1.8, 0.2]}, PUT)
    assert setup.script is not None
    take, carry, put = setup.script.stretches
    (hold,) = holds(setup.objective.counted, setup.seconds)
    assert take.begin < hold.begin < take.end and put.begin < hold.end < put.end
    covered = sorted(t.window for t in hold.terms if t.window is not None)
    assert covered[0][0] == pytest.approx(hold.begin) and covered[-1][1] == pytest.approx(hold.end)
    assert all(a[1] == pytest.approx(b[0]) for a, b in zip(covered, covered[1:], strict=False))
    assert carry.act.then.held == "parcel" and put.act.then.held == ""
    assert "carrying something with the right hand" in str(carry.act.prompts(carry.begin, carry.end)[-1])


def test_meanwhile_it_is_not_where_it_rested_and_then_where_it_was_put() -> None:
    setup = built(TAKE, {"do": "carry", "to": [1.8, 0.2]}, PUT)
    (hold,) = holds(setup.objective.counted, setup.seconds)
    place = np.array([[1.8, 0.72 + 0.11, 0.95]])
    for point, times in ((np.array([PARCEL]), (True, False, False)), (place, (False, False, True))):
        for time, inside in zip((hold.begin - 0.1, hold.begin + 0.1, hold.end + 0.1), times, strict=True):
            assert (setup.scene.distance_exact(point, time)[0] < 0) == inside, time
            assert bool(setup.scene.distance(torch.from_numpy(point), torch.tensor(time))[0] < 0) == inside


def test_pictures_show_it_in_the_hands() -> None:
    setup = built(TAKE, {"do": "carry", "to": [1.8, 0.2]}, PUT)
    (hold,) = holds(setup.objective.counted, setup.seconds)
    frames = round(setup.seconds * 20) + 1
    joints = rest_pose(setup.body.skeleton).expand(frames, 22, 3) + torch.linspace(0, 1, frames)[:, None, None]
    motion = Motion(joints)
    shown = with_held(setup.scene, setup.objective.counted, motion)
    (thing,) = shown.objects
    rest, _ = thing.trajectory.at(torch.tensor(hold.begin - 0.1))
    assert rest.tolist() == pytest.approx(PARCEL, abs=1e-6)
    at = [round(t * 20) for t in (hold.begin + 0.2, hold.end - 0.2)]
    held = [thing.trajectory.at(torch.tensor(f / 20, dtype=torch.float64))[0] for f in at]
    moved = held[1] - held[0] - (joints[at[1], 0] - joints[at[0], 0])
    assert moved.abs().max() < 1e-6
    last, _ = thing.trajectory.at(torch.tensor(setup.seconds))
    assert torch.allclose(last, thing.trajectory.at(torch.tensor(hold.end + 0.1))[0])


def test_who_is_too_far_away_walks_there_first() -> None:
    where = scene()
    setup = Task(actions=[TAKE], scene=where, start={"position": [0.0, -2.0], "heading": 0.0}).build()
    assert setup.path is not None and 0.35 < 0.7 - setup.path[-1][2] < 1.0


def test_what_cannot_be_done_is_said() -> None:
    assert "the hands hold 'parcel' already; put it down first" in refused(TAKE, TAKE)
    assert "the hands hold nothing; pick something up first" in refused({"do": "carry", "to": [1.8, 0.2]})
    assert "the hands hold nothing; pick something up first" in refused(PUT)
    assert "has no part 'parcle'; did you mean 'parcel'" in refused({**TAKE, "what": "parcle"})
    assert "moves by itself, and only what rests can be taken" in refused(TAKE, where=scene(PARCEL, (0.0, 0.8, 0.8)))
    assert "hands get 1.70 m high" in refused(TAKE, where=scene((0.0, 2.4, 0.7)))
