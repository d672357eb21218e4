"""Tasks on ground of several heights: starts, walks, what is said about them, and a person who climbs."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import torch

import scenectl as sc
from scenectl.measures.metrics import Scorer, measure
from scenectl.pipeline.run import run
from scenectl.tasks.setup import start_of
from scenectl.tasks.task import Task, load_task
from scenes.body.body import DEFAULT_BODY
from scenes.errors import UserError
from scenes.mesh.primitives import Box
from scenes.motion.skeleton import FEET
from scenes.world.scene import Scene
from tests.scenes.world.floor.grounds import kerb, ramp, steps, storeys

SOLE = DEFAULT_BODY.sole_offset


def test_a_start_stands_on_the_ground_under_it() -> None:
    for scene, place, height in (
        (steps(), [0.0, -2.0], 0.0),
        (steps(), [0.0, 2.2], 0.68),
        (ramp(10.0), [0.0, 1.5], 1.5 * np.tan(np.radians(10.0))),
        (storeys(), [0.0, -1.0], 0.0),
        (storeys(), [0.0, 2.72, -1.0], 2.72),
    ):
        start = Task(prompt="x", seconds=3.0, scene=scene, start={"position": place}).build().start
        assert start.position[1] == pytest.approx(height + SOLE, abs=1e-3)


def test_nobody_starts_on_a_table() -> None:
    table = Scene(primitives=[Box((0.0, 0.72, 2.0), (1.5, 0.04, 1.0))], floor=0.0)
    with pytest.raises(UserError, match="inside or against an obstacle"):
        Task(prompt="x", seconds=3.0, scene=table, start=[0.0, 2.0]).build()


def test_a_walk_onto_the_platform_is_planned_along_the_steps_and_says_so() -> None:
    problem = Task(prompt="x", scene=steps(), start=[0.0, -1.5], walk={"to": [0.3, 2.2]}).build()
    assert problem.path is not None
    assert problem.path[[0, -1], 1] == pytest.approx([0.0, 0.68], abs=1e-4)
    assert problem.doubts[-1] == "the walk takes 4 steps up of up to 0.17 m, as no level way exists"
    follow, arrive = problem.objective.terms[:2]
    heights = [point.y for point in follow.parameters["path"]]
    assert heights[0] == pytest.approx(0.0, abs=1e-4) and heights[-1] == pytest.approx(0.68, abs=1e-4)
    assert arrive.parameters["position"] == (0.3, 2.2) and follow.parameters["height"] > 0.8
    level = Task(prompt="x", scene=ramp(10.0), start=[0.0, -1.5], walk={"to": [0.3, 3.6]}).build()
    assert level.path is not None and level.path[-1, 1] > 0.5 and not any("the walk takes" in d for d in level.doubts)
    down = Task(prompt="x", scene=kerb(0.12), start=[0.0, 1.0], walk={"to": [0.0, -1.0]}).build()
    assert down.doubts[-1] == "the walk takes 1 step down of up to 0.12 m, as no level way exists"


def test_a_walk_says_by_its_height_which_storey_it_goes_to() -> None:
    scene = storeys()
    below = Task(prompt="x", scene=scene, start=[1.0, 0.0], walk={"to": [0.0, -1.0]}).build()
    above = Task(prompt="x", scene=scene, start=[1.0, 0.0], walk={"to": [0.0, 2.72, -1.0]}).build()
    stays = Task(prompt="x", scene=scene, start=[1.0, 2.72, 0.0], walk={"to": [0.0, 2.72, -1.0]}).build()
    ends = [problem.path[-1, 1] for problem in (below, above, stays) if problem.path is not None]
    assert ends == pytest.approx([0.0, 2.72, 2.72], abs=1e-4)
    assert "16 steps" in above.doubts[-1] and not any("the walk takes" in d for d in (*below.doubts, *stays.doubts))


def test_a_task_file_states_storeys(tmp_path: Path) -> None:
    import trimesh

    mesh = storeys().meshes[0]
    trimesh.Trimesh(mesh.vertices, mesh.faces, process=False).export(tmp_path / "house.ply")
    text = 'prompt = "x"\nscene = "house.ply"\nstart = { position = [1.0, 2.72, 0.0] }\n[walk]\nto = [0.0, 0.0, -1.0]\n'
    (tmp_path / "task.toml").write_text(text)
    path = load_task(tmp_path / "task.toml").build().path
    assert path is not None and path[[0, -1], 1] == pytest.approx([2.72, 0.0], abs=1e-3)


def test_a_person_climbs_the_steps_onto_the_platform() -> None:
    scene = steps(0.17, 4, 0.3)
    walk = {"to": [0.0, 2.2], "stop": False}  # stopped on top, it is up to 2 cm off its schedule on the way
    task = Task(prompt="a person walks forward", scene=scene, start=[0.0, -1.5], walk=walk)
    result = run(task, samples=2)
    motion = result.motion[0]
    assert result.samples[0].met
    feet = motion.select(FEET)
    over = scene.distance_exact(feet.reshape(-1, 3).numpy()).reshape(-1, 2) - SOLE
    assert scene.ground_under(feet[-1]).tolist() == pytest.approx([0.68, 0.68], abs=1e-4)
    assert over.min() > -0.02 and over.min(axis=1).max() < 0.1  # not in the steps, and on them as `foot_contact` has it
    rise = motion.joint("pelvis")[:, 1]
    assert float(rise[-1] - rise[0]) == pytest.approx(0.68, abs=0.12)
    figures = measure(motion, Scorer(scene))
    assert abs(float(figures["lowest_sole_m"] or 0.0)) < 0.03
    assert float(figures["deepest_penetration_m"] or 0.0) < 0.02
    assert result.report["scene"]["doubts"][-1].startswith("the walk takes 4 steps up")


def test_people_walk_down_a_slope_as_well_as_up() -> None:
    scene, ends = ramp(10.0), ([0.0, 4.0], [0.0, -1.5])
    for start, to in (ends, ends[::-1]):
        task = Task(prompt="a person walks forward", scene=scene, start=start, walk={"to": to})
        result = run(task, samples=2)
        assert result.samples[0].met
        soles = result.motion.select(FEET)
        over = soles[..., 1] - scene.ground_under(soles) - SOLE
        assert over.amin(-1).max() < 0.1 and over.min() > -0.04, (over.amin(-1).max(), over.min())


def test_people_walk_down_steps() -> None:
    scene = steps(0.17, 4, 0.3)
    task = Task(prompt="a person descends some steps", scene=scene, start=[0.0, 2.6], walk={"to": [0.0, -1.5]})
    result = run(task, samples=4)
    motion = result.motion[0]
    feet = motion.select(FEET)
    over = feet[..., 1] - scene.ground_under(feet) - SOLE
    # Toes over an edge are a riser above what is under them, and as high as feet that carry (5 cm);
    # whether it is well done, the verdict says, and often not.
    assert over.amin(-1).max() < 0.17 + 0.05 and float(motion.joint("pelvis")[-1, 1]) == pytest.approx(0.95, abs=0.1)
    assert result.setup.doubts[-1].startswith("the walk takes 4 steps down of up to 0.17 m")


def test_a_start_is_sampled_on_the_storey_of_the_target() -> None:
    for seed in range(4):  # without stairs nobody gets there from below
        task = Task(prompt="x", scene=storeys(stairs=False), start="sample", walk={"to": [0.0, 2.72, -1.0]}, seed=seed)
        assert task.build().start.position[1] == pytest.approx(2.72 + SOLE, abs=1e-3)


@pytest.mark.parametrize("y", [0.0, 2.72])
def test_soles_are_measured_over_the_storey_that_one_stands_on(y: float, tiny: object) -> None:
    joints = tiny.statue().expand(5, 22, 3).clone()  # type: ignore[attr-defined]
    joints = joints - joints[..., 1].min() * torch.tensor([0.0, 1.0, 0.0]) + torch.tensor([0.0, y + SOLE, -1.0])
    figures = measure(sc.Motion(joints), Scorer(storeys()))
    assert figures["lowest_sole_m"] == pytest.approx(0.0, abs=2e-3)
    assert float(figures["deepest_floor_penetration_m"] or 0.0) < 0.01
    assert start_of(sc.Motion(joints)).position[1] == pytest.approx(y, abs=1e-3)
