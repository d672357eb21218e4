"""A body stays a body: what counts as strained, and what refinement does about it with the weights that ship."""

from __future__ import annotations

from dataclasses import replace

import pytest
import torch

from objectives import Context, Objective, Term
from scenectl.control import ObjectiveGuide, Refined, SolverSettings, refine
from scenectl.control.refine.body_costs import BodyCosts, leads, walk_costs
from scenectl.control.thresholds import THRESHOLDS, Thresholds
from scenectl.generators import load_generator
from scenes.body.body import DEFAULT_BODY
from scenes.motion.bones import bone_errors
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
    held = BodyCosts.beside(motion, Objective((turned, HEAD.terms[0])), CONTEXT).objective.terms
    assert (held[0].kernel, held[0].delta) == ("huber", 100 * THRESHOLDS.held)
    assert held[1].delta == THRESHOLDS.held


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
    for height, strained in ((0.02, False), (0.04, True)):
        after = moved(before, "left_foot", [0.0, height, 0.0], slice(20, 22))
        assert BodyCosts.beside(before, HEAD, CONTEXT).strained(after).tolist() == [strained, False]
        assert float(BodyCosts.beside(before, HEAD, CONTEXT).lift(after)[0]) == pytest.approx(height)
    asked = Objective((Term("joint_target", {"joint": ["head", "left_foot"], "position": [0.0, 1.0, 0.0]}, at=1.0),))
    assert not BodyCosts.beside(before, asked, CONTEXT).strained(after).any()
    up = replace(before, joints=before.joints + before.joints.new_tensor([0.0, 0.2, 0.0]))
    assert (
        not BodyCosts.beside(up, HEAD, CONTEXT).strained(moved(up, "left_foot", [0.0, 0.1, 0.0], slice(20, 22))).any()
    )


def test_a_foot_that_stood_in_the_floor_may_come_out_of_it() -> None:
    deep = replace(still(), joints=still().joints - torch.tensor([0.0, 0.025, 0.0]))
    body = BodyCosts.beside(deep, HEAD, CONTEXT)
    for height, strained in ((0.05, False), (0.06, True)):  # 25 mm of which are no lift
        after = moved(deep, "left_foot", [0.0, height, 0.0], slice(20, 22))
        assert body.strained(after).tolist() == [strained, False]
        assert float(body.lift(after)[0]) == pytest.approx(height - 0.025)
    assert float(body.lift(deep)[0]) < 0 and body.cost(deep, CONTEXT)[0] == body.cost(deep, CONTEXT)[1]


def test_factors_relax_limits_of_bones_and_of_feet() -> None:
    before = still()
    body = BodyCosts.beside(before, HEAD, CONTEXT)
    lifted = moved(before, "left_foot", [0.0, 0.05, 0.0], slice(20, 22))
    longer = stretched(before, "right", 0.3, slice(0, 40))  # 14 mm over 21 bones
    expectations = (((1.0, 1.0), [True, True]), ((3.0, 1.0), [True, False]), ((3.0, 2.0), [False, False]))
    for factors, expected in expectations:
        got = [bool(body.strained(motion, *factors)[0]) for motion in (lifted, longer)]
        assert got == expected


def test_tightened_goals_weigh_more_and_are_near_within_a_hand() -> None:
    before = still()
    body = BodyCosts.beside(before, HEAD, CONTEXT)
    for away, reached in ((0.1, True), (0.2, False)):
        by = torch.tensor([away, 1.5, 0.0]) - before.joint("head")[0, 20]
        assert bool(body.near(moved(before, "head", by.tolist(), slice(20, 21)), CONTEXT)[0]) == reached
    harder = body.tightened().objective.terms
    weights = {a.goal: (a.weight, b.weight) for a, b in zip(body.objective.terms, harder, strict=True)}
    once, raised = weights.pop("joint_target")
    assert raised > once and len(weights) == 5 and all(a == b for a, b in weights.values())
    lifted = moved(before, "left_foot", [0.0, 0.05, 0.0], slice(20, 22))
    assert body.tightened()._footing(lifted).sum() > body._footing(lifted).sum() > 0


def stretched(motion: Motion, side: str, by: float, frames: slice) -> Motion:
    """A forearm of the first sample made longer by so much (m)."""
    along = motion.joint(f"{side}_wrist")[0, 0] - motion.joint(f"{side}_elbow")[0, 0]
    return moved(motion, f"{side}_wrist", (by * along / along.norm()).tolist(), frames)


def test_bones_may_be_as_wrong_as_they_were_and_hardly_more() -> None:
    before = stretched(still(), "left", 0.06, slice(0, 40))
    body, once, always = BodyCosts.beside(before, HEAD, CONTEXT), slice(5, 6), slice(0, 40)
    assert not body.strained(before).any()
    for by, frames, expected in ((0.4, once, False), (0.45, once, True), (0.1, always, False), (0.11, always, True)):
        assert body.strained(stretched(before, "right", by, frames)).tolist() == [expected, False]  # over 21 bones


def test_bone_errors_are_means_over_bones_and_none_in_padding() -> None:
    motion = stretched(still(1), "left", 0.21, slice(3, 5))
    valid = torch.ones(1, 40, dtype=torch.bool)
    valid[0, 4:] = False
    got = bone_errors(replace(motion, valid=valid))[0]
    assert got[:3].max() < 1e-6 and float(got[3]) == pytest.approx(0.01) and not got[4:].any()


def test_goals_that_pull_do_so_no_harder_from_afar_and_walls_as_ever() -> None:
    terms = (Term("joint_target", {"position": [9.0, 1.0, 0.0]}, at=1.0), Term("sdf_penetration", kernel="squared"))
    body = BodyCosts.beside(still(), Objective(terms), CONTEXT)
    held, let_go = body.objective.terms, body.without_outliers.terms
    assert (held[0].kernel, held[1].kernel) == ("huber", "squared")
    assert (let_go[0].kernel, let_go[1].kernel) == ("geman_mcclure", "squared")
    joints = still(1).joints.requires_grad_(True)
    (pull,) = torch.autograd.grad(held[0].cost(Motion(joints), CONTEXT).sum(), joints)
    assert float(pull.norm()) == pytest.approx(2 * held[0].delta * held[0].spec.scale, rel=1e-4)


def test_its_rows_are_its_cost_where_nothing_is_held_back() -> None:
    before = still()
    after = moved(moved(before, "left_foot", [0.0, 0.1, 0.0], slice(3, 9)), "left_wrist", [0.1, 0.1, 0.0], slice(9, 20))
    body = BodyCosts.beside(before, Objective((Term("sdf_penetration", kernel="squared"),)), CONTEXT)
    found = body.assess(after, CONTEXT)
    squares = sum((rows.flatten(1).square().sum(1) for rows in found.rows), torch.zeros(2))
    torch.testing.assert_close(squares.to(found.cost), body.cost(after, CONTEXT))  # no foot slides: nor is that held
    torch.testing.assert_close(found.cost, body.cost(after, CONTEXT))
    assert float(body.cost(after, CONTEXT)[0]) > float(body.cost(before, CONTEXT)[0])


def test_a_target_out_of_reach_breaks_no_bones_and_is_named() -> None:
    """The paper's failure case (its Fig. 10), with the weights that ship: goals alone tear the arm off."""
    places = [[0.3, 1.2, 0.6], [0.3, 3.6, 1.0], [0.3, 1.2, 1.6]]
    goal = Term("joint_target", {"joint": "left_wrist", "position": places}, at=[1.0, 1.5, 2.0], tolerance=0.01)
    objective = Objective((goal,))
    for settings, strained in ((SolverSettings(natural=False), True), (SolverSettings(), False)):
        made = controlled(objective, 3.2, 1, 2, settings)
        body = BodyCosts.beside(made.unrefined, objective, CONTEXT)
        assert bool(body.strained(made.motion, THRESHOLDS.met_bones)[0]) == strained


def test_what_slides_counts_in_walks_on_level_ground_and_not_on_steps() -> None:
    """On steps a foot that swings is as low over the next one as a foot that carries, and would be held there."""
    named = [{term.spec.name for term in walk_costs(level)} for level in (True, False)]
    assert named == [{"bone_length", "foot_clearance", "foot_skating"}, {"bone_length", "foot_clearance"}]
