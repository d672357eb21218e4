"""Refinement as stages: what each is given stays as it was; steps of any kind and price, on any device."""

from __future__ import annotations

from dataclasses import replace

import pytest
import torch
from torch import Tensor

from objectives import Context, Objective, Term
from objectives.library.scene import foot_heights
from scenectl.control import FreeStart, SolverSettings, refine
from scenectl.control.refine.polish import SmoothStep
from scenectl.control.refine.setting import Setting
from scenectl.control.refine.stages import Stage, bring, polish, relieve, search
from scenectl.control.solvers.problem import Solution
from scenectl.control.start import MovedStep
from scenectl.generators.base import Step
from scenectl.generators.steps import AUTOGRAD, DecodedStep, MappedStep
from scenes.body.body import DEFAULT_BODY
from scenes.motion.motion import Motion
from scenes.motion.rigid import rigid
from scenes.motion.skeleton import FEET
from scenes.world.scene import Scene
from tests.scenectl.generators.test_steps import pair
from tests.scenectl.small import walk

CONTEXT = Context(Scene.empty(), DEFAULT_BODY)
REACHABLE = [[0.25, 1.0, 0.7], [0.25, 1.0, 1.9]]
WAY = [0.1 * i for i in range(1, 20)]


def walkers(samples: int = 2) -> Motion:
    return Motion(torch.stack([walk(40, 1.0 + 0.1 * i) for i in range(samples)]))


def smooth(motion: Motion) -> Step:
    """What families without a step of their own are refined by."""
    return MappedStep(SmoothStep.of(motion), rigid)


def reach(*places: list[float], tolerance: float = 0.005) -> Objective:
    at = [0.5 + i for i in range(len(places))]
    return Objective(
        (Term("joint_target", {"joint": "left_wrist", "position": list(places)}, at=at, tolerance=tolerance),)
    )


def high() -> Objective:
    return reach([0.3, 1.0, 0.6], [0.3, 3.0, 1.5])


def copied(found: Solution) -> tuple[Tensor, Tensor, list[str], int]:
    return found.value.clone(), found.cost.clone(), list(found.reasons), found.evaluations


@pytest.mark.parametrize("stage", [relieve, polish])
def test_stages_change_neither_what_they_are_given_nor_their_setting(stage: Stage) -> None:
    step = smooth(walkers())
    near = (step.motion[0].joint("left_wrist")[10] + torch.tensor([0.004, 0.0, 0.0])).tolist()
    setting = Setting(step, high() if stage is relieve else reach(near, tolerance=0.0001), CONTEXT, SolverSettings())
    stuck = Solution("lm", step.value.flatten(1), torch.ones(2), ["no progress"] * 2, 7)
    found = search(setting) if stage is relieve else stuck
    before = copied(found)
    got = stage(setting, found)
    assert got is not found and (got.moves is not None or got.evaluations > found.evaluations)
    after = copied(found)
    assert torch.equal(before[0], after[0]) and torch.equal(before[1], after[1]) and before[2:] == after[2:]
    assert not setting.step.value.any() and found.moves is None
    assert torch.equal(setting.motion(stage(setting, found)).joints, setting.motion(got).joints)


def brought(goals: Objective, motion: Motion) -> Motion:
    """What is left to joints of a motion that a decoder can't move."""
    setting = Setting(smooth(motion), goals, CONTEXT, SolverSettings())
    found = Solution("lm", setting.step.value.flatten(1), torch.ones(len(motion.joints)), ["no progress"] * 2)
    return setting.motion(bring(setting, found))


def shifted(motion: Motion, *by: float) -> Motion:
    return replace(motion, joints=motion.joints + motion.joints.new_tensor(by))


def test_bodies_are_brought_nearer_to_poses_but_never_away_from_those_that_are_met() -> None:
    """Two places of one body at once: half of the way to both is better than far from both, and worse than one."""
    body = rigid(walkers(1))
    here, there = (
        Term("pose", {"pose": shifted(body, x, 0.0, 0.0).joints[0, 10].tolist(), "frame": "world"}, at=0.5)
        for x in (0.1, -0.1)
    )
    start = Motion(torch.cat([shifted(body, x, 0.0, 0.0).joints for x in (0.3, 0.1)]))
    goals = Objective((here, there))
    after = brought(goals, start)
    assert goals.cost(after, CONTEXT)[0] < 0.5 * goals.cost(start, CONTEXT)[0]
    torch.testing.assert_close(after.joints[1], start.joints[1])


def test_bodies_that_are_brought_into_poses_do_not_hang_over_the_ground() -> None:
    """Relative to the pelvis a pose says nothing of its height."""
    body = rigid(walkers())
    wanted = body.joints[0, 10].clone()
    wanted[body.skeleton.indices(["left_wrist", "right_wrist"])] += torch.tensor([0.0, 0.15, 0.05])
    goals = Objective((Term("pose", {"pose": wanted.tolist()}, at=0.5, tolerance=0.02),))
    hanging = shifted(body, 0.0, 0.12, 0.0)
    after = brought(goals, hanging)
    assert goals.met(after, CONTEXT)[0]
    (before, now) = (foot_heights(m.select(FEET), m, CONTEXT).amin(-1)[0].mean() for m in (hanging, after))
    assert now < 0.6 * before


@pytest.mark.parametrize("free", [False, True])
def test_a_motion_without_a_step_is_refined_in_its_joints(free: bool) -> None:
    """Families without a step that can be decoded: smooth moves of what they drafted."""
    motion = walkers()
    start = FreeStart((0.0, 0.0, 0.0)) if free else None
    near = motion[0].joint("left_wrist")[10] + torch.tensor([0.1, 0.05, 0.0])
    goals = reach(near.tolist(), tolerance=0.002)
    got = refine(SmoothStep.of(motion), goals, CONTEXT, start=start)
    assert goals.met(got.motion, CONTEXT).all()
    assert got.solution is not None and got.solution.reasons == ["met", "met"]


def test_a_lifted_sample_alone_is_solved_anew_for_smooth_moves_too() -> None:
    """Samples have motions of their own, which go with them when only some are searched for."""
    motion = walkers(3)
    goals = high()
    got = refine(smooth(motion), goals, CONTEXT)
    assert got.solution is not None
    for i in range(3):
        one = replace(motion, joints=motion.joints[i : i + 1], valid=motion.valid[i : i + 1])
        alone = refine(smooth(one), goals, CONTEXT)
        assert float((alone.motion.joints[0] - got.motion.joints[i]).abs().max()) < 0.05
    assert "lifted" in got.solution.reasons


@pytest.mark.parametrize("kind", ["smooth", "moved", "decoded", "latent"])
def test_some_samples_of_a_step_decode_as_they_do_in_it(kind: str) -> None:
    latent, decoded = pair()
    smooth = SmoothStep.of(walkers(2))
    moved = MovedStep.of(
        SmoothStep.of(walkers(2)), FreeStart((0.1, 0.0, 0.2)), torch.tensor([[1.0, 2.0, 0.3], [0.0, 1.0, 2.0]])
    )
    steps: dict[str, Step] = {"smooth": smooth, "moved": moved, "decoded": decoded, "latent": latent}
    step = steps[kind].at(steps[kind].value + 0.01)
    for samples in ([1], [1, 0]):
        torch.testing.assert_close(step.take(torch.tensor(samples)).motion.joints, step.motion.joints[samples])


@pytest.mark.parametrize("targets", [1, 12])
def test_a_step_by_autograd_reaches_what_a_linearised_one_reaches(targets: int) -> None:
    """Many rows of its Jacobian are dear, and so L-BFGS takes what Levenberg-Marquardt takes elsewhere."""
    latent, decoded = pair()
    seen = latent.motion.joint("left_wrist")
    at = [0.05 * (i + 1) for i in range(targets)]
    places = (seen[0, 1 : targets + 1] + torch.tensor([0.03, 0.02, -0.03])).tolist()
    goals = Objective((Term("joint_target", {"joint": "left_wrist", "position": places}, at=at, tolerance=0.05),))
    alone = SolverSettings(natural=False, polish=False, prior=0.0)
    solvers = []
    for step in (latent, decoded):
        got = refine(step, goals, CONTEXT, alone)
        assert goals.met(got.motion, CONTEXT).all() and got.solution is not None
        solvers.append(got.solution.solver)
    assert decoded.price == AUTOGRAD
    assert solvers == (["lm", "lm"] if targets == 1 else ["lm", "lbfgs"])


@pytest.mark.parametrize("free", [False, True])
@pytest.mark.parametrize("solver", ["auto", "lm", "gauss_newton", "lbfgs", "adam", "gradient"])
def test_every_tensor_is_made_where_the_value_is(solver: str, free: bool) -> None:
    """With another default device a tensor made without one would land there, and not mix with the value's."""
    motion = walkers()
    walls = Term("foot_clearance", weight=10.0)
    goals = Objective((*high().terms, walls))
    start = FreeStart((0.0, 0.0, 0.0)) if free else None
    settings = SolverSettings(name=solver, iterations=6, lead=2)  # type: ignore[arg-type]
    step = smooth(motion)
    with torch.device("meta"):
        got = refine(step, goals, CONTEXT, settings, start)
    assert got.motion.joints.device.type == "cpu" and got.solution is not None
    assert "lifted" in got.solution.reasons or solver in ("adam", "gradient")


def test_polishing_is_on_the_values_device_too() -> None:
    motion = walkers(1)
    goals = reach((motion[0].joint("left_wrist")[10] + torch.tensor([0.005, 0.0, 0.0])).tolist(), tolerance=0.0005)
    step = DecodedStep(torch.zeros(1, 3), lambda v: replace(motion, joints=motion.joints + 0.0 * v[:, None, None, :]))
    with torch.device("meta"):
        got = refine(step, goals, CONTEXT, SolverSettings(natural=False))
    assert goals.met(got.motion, CONTEXT).all()
