"""Errors of planning tell all that is known of their cause, and finished motions are judged wherever they begin."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
import torch

import scenes.world.scene as module
from scenectl.pipeline.run import score
from scenectl.tasks.task import Task
from scenes.errors import UserError
from scenes.mesh.mesh import Mesh
from scenes.mesh.primitives import Box
from scenes.motion.frames import HOME, Place
from scenes.motion.motion import Motion, Pose2D
from scenes.world.scene import Scene

STAND = {"prompt": "a person stands", "seconds": 2.0}
FAR = (500_000.0, 0.0, 4_500_000.0)


def room(o: Place = HOME, *doubts: str) -> Mesh:
    shell = Box((0.0, 1.25, 0.0), (6.0, 2.5, 6.0)).mesh()
    return Mesh(shell.vertices + o, shell.faces[:, ::-1], "room", doubts=doubts)


def sheet() -> Mesh:
    """A floor, and a wall without thickness, of which a bake says that it is thinner than its voxels."""
    floor = Box((0.0, -0.1, 0.0), (6.0, 0.2, 6.0)).mesh()
    wall = np.array([[1.0, 0.0, -3.0], [1.0, 2.0, -3.0], [1.0, 2.0, 3.0], [1.0, 0.0, 3.0]])
    faces = np.vstack([floor.faces, np.array([[0, 1, 2], [0, 2, 3]]) + len(floor.vertices)])
    return Mesh(np.vstack([floor.vertices, wall]), faces, "sheet", doubts=("a doubt about the file",))


def told(scene: Scene, **task: Any) -> str:
    with pytest.raises(UserError) as caught:
        Task(**{**STAND, "scene": scene, **task}).build()
    assert "\n" not in str(caught.value)
    return str(caught.value)


@pytest.mark.parametrize("task", [{"start": [1.0, 0.0]}, {"start": [-2.0, 0.0], "walk": {"to": [1.0, 0.0]}}])
def test_errors_tell_what_the_bake_has_in_doubt(task: dict[str, Any]) -> None:
    scene = Scene([sheet()], resolution=48, cache=None)
    said = told(scene, **task)
    assert len(scene.doubts) > 1 and any("without thickness" in doubt for doubt in scene.doubts)
    assert said.endswith("; in doubt: " + "; ".join(scene.doubts))


def test_errors_before_the_bake_wait_for_none_and_a_failing_bake_is_the_error(monkeypatch: pytest.MonkeyPatch) -> None:
    astray = Scene([sheet()], resolution=48, cache=None, free_space=(0.0, 50.0, 0.0))
    said = told(astray, start=[-1.0, 0.0])
    assert "50" in said and said.endswith("; in doubt: a doubt about the file")
    monkeypatch.setattr(module, "bake", None)
    said = told(Scene([sheet()], cache=None), start=[9.0, 0.0, 0.0])
    assert "outside the scene" in said and said.endswith("; in doubt: a doubt about the file")


def test_starts_far_from_the_origin_are_stated_in_the_world_and_the_frame_is_named() -> None:
    def scene() -> Scene:
        return Scene([room(FAR)], [Box((FAR[0] + 1, 1.0, FAR[2] + 1), (0.5, 2.0, 0.5))], resolution=32, cache=None)

    said = told(scene(), start=[-2.0, -2.0])
    assert "start [-2.00, -2.00] lies outside the scene, which spans x 499997.00 to 500003.00 and z 4499997.00" in said
    assert "start [500001.00, 4500001.00] is inside" in told(scene(), start=[500_001.0, 4_500_001.0])
    high = told(scene(), start=[500_000.0, 1.5, 4_500_000.0])
    assert "start [500000.00, 1.50, 4500000.00] has nothing to stand on" in high
    for task in (
        {"start": [-2.0, -2.0]},
        {"start": [500_000.0, 4_500_000.0], "walk": {"to": [500_001.0, 4_500_001.0]}},
    ):
        assert f"a frame that begins at {list(FAR)} m" in told(scene(), **task)


@pytest.mark.parametrize("o", [HOME, FAR])
@pytest.mark.parametrize("place", [(0.0, 0.5, 0.0), (0.0, -0.5, 0.0), (2.9, 0.0, 0.0), (9.0, 0.0, 0.0)])
def test_a_motion_that_begins_in_the_air_or_in_a_wall_is_judged(place: Place, o: Place, tiny: Any) -> None:
    motion = Motion(Pose2D(place, 0.3).apply(tiny.statue().expand(40, 22, 3).clone())).moved(o)
    goals = [{"use": "foot_contact"}, {"use": "sdf_penetration"}]
    task = Task(**STAND, scene=Scene([room(o)], resolution=32, cache=None), goals=goals)
    (row,) = score(motion, task).samples
    contact, penetration = row.terms
    assert contact.met == (place[1] < 0.05) and penetration.met == (place == (0.0, 0.5, 0.0))


@pytest.mark.parametrize("height", [0.0, 0.12, 1.0])
def test_a_walk_is_planned_from_the_ground_under_a_motion_in_the_air(height: float, tiny: Any) -> None:
    joints = tiny.statue() + torch.tensor([0.0, height, 0.0])
    walk = joints + torch.linspace(0.0, 1.5, 40)[:, None, None] * torch.tensor([1.0, 0.0, 0.0])
    task = Task(
        prompt="walks", scene=Scene([room()], resolution=32, cache=None), start=[0.0, 0.0], walk={"to": [1.5, 0]}
    )
    result = score(Motion(walk), task)
    assert result.setup.path is not None and np.allclose(result.setup.path[:, 1], 0.0, atol=0.01)
