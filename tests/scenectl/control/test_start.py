"""A start as an unknown: moves, products with them, and goals that only another start can meet."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import pytest
import torch

from objectives import Objective, Term
from scenectl.control import FreeStart, ObjectiveGuide, SolverSettings, refine
from scenectl.control.start import MovedStep
from scenectl.generators import load_generator
from scenectl.pipeline.run import run
from scenectl.tasks.schema import Start
from scenectl.tasks.setup import start_of
from scenectl.tasks.task import Task, load_task
from scenes.errors import UserError
from scenes.motion.motion import Pose2D
from tests.objectives.cases import context, wandering
from tests.scenectl.control.products import assert_derivatives_and_adjoint
from tests.scenectl.control.test_guide import step

PIVOT = (0.4, 0.0, -0.3)


def moves(samples: int = 2) -> torch.Tensor:
    return torch.tensor([[1.0, -2.0, 0.7], [0.3, 0.2, -2.5]], dtype=torch.float64)[:samples]


def moved_step() -> MovedStep:
    return MovedStep.of(step(exact=True), FreeStart(PIVOT), moves())


def test_a_move_is_a_rigid_transform_about_the_pivot() -> None:
    motion, start = wandering(2), FreeStart(PIVOT)
    got = start.moved(motion, moves())
    for i, (x, z, yaw) in enumerate(moves().tolist()):
        centre = motion.joints.new_tensor(PIVOT)
        turn = Pose2D((PIVOT[0] + x, PIVOT[1], PIVOT[2] + z), yaw)
        torch.testing.assert_close(got.joints[i], turn.apply(motion.joints[i] - centre))
    torch.testing.assert_close(start.moved(motion, torch.zeros(2, 3)).joints, motion.joints)


def test_products_of_a_moved_step_are_derivatives_and_adjoint() -> None:
    assert_derivatives_and_adjoint(moved_step())


def test_the_best_of_several_headings_is_found_for_every_sample() -> None:
    motion = wandering(2)
    start, truth = FreeStart(PIVOT), moves()
    wanted = start.moved(motion, truth)

    wanted = start.moved(motion, truth)
    for sample in range(2):  # of its own goals, each time in the batch of both
        goals = Objective(
            tuple(
                Term("joint_target", {"joint": joint, "position": wanted.joint(joint)[sample, frame].tolist()}, at=at)
                for joint in ("head", "left_wrist")
                for frame, at in ((0, 0.0), (8, 0.4))
            )
        )
        found = start.fit(motion, goals, context())
        got = start.moved(motion, found).joints[sample]
        torch.testing.assert_close(got, wanted.joints[sample], atol=1e-2, rtol=0)
        assert torch.equal(start.fit(motion, goals, context()), found)  # it holds no state


def test_refinement_solves_for_the_start_and_the_value_together() -> None:
    s = step(samples=2)
    free = FreeStart((1.0, 0.0, -2.0))
    goals = Objective((Term("joint_target", {"position": [6.0, 5.0]}, at=0.5, tolerance=0.01),))
    got = refine(s, goals, context(), SolverSettings(natural=False), free)
    assert got.solution is not None and got.solution.value.shape == (2, s.value[0].numel() + 3)
    assert goals.met(got.motion, context()).all()
    value = got.solution.value[:, :-3].view_as(s.value)
    assert float((value - s.value).abs().max()) < 0.05  # the start alone can do it


def test_a_goal_behind_a_walker_is_met_by_turning_the_start() -> None:
    """Walking backwards is not what was asked for: with a free start the walk simply begins elsewhere."""
    goals = Objective((Term("joint_target", {"position": [[0.0, -1.0], [0.0, -2.2]]}, at=[1.0, 2.5], tolerance=0.02),))
    generator = load_generator("mscot")
    free = FreeStart((0.0, 0.0, 0.0))
    guide = ObjectiveGuide(goals, context(), start=free)
    draft = generator.generate("a person walks forward", 3.0, Pose2D(), guide=guide, samples=2, seed=0)
    assert draft.step is not None
    made = refine(draft.step, goals, context(), start=free)
    assert goals.met(made.motion, context()).all()
    for i in range(2):
        pelvis = made.motion[i].joint("pelvis")
        ahead = (pelvis[50] - pelvis[20])[[0, 2]]
        heading = start_of(replace(made.motion[i], joints=made.motion[i].joints[20:], valid=made.motion[i].valid[20:]))
        facing = ahead.new_tensor([math.sin(heading.heading), math.cos(heading.heading)])
        assert float(facing @ ahead / ahead.norm()) > 0.8  # forwards, as it was told


def test_a_task_asks_for_it_and_its_report_says_where_each_sample_began(tmp_path: Path) -> None:
    task = Task(
        prompt="a person walks forward", seconds=2.0, start=Start(position=(0.0, 0.0), free=True), samples=2,
        goals=({"use": "joint_target", "position": [3.0, -2.0], "at": 1.9},),
    )  # fmt: skip
    result = run(task)
    assert all(sample.met for sample in result.samples)
    starts = [row["start"]["position"] for row in result.report["samples"]]
    pelvis = result.motion.joint("pelvis")[:, 0]
    for place, begin in zip(starts, pelvis, strict=True):
        assert place[0] == pytest.approx(float(begin[0])) and place[2] == pytest.approx(float(begin[2]))
    (tmp_path / "task.toml").write_text(
        'prompt = "walks"\nstart = { position = [0.0, 0.0], free = true }\nwalk = { to = [1.0, 1.0] }\n'
    )
    with pytest.raises(UserError, match="start: 'free' cannot be solved for with a"):
        load_task(tmp_path / "task.toml")
