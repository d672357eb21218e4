"""The last centimetre: smooth moves that meet targets, products, and what is left alone."""

from __future__ import annotations

from dataclasses import replace

import pytest
import torch

from objectives import Context, Objective, Term
from scenectl.control import SolverSettings, refine
from scenectl.control.refine.polish import SmoothStep, kept
from scenectl.control.refine.setting import Setting
from scenectl.control.solvers.problem import Solution
from scenectl.control.thresholds import THRESHOLDS, Thresholds
from scenectl.generators.base import Step
from scenectl.generators.steps import DecodedStep, MappedStep
from scenectl.measures.metrics import max_acceleration, skating_ratio
from scenes.body.body import DEFAULT_BODY
from scenes.motion.bones import bone_lengths, rest_lengths
from scenes.motion.motion import Motion
from scenes.motion.rigid import rigid
from scenes.world.scene import Scene
from tests.scenectl.small import walk

CONTEXT = Context(Scene.empty(), DEFAULT_BODY)
REACH = THRESHOLDS.reach
NOTHING_KEPT = replace(THRESHOLDS, furthest=0.0)
FRAMES = (10, 25, 40)


def walkers(samples: int = 2) -> Motion:
    return Motion(torch.stack([walk(60, 1.0 + 0.2 * i) for i in range(samples)]))


def targets(motion: Motion, off: list[float], joint: str = "left_wrist", tolerance: float = 0.001) -> Objective:
    """Where the joint of the first sample is at some frames, and a little aside."""
    places = (motion[0].joint(joint)[list(FRAMES)] + torch.tensor(off)).tolist()
    given = {"joint": joint, "position": places}
    return Objective((Term("joint_target", given, at=[f / 20 for f in FRAMES], tolerance=tolerance),))


def finished(
    objective: Objective, motion: Motion, thresholds: Thresholds = THRESHOLDS, **settings: object
) -> tuple[Motion, Solution]:
    """The motion after a refinement whose step can't move it."""
    solver = SolverSettings.model_validate({"natural": False, **settings})
    step = DecodedStep(torch.zeros(len(motion.joints), 1), lambda v: motion_of(motion, v))
    got = refine(step, objective, CONTEXT, solver, thresholds=thresholds)
    assert got.solution is not None
    return got.motion, got.solution


def motion_of(motion: Motion, value: torch.Tensor) -> Motion:
    return replace(motion, joints=motion.joints[: len(value)] + 0.0 * value[:, :, None, None])


def test_it_is_a_step_whose_products_are_those_of_autograd() -> None:
    motion = replace(walkers(), joints=walkers().joints.double())
    value = 0.01 * torch.randn(motion.joints.shape, dtype=torch.float64)
    step = MappedStep(SmoothStep.of(motion), rigid).at(value)
    plain = DecodedStep(value, step.decode)
    assert isinstance(step, Step)
    tangent, cotangents = torch.randn_like(value), torch.randn(3, *value.shape, dtype=torch.float64)
    torch.testing.assert_close(step.motion.joints, plain.motion.joints)
    torch.testing.assert_close(step.jvp(tangent), plain.jvp(tangent), atol=1e-6, rtol=0)
    torch.testing.assert_close(step.vjps(cotangents), plain.vjps(cotangents))
    torch.testing.assert_close(step.vjp(cotangents[0]), step.vjps(cotangents)[0])


def test_a_move_dies_away_over_time_and_along_the_limb() -> None:
    motion = walkers(1)
    value = torch.zeros_like(motion.joints)
    value[0, 30, motion.skeleton.index("left_wrist"), 1] = 1.0
    moved = (SmoothStep.of(motion).decode(value).joints - motion.joints)[0, ..., 1]
    arm = [float(moved[30, motion.skeleton.index(f"left_{part}")]) for part in ("wrist", "elbow", "shoulder", "foot")]
    assert arm == sorted(arm, reverse=True) and arm[0] == pytest.approx(1.0) and arm[-1] < 0.1
    over_time = moved[30:, motion.skeleton.index("left_wrist")]
    assert (over_time.diff() <= 0).all() and over_time[12] < 1e-3


@pytest.mark.parametrize("joint", ["pelvis", "left_foot", "head", "left_wrist"])
def test_targets_a_few_millimetres_off_are_met_and_nothing_else_suffers(joint: str) -> None:
    motion = walkers()
    objective = targets(motion, [0.004, 0.003, -0.004], joint)
    after, _ = finished(objective, motion)
    assert objective.met(after, CONTEXT).tolist() == [True, False]
    torch.testing.assert_close(after.joints[1], motion.joints[1])  # far from its targets: not polished
    assert (bone_lengths(after) - rest_lengths(after)).abs().max() < 1e-6
    assert max_acceleration(after[0]) < 1.1 * max_acceleration(motion[0])
    assert skating_ratio(after[0]) <= skating_ratio(motion[0])
    assert kept(motion, after).all()


def test_it_can_be_switched_off_and_leaves_alone_what_is_met_or_far_off() -> None:
    motion = walkers()
    for off, settings in (([0.005, 0.0, 0.0], {"polish": False}), ([0.0] * 3, {}), ([0.0, 3 * REACH, 0.0], {})):
        after, _ = finished(targets(motion, off), motion, **settings)
        torch.testing.assert_close(after.joints, motion.joints)


def test_a_move_that_is_too_far_is_not_kept_and_not_called_met() -> None:
    motion = walkers(1)
    after, solution = finished(targets(motion, [0.005, 0.0, 0.0]), motion, NOTHING_KEPT)
    torch.testing.assert_close(after.joints, motion.joints)
    assert solution.reasons == ["no progress"]


def test_what_cannot_be_polished_goes_on_through_the_decoder() -> None:
    motion = walkers(1)
    objective = targets(motion, [0.004, 0.003, -0.004])
    step = DecodedStep(
        torch.zeros(1, 3), lambda v: replace(motion, joints=motion.joints[: len(v)] + v[:, None, None, :])
    )
    got = refine(step, objective, CONTEXT, SolverSettings(natural=False), thresholds=NOTHING_KEPT)
    assert got.solution is not None and got.solution.reasons == ["met"]
    assert objective.met(got.motion, CONTEXT).all()


def test_targets_are_met_beside_costs_that_pull_the_other_way_within_their_tolerance() -> None:
    """Feet a centimetre in the floor, as goals allow, outweigh the last millimetres of a target a thousandfold."""
    motion = walkers(1)
    low = replace(motion, joints=motion.joints - torch.tensor([0.0, motion.joints[..., 1].min() - 0.015, 0.0]))
    floor = Term("sdf_penetration", kernel="squared", reduction="sum", weight=1e4, tolerance=0.05)
    objective = Objective((*targets(low, [0.004, 0.004, -0.004], "pelvis").terms, floor))
    after, solution = finished(objective, low)
    assert solution.reasons == ["met"] and objective.met(after, CONTEXT).all()


def test_far_moves_are_not_kept() -> None:
    motion = walkers(1)
    shifted = motion.joints.clone()
    shifted[0, 5, 20, 1] += 3.1 * REACH  # one joint at one frame
    assert not kept(motion, replace(motion, joints=shifted)).any()
    assert kept(motion, replace(motion, joints=motion.joints + 1.7 * REACH)).all()


def test_only_targets_in_metres_are_loosened_and_none_is_tightened() -> None:
    place = {"position": [0.0, 1.0, 0.0]}
    terms = (
        Term("joint_target", place, at=1.0, tolerance=0.001),
        Term("joint_target", place, at=1.0, tolerance=0.2),
        Term("sdf_penetration", {}, tolerance=0.0),
        Term("smoothness", {}),
    )
    setting = Setting(SmoothStep.of(walkers()), Objective(terms), CONTEXT, SolverSettings())
    got = setting.goals.terms
    assert [got[0].tolerance, got[1].tolerance] == [REACH, 0.2]
    assert got[2:] == Objective(terms).terms[2:]
