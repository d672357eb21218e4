"""Bodies of other sizes: rigid bones, steps as long as the legs, nothing where the body is the generator's own."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import torch
from hypothesis import given, settings, strategies as st
from torch import Tensor

from objectives import Context, Objective, Term
from scenectl.control import Figure, FigureGuide, ObjectiveGuide
from scenectl.generators.base import Step
from scenectl.generators.mscot.sampling import MSCoT
from scenectl.measures.believability.judge import Judge
from scenectl.measures.metrics import Scorer, measure
from scenectl.pipeline.generation import Made, make
from scenectl.tasks.conditions import conditions_of
from scenes.body.body import DEFAULT_BODY, ProxyBody
from scenes.errors import UserError
from scenes.motion.bones import bone_lengths, rest_lengths
from scenes.motion.motion import Motion, Pose2D
from scenes.motion.skeleton import HUMANML3D, Skeleton, with_lengths
from scenes.world.scene import Scene
from tests.scenectl.small import bundle, walk

HERE = Pose2D((1.0, DEFAULT_BODY.sole_offset, -2.0), 0.7)
WALK = Motion(walk(40)).placed(HERE)


def others(draw: np.random.Generator) -> Skeleton:
    """Somebody of other proportions, left and right alike."""
    names = [name.removeprefix("left_").removeprefix("right_") for name in HUMANML3D.names]
    factor = {name: draw.uniform(0.6, 1.4) for name in sorted(set(names))}
    return with_lengths(HUMANML3D, HUMANML3D.bone_lengths * np.array([factor[name] for name in names]))


def off(motion: Motion) -> float:
    """How far (m) any bone is off its skeleton's."""
    return float((bone_lengths(motion) - rest_lengths(motion)).abs().max())


@settings(max_examples=15, deadline=None)
@given(st.integers(0, 10**6))
def test_any_body_is_rigid_keeps_its_directions_and_takes_steps_as_long_as_its_legs(seed: int) -> None:
    body = others(np.random.default_rng(seed))
    figure = Figure.between(HUMANML3D, body, HERE.position)
    assert figure is not None and figure.ratio == pytest.approx(body.legs / HUMANML3D.legs)
    made = figure.of(WALK)
    assert made.skeleton == body and off(made) < 1e-5
    knee, ankle = HUMANML3D.indices(("left_knee", "left_ankle"))
    shins = [(m.joints[:, ankle] - m.joints[:, knee]) / (m.joints[:, ankle] - m.joints[:, knee]).norm(dim=-1)[:, None]
             for m in (WALK, made)]  # fmt: skip
    torch.testing.assert_close(*shins, atol=1e-4, rtol=0)
    ways = [m.joint("pelvis").diff(dim=0) for m in (WALK, made)]
    torch.testing.assert_close(figure.ratio * ways[0], ways[1], atol=1e-5, rtol=0)
    back = Figure.between(body, HUMANML3D, HERE.position)
    assert back is not None
    torch.testing.assert_close(back.of(made).joints, WALK.joints, atol=1e-4, rtol=0)


@pytest.mark.parametrize("height", [1.2, 1.55, 2.1])
def test_a_body_of_the_same_proportions_moves_as_the_generators_own_seen_larger_or_smaller(height: float) -> None:
    body, ground = ProxyBody.human(height), torch.tensor(HERE.position)
    figure = Figure.between(HUMANML3D, body.skeleton, HERE.position)
    assert figure is not None
    torch.testing.assert_close(
        figure.of(WALK).joints, ground + height / 1.7 * (WALK.joints - ground), atol=1e-5, rtol=0
    )
    torch.testing.assert_close(figure.back(figure.place(WALK.joints)), WALK.joints, atol=1e-5, rtol=0)


def test_there_is_nothing_between_a_body_and_itself_and_no_way_to_other_joints() -> None:
    assert Figure.between(HUMANML3D, DEFAULT_BODY.skeleton, HERE.position) is None
    robot = Skeleton(("base", "tip"), (-1, 0), ((0.0, 0.0, 0.0), (0.0, 1.0, 0.0)))
    with pytest.raises(UserError, match="2 joints of its own"):
        Figure.between(HUMANML3D, robot, HERE.position)


def made_for(body: ProxyBody, *goals: Term) -> Made:
    context = Context(Scene.empty(), body)
    start = Pose2D((1.0, body.sole_offset, -2.0), 0.7)
    return make(MSCoT(bundle()), "a person walks", 2.0, start, Objective(goals), context, samples=2)


@pytest.mark.parametrize("led", [False, True])
def test_motions_for_a_body_are_on_its_bones_with_goals_and_without(led: bool) -> None:
    child = ProxyBody.human(1.25)
    goals = (Term("joint_target", {"joint": "left_wrist", "position": [1.2, 0.7, -1.7]}, at=1.0),) if led else ()
    made = made_for(child, *goals)
    assert made.motion.skeleton == child.skeleton and off(made.motion) < 1e-4
    if made.unrefined is not None:
        assert off(made.unrefined) < 1e-4
    else:  # what an adult does, seen smaller
        adult, ground = made_for(DEFAULT_BODY).motion.joints, torch.tensor([1.0, DEFAULT_BODY.sole_offset, -2.0])
        small = (made.motion.joints - torch.tensor([1.0, child.sole_offset, -2.0])) * 1.7 / 1.25
        torch.testing.assert_close(small, adult - ground, atol=1e-4, rtol=0)


class Seeing:
    """A guide that keeps what it saw."""

    def __init__(self) -> None:
        self.seen: list[Motion] = []

    def log_prob(self, step: Step) -> Tensor:
        self.seen.append(step.decode(step.value))
        return torch.zeros(len(step.value))

    def gradient(self, step: Step) -> Tensor:
        self.seen.append(step.motion)
        return torch.zeros_like(step.value)


def test_guides_see_the_body() -> None:
    giant, seeing = ProxyBody.human(2.05), Seeing()
    figure = Figure.between(HUMANML3D, giant.skeleton, HERE.position)
    assert figure is not None
    draft = MSCoT(bundle()).generate("a person walks", 2.0, HERE, guide=FigureGuide(seeing, figure))
    assert draft.step is not None
    FigureGuide(seeing, figure).log_prob(draft.step)
    assert len(seeing.seen) > 1 and all(m.skeleton == giant.skeleton and off(m) < 1e-4 for m in seeing.seen)


def test_a_guides_gradient_goes_through_the_body() -> None:
    child = ProxyBody.human(1.25)
    figure = Figure.between(HUMANML3D, child.skeleton, HERE.position)
    goal = Objective((Term("joint_target", {"position": [1.4, 0.6, -1.5]}, at=1.0),))
    guide = ObjectiveGuide(goal, Context(Scene.empty(), child), figure=figure)
    step = MSCoT(bundle()).generate("a person walks", 2.0, HERE).step
    assert step is not None
    with torch.no_grad():
        gradient = guide.gradient(step)
        way = gradient / gradient.norm()
        ends = [float(guide.log_prob(step.at(step.value + sign * 0.01 * way))) for sign in (1, -1)]
    assert (ends[0] - ends[1]) / 0.02 == pytest.approx(float(gradient.norm()), rel=0.05)


def test_conditions_are_stated_for_the_generators_own_body() -> None:
    child = ProxyBody.human(1.25)
    figure = Figure.between(HUMANML3D, child.skeleton, HERE.position)
    assert figure is not None
    goal = Objective((Term("joint_target", {"joint": "left_wrist", "position": [1.2, 0.7, -1.7]}, at=1.0),))
    spec = MSCoT.spec
    [place] = conditions_of(goal, Context(Scene.empty(), child), HERE, 2.0, spec, figure).positions
    torch.testing.assert_close(figure.place(place), torch.tensor([1.2, 0.7, -1.7]), atol=1e-5, rtol=0)


@pytest.mark.parametrize("height", [1.25, 2.05])
def test_figures_and_verdict_are_those_of_an_adult_who_does_the_same(height: float) -> None:
    body = ProxyBody.human(height)
    figure = Figure.between(HUMANML3D, body.skeleton, (0.0, 0.0, 0.0))
    assert figure is not None
    joints = walk(60, speed=1.3)
    slid = joints + torch.arange(60)[:, None, None] / 60 * torch.tensor([1.0, 0.0, 0.0])  # feet slide aside
    for one in (Motion(joints), Motion(slid)):
        low = float(one.joints[..., 1].min())
        one = replace(one, joints=one.joints - torch.tensor([0.0, low - DEFAULT_BODY.sole_offset, 0.0]))
        adult, other = Scorer(Scene.empty()), Scorer(Scene.empty(), body)
        theirs = figure.of(one)
        assert measure(theirs, other)["skating_ratio"] == measure(one, adult)["skating_ratio"]
        found = [Judge(scorer, "a person walks").verdict(m) for m, scorer in ((one, adult), (theirs, other))]
        named = [{f.check for f in verdict.findings} - {"penetration"} for verdict in found]  # a centimetre is one
        assert named[0] == named[1]
        tempo = [verdict.figures["tempo_times"] for verdict in found]
        assert tempo[0] == pytest.approx(tempo[1], rel=1e-3)
        rates = [verdict.figures["sliding_0.5s_m_per_s"] for verdict in found]
        assert rates[1] == pytest.approx(height / 1.7 * rates[0], rel=0.15, abs=1e-3)
