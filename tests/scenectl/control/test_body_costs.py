"""A body stays on its feet: what is off the ground, and what refinement does about it with the weights that ship."""

from __future__ import annotations

from dataclasses import replace

import pytest
import torch

from objectives import Context, Objective, Term, diagnosis
from scenectl.control import ObjectiveGuide, Refined, SolverSettings, refine
from scenectl.control.refine.body_costs import BodyCosts, leads, walk_costs
from scenectl.control.thresholds import THRESHOLDS, Thresholds
from scenectl.generators import load_generator
from scenes.body.body import DEFAULT_BODY
from scenes.motion.motion import Motion, Pose2D
from scenes.motion.skeleton import HUMANML3D
from scenes.world.scene import Scene
from tests.objectives.cases import standing

CONTEXT = Context(Scene.empty(), DEFAULT_BODY)
HEAD = Objective((Term("joint_target", {"joint": "head", "position": [0.0, 1.5, 0.0]}, at=1.0),))


def test_turning_leads_nobody_along_a_way() -> None:
    """A heading that is held throughout is no path; kernels of angles begin where they count as much as metres."""
    turned, path = Term("face", {"heading": 1.0}), Term("follow_path", {"path": [[0.0, 0.0], [0.0, 2.0]]})
    motion = Motion(standing(40, 1).float())
    assert not leads(Objective((turned,)), motion, CONTEXT)
    assert leads(Objective((turned, path)), motion, CONTEXT)
    fading = BodyCosts.beside(motion, Objective((turned, HEAD.terms[0])), CONTEXT).objective.terms
    assert (fading[0].kernel, fading[0].delta) == ("geman_mcclure", 100 * THRESHOLDS.far)
    assert fading[1].delta == THRESHOLDS.far


def controlled(
    objective: Objective,
    seconds: float,
    samples: int,
    seed: int,
    settings: SolverSettings | None = None,
    thresholds: Thresholds = THRESHOLDS,
) -> Refined:
    """A walk by the weights that ship, guided and refined."""
    guide = ObjectiveGuide(objective, CONTEXT)
    draft = load_generator("mscot").generate(
        "a person walks forward", seconds, Pose2D(), guide=guide, samples=samples, seed=seed
    )
    assert draft.step is not None
    return refine(draft.step, objective, CONTEXT, settings, thresholds=thresholds)


def still(samples: int = 2) -> Motion:
    """People at rest whose soles are on the floor."""
    joints = standing(40, samples)
    joints[..., 1] -= joints[..., 1].min() - DEFAULT_BODY.sole_offset
    return Motion(joints)


def moved(motion: Motion, joint: str, by: list[float], frames: slice, sample: int = 0) -> Motion:
    joints = motion.joints.clone()
    joints[sample, frames, HUMANML3D.index(joint)] += joints.new_tensor(by)
    return replace(motion, joints=joints)


def test_a_standing_foot_may_not_be_lifted_unless_a_goal_asks_for_it() -> None:
    before = still()
    for height, off in ((0.02, False), (0.04, True)):
        after = moved(before, "left_foot", [0.0, height, 0.0], slice(20, 22))
        assert BodyCosts.beside(before, HEAD, CONTEXT).off_ground(after, CONTEXT).tolist() == [off, False]
        assert float(BodyCosts.beside(before, HEAD, CONTEXT).lift(after)[0]) == pytest.approx(height)
    asked = Objective((Term("joint_target", {"joint": ["head", "left_foot"], "position": [0.0, 1.0, 0.0]}, at=1.0),))
    assert not BodyCosts.beside(before, asked, CONTEXT).off_ground(after, CONTEXT).any()
    up = replace(before, joints=before.joints + before.joints.new_tensor([0.0, 0.2, 0.0]))
    after = moved(up, "left_foot", [0.0, 0.1, 0.0], slice(20, 22))
    assert not BodyCosts.beside(up, HEAD, CONTEXT).off_ground(after, CONTEXT).any()


def test_a_foot_that_stood_in_the_floor_may_come_out_of_it() -> None:
    deep = replace(still(), joints=still().joints - torch.tensor([0.0, 0.025, 0.0]))
    body = BodyCosts.beside(deep, HEAD, CONTEXT)
    for height, off in ((0.05, False), (0.06, True)):  # 25 mm of which are no lift
        after = moved(deep, "left_foot", [0.0, height, 0.0], slice(20, 22))
        assert body.off_ground(after, CONTEXT).tolist() == [off, False]
        assert float(body.lift(after)[0]) == pytest.approx(height - 0.025)
    assert float(body.lift(deep)[0]) < 0 and body.judge(deep, CONTEXT)[0][0] == body.judge(deep, CONTEXT)[0][1]


def test_a_foot_may_not_be_pushed_into_the_ground_whether_it_stood_or_not() -> None:
    before = still()
    asked = Objective((Term("joint_target", {"joint": "left_foot", "position": [0.0, -1.0, 0.0]}, at=1.0),))
    body = BodyCosts.beside(before, asked, CONTEXT)
    for depth, off in ((0.02, False), (0.04, True)):
        after = moved(before, "left_foot", [0.0, -depth, 0.0], slice(20, 22))
        assert body.off_ground(after, CONTEXT).tolist() == [off, False]
        assert body.off_ground(after, CONTEXT, 2.0).tolist() == [False, False] and float(body.lift(after)[0]) <= 0
        assert float(body.judge(after, CONTEXT)[0][0]) > float(body.judge(before, CONTEXT)[0][0])
    deep = moved(before, "left_foot", [0.0, -0.2, 0.0], slice(0, 40))
    there = BodyCosts.beside(deep, asked, CONTEXT)  # where the generator itself puts it
    assert not there.off_ground(deep, CONTEXT).any()
    deeper = moved(deep, "left_foot", [0.0, -0.04, 0.0], slice(20, 22))
    assert there.off_ground(deeper, CONTEXT).tolist() == [True, False]


def test_padding_is_neither_lifted_nor_sunk() -> None:
    valid = torch.ones(2, 40, dtype=torch.bool)
    valid[:, 30:] = False
    before = replace(still(), valid=valid)
    body = BodyCosts.beside(before, HEAD, CONTEXT)
    for height in (-1.0, 1.0):
        after = moved(before, "left_foot", [0.0, height, 0.0], slice(30, 40))
        assert not body.off_ground(after, CONTEXT).any()
        torch.testing.assert_close(body.judge(after, CONTEXT)[0], body.judge(before, CONTEXT)[0])


def test_goals_that_pull_weigh_more_and_let_go_of_what_is_far_off_and_walls_are_as_ever() -> None:
    terms = (Term("joint_target", {"position": [9.0, 1.0, 0.0]}, at=1.0), Term("sdf_penetration", kernel="squared"))
    body = BodyCosts.beside(still(), Objective(terms), CONTEXT)
    held_on, at_last, limits = body.objective.terms, body.without_outliers.terms, THRESHOLDS
    for held, delta, pull in ((held_on, limits.far, limits.pull), (at_last, limits.off, 1.0)):
        assert [term.kernel for term in held[:2]] == ["geman_mcclure", "squared"]
        assert (held[0].delta, held[0].weight, held[1].weight) == (delta, pull, 1.0)
    assert len(held_on) == 6 and len(at_last) == 2
    pulls = []
    for away in (0.1, 9.0):
        joints = still(1).joints
        term = replace(held_on[0], parameters={"position": [away, float(joints[0, 0, 0, 1]), 0.0]})
        joints.requires_grad_(True)
        (pull,) = torch.autograd.grad(term.cost(Motion(joints), CONTEXT).sum(), joints)
        pulls.append(float(pull.norm()))
    assert pulls[1] < 0.02 * pulls[0]


def test_its_rows_are_its_cost_where_nothing_is_held_back() -> None:
    before = still()
    after = moved(moved(before, "left_foot", [0.0, 0.1, 0.0], slice(3, 9)), "left_wrist", [0.1, 0.1, 0.0], slice(9, 20))
    body = BodyCosts.beside(before, Objective((Term("sdf_penetration", kernel="squared"),)), CONTEXT)
    found = body.assess(after, CONTEXT)
    squares = sum((rows.flatten(1).square().sum(1) for rows in found.rows), torch.zeros(2))
    # No foot slides: nor is that held.
    torch.testing.assert_close(
        squares.to(found.cost), body.judge(after, CONTEXT)[0]
    )  # no foot slides: nor is that held
    torch.testing.assert_close(found.cost, body.judge(after, CONTEXT)[0])
    assert float(body.judge(after, CONTEXT)[0][0]) > float(body.judge(before, CONTEXT)[0][0])


def test_a_target_out_of_reach_lifts_no_foot_and_is_named() -> None:
    """The paper's failure case (its Fig. 10), with the weights that ship: goals alone fly there."""
    places = [[0.3, 1.2, 0.6], [0.3, 3.6, 1.0], [0.3, 1.2, 1.6]]
    goal = Term("joint_target", {"joint": "left_wrist", "position": places}, at=[1.0, 1.5, 2.0], tolerance=0.01)
    objective = Objective((goal,))
    for settings, off in ((SolverSettings(natural=False), True), (SolverSettings(), False)):
        made = controlled(objective, 3.2, 1, 2, settings)
        body = BodyCosts.beside(made.unrefined, objective, CONTEXT)
        assert bool(body.off_ground(made.motion, CONTEXT)[0]) == off
    said = diagnosis(objective, made.motion[0], CONTEXT)
    assert said is not None and said.startswith("target 2 (left wrist, 1.50 s) is") and "out of reach" in said


def test_what_slides_counts_in_walks_on_level_ground_and_not_on_steps() -> None:
    """On steps a foot that swings is as low over the next one as a foot that carries, and would be held there."""
    named = [{term.spec.name for term in walk_costs(level)} for level in (True, False)]
    assert named == [{"foot_clearance", "foot_skating"}, {"foot_clearance"}]
