"""A body stays a body: what counts as strained, and what refinement does about it with the weights that ship."""

from __future__ import annotations

from dataclasses import replace

import pytest
import torch

from objectives import Context, Objective, Term, diagnosis
from scenectl.control import ObjectiveGuide, SolverSettings
from scenectl.control.refine import natural as body
from scenectl.control.refine.natural import LENIENT, STRICT, Leniency, Natural, bone_errors, leads, stretches
from scenectl.generators import load_generator
from scenectl.measures.metrics import skating_ratio
from scenes.body.body import DEFAULT_BODY
from scenes.motion.motion import Motion, Pose2D
from scenes.motion.skeleton import HUMANML3D
from scenes.world.scene import Scene
from tests.objectives.cases import standing

CONTEXT = Context(Scene.empty(), DEFAULT_BODY)
HEAD = Objective((Term("joint_target", {"joint": "head", "position": [0.0, 1.5, 0.0]}, at=1.0),))


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
        assert Natural(HEAD, before, CONTEXT).strained(after).tolist() == [strained, False]
        assert float(Natural(HEAD, before, CONTEXT).lift(after)[0]) == pytest.approx(height)
    asked = Objective((Term("joint_target", {"joint": ["head", "left_foot"], "position": [0.0, 1.0, 0.0]}, at=1.0),))
    assert not Natural(asked, before, CONTEXT).strained(after).any()
    up = replace(before, joints=before.joints + before.joints.new_tensor([0.0, 0.2, 0.0]))
    assert not Natural(HEAD, up, CONTEXT).strained(moved(up, "left_foot", [0.0, 0.1, 0.0], slice(20, 22))).any()


def test_a_foot_that_stood_in_the_floor_may_come_out_of_it() -> None:
    deep = replace(still(), joints=still().joints - torch.tensor([0.0, 0.025, 0.0]))
    natural = Natural(HEAD, deep, CONTEXT)
    for height, strained in ((0.05, False), (0.06, True)):  # 25 mm of which are no lift
        after = moved(deep, "left_foot", [0.0, height, 0.0], slice(20, 22))
        assert natural.strained(after).tolist() == [strained, False]
        assert float(natural.lift(after)[0]) == pytest.approx(height - 0.025)
    assert float(natural.lift(deep)[0]) < 0 and natural.cost(deep, CONTEXT)[0] == natural.cost(deep, CONTEXT)[1]


def test_leniency_widens_what_is_borne_of_bones_and_of_feet() -> None:
    before = still()
    natural = Natural(HEAD, before, CONTEXT)
    lifted = moved(before, "left_foot", [0.0, 0.05, 0.0], slice(20, 22))
    longer = stretched(before, "right", 0.3, slice(0, 40))  # 14 mm over 21 bones
    expectations = ((STRICT, [True, True]), (LENIENT, [True, False]), (Leniency(3, 2), [False, False]))
    for leniency, expected in expectations:
        got = [bool(natural.strained(motion, leniency)[0]) for motion in (lifted, longer)]
        assert got == expected


def test_insisting_goals_pull_harder_and_are_in_reach_within_a_hand() -> None:
    before = still()
    natural = Natural(HEAD, before, CONTEXT)
    for away, reached in ((0.1, True), (0.2, False)):
        by = torch.tensor([away, 1.5, 0.0]) - before.joint("head")[0, 20]
        assert bool(natural.in_reach(moved(before, "head", by.tolist(), slice(20, 21)), CONTEXT)[0]) == reached
    harder = natural.insisting().objective.terms
    weights = {a.goal: (a.weight, b.weight) for a, b in zip(natural.objective.terms, harder, strict=True)}
    once, insisting = weights.pop("joint_target")
    assert insisting > once and len(weights) == 5 and all(a == b for a, b in weights.values())
    lifted = moved(before, "left_foot", [0.0, 0.05, 0.0], slice(20, 22))
    assert natural.insisting()._footing(lifted).sum() > natural._footing(lifted).sum() > 0


def stretched(motion: Motion, side: str, by: float, frames: slice) -> Motion:
    """A forearm of the first sample made longer by so much (m)."""
    along = motion.joint(f"{side}_wrist")[0, 0] - motion.joint(f"{side}_elbow")[0, 0]
    return moved(motion, f"{side}_wrist", (by * along / along.norm()).tolist(), frames)


def test_bones_may_be_as_wrong_as_they_were_and_hardly_more() -> None:
    before = stretched(still(), "left", 0.06, slice(0, 40))
    natural, once, always = Natural(HEAD, before, CONTEXT), slice(5, 6), slice(0, 40)
    assert not natural.strained(before).any()
    for by, frames, expected in ((0.4, once, False), (0.45, once, True), (0.1, always, False), (0.11, always, True)):
        assert natural.strained(stretched(before, "right", by, frames)).tolist() == [expected, False]  # over 21 bones


def test_bone_errors_are_means_over_bones_and_none_in_padding() -> None:
    motion = stretched(still(1), "left", 0.21, slice(3, 5))
    valid = torch.ones(1, 40, dtype=torch.bool)
    valid[0, 4:] = False
    got = bone_errors(replace(motion, valid=valid))[0]
    assert got[:3].max() < 1e-6 and float(got[3]) == pytest.approx(0.01) and not got[4:].any()


def test_goals_that_pull_do_so_no_harder_from_afar_and_walls_as_ever() -> None:
    terms = (Term("joint_target", {"position": [9.0, 1.0, 0.0]}, at=1.0), Term("sdf_penetration", kernel="squared"))
    natural = Natural(Objective(terms), still(), CONTEXT)
    held, let_go = natural.objective.terms, natural.without_outliers.terms
    assert (held[0].kernel, held[1].kernel) == ("huber", "squared")
    assert (let_go[0].kernel, let_go[1].kernel) == ("geman_mcclure", "squared")
    joints = still(1).joints.requires_grad_(True)
    (pull,) = torch.autograd.grad(held[0].cost(Motion(joints), CONTEXT).sum(), joints)
    assert float(pull.norm()) == pytest.approx(2 * held[0].delta * held[0].spec.scale, rel=1e-4)


def test_its_rows_are_its_cost_where_nothing_is_held_back() -> None:
    before = still()
    after = moved(moved(before, "left_foot", [0.0, 0.1, 0.0], slice(3, 9)), "left_wrist", [0.1, 0.1, 0.0], slice(9, 20))
    natural = Natural(Objective((Term("sdf_penetration", kernel="squared"),)), before, CONTEXT)
    found = natural.assess(after, CONTEXT)
    squares = sum((rows.flatten(1).square().sum(1) for rows in found.rows), torch.zeros(2))
    torch.testing.assert_close(squares.to(found.cost), natural.cost(after, CONTEXT))  # no foot slides: nor is that held
    torch.testing.assert_close(found.cost, natural.cost(after, CONTEXT))
    assert float(natural.cost(after, CONTEXT)[0]) > float(natural.cost(before, CONTEXT)[0])


def test_a_target_out_of_reach_breaks_no_bones_and_is_named() -> None:
    """The paper's failure case (its Fig. 10), with the weights that ship: goals alone tear the arm off."""
    generator = load_generator("mscot")
    places = [[0.3, 1.2, 0.6], [0.3, 3.6, 1.0], [0.3, 1.2, 1.6]]
    goal = Term("joint_target", {"joint": "left_wrist", "position": places}, at=[1.0, 1.5, 2.0], tolerance=0.01)
    objective = Objective((goal,))
    for settings, strained in ((SolverSettings(natural=False), True), (SolverSettings(), False)):
        guide = ObjectiveGuide(objective, CONTEXT, settings)
        made = generator.generate("a person walks forward", 3.2, Pose2D(), guide, 1, 2)
        assert made.unrefined is not None and guide.solution is not None
        assert bool(Natural(objective, made.unrefined, CONTEXT).strained(made.motion)) == strained
    assert guide.solution.reasons == ["strained"]
    said = diagnosis(objective, made.motion[0], CONTEXT)
    assert said is not None and said.startswith("target 2 (left wrist, 1.50 s) is ") and "out of reach" in said
    others = (made.motion[0].joint("left_wrist")[[20, 40]] - torch.tensor(places)[[0, 2]]).norm(dim=-1)
    assert float(others.max()) < 0.02


def test_bones_are_minded_where_goals_lead_a_body_along_its_way() -> None:
    """With a wrist that can't follow: nothing is solved anew there, and goals alone draw the arm out."""
    generator = load_generator("mscot")
    times = [0.1 * i for i in range(1, 30)]
    way = {"joint": "pelvis", "position": [[0.0, 0.9, 0.9 * t] for t in times]}
    wrist = {"joint": "left_wrist", "position": [0.9, 1.5, 1.8]}
    wall = Term("sdf_penetration", kernel="squared", reduction="sum", weight=300.0)
    objective = Objective((Term("joint_target", way, at=times), Term("joint_target", wrist, at=2.0), wall))
    worst = []
    for natural in (False, True):
        guide = ObjectiveGuide(objective, CONTEXT, SolverSettings(natural=natural))
        made = generator.generate("a person walks forward", 3.2, Pose2D(), guide, 1, 1)
        worst.append(float(stretches(made.motion).abs().max()))
    assert made.unrefined is not None and leads(objective, made.unrefined, CONTEXT)
    assert worst[1] < 0.5 * worst[0]


def test_feet_swing_clear_of_the_floor_on_walks_slower_than_the_generators_own(monkeypatch: pytest.MonkeyPatch) -> None:
    """A metre in 1.8 s, where two are walked if nobody asks: steps made shorter are made lower, too."""
    generator = load_generator("mscot")
    corridor = {"path": [[0, 0], [0, 1]], "half_width": 0.2, "begin": 0.0, "end": 1.75}
    arrive = Term("joint_target", {"joint": "pelvis", "position": [0.0, 1.0]}, at=1.75)
    walls = Term("sdf_penetration", kernel="squared", reduction="sum", weight=300.0)
    objective, slid = Objective((Term("follow_path", corridor), arrive, walls)), []
    for minded in (body._WALKING, body._WALKING[:1]):
        monkeypatch.setattr(body, "_WALKING", minded)
        guide = ObjectiveGuide(objective, CONTEXT)
        made = generator.generate("a person walks forward", 1.8, Pose2D(), guide, 8, 0)
        assert objective.met(made.motion, CONTEXT).all()
        slid.append(float(skating_ratio(made.motion, DEFAULT_BODY.sole_offset).mean()))
    assert slid[0] < 0.5 * slid[1]


def test_a_body_is_talked_into_goals_that_alone_would_lift_its_feet() -> None:
    """Where the solver meets them at a body's cost, and a body can meet them too."""
    generator = load_generator("mscot")
    goal = Term("joint_target", {"joint": "head", "position": [0.1, 1.5, 2.2]}, at=2.0, tolerance=0.002)
    objective = Objective((goal, Term("sdf_penetration", kernel="squared", reduction="sum", weight=300.0)))
    for settings, strained in ((SolverSettings(natural=False), True), (SolverSettings(), False)):
        guide = ObjectiveGuide(objective, CONTEXT, settings)
        made = generator.generate("a person walks forward", 3.2, Pose2D(), guide, 1, 1)
        assert made.unrefined is not None and objective.met(made.motion, CONTEXT).all()
        assert bool(Natural(objective, made.unrefined, CONTEXT).strained(made.motion, LENIENT)) == strained
