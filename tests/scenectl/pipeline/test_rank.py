"""The order of samples: met and believable, met, the rest; each by how little refinement changed poses, then cost."""

from __future__ import annotations

from dataclasses import replace

import pytest
import torch
from hypothesis import given, settings, strategies as st

import scenectl as sc
from objectives import Objective, Term
from scenectl.generators.prompts import Prompts
from scenectl.measures.believability.judge import Judge
from scenectl.measures.believability.verdict import Finding, Verdict
from scenectl.measures.metrics import Depths, Scorer
from scenectl.pipeline.rank import ranked
from scenectl.pipeline.results import Sample
from scenectl.tasks.setup import Setup
from scenes.mesh.primitives import Box
from scenes.motion.motion import Motion
from scenes.world.scene import Scene
from tests.scenectl.small import walk

WALK = walk(20)
LIMP = Verdict((Finding("sliding", 0.5, 0.1, "m/s", "left foot slides at 0.5 m/s at 0.40 s", 0.4, "left_foot"),))


def setup(**task: object) -> Setup:
    return sc.Task(**{"prompt": "a person walks", "seconds": 2.0, **task}).build()


def judged(monkeypatch: pytest.MonkeyPatch, believable: list[bool]) -> None:
    """A judge that finds fault with those samples, told apart by where the pelvis begins."""

    def verdict(self: Judge, motion: Motion, depths: Depths | None = None) -> Verdict:
        return Verdict() if believable[round(float(motion.joint("pelvis")[0, 0]))] else LIMP

    monkeypatch.setattr(Judge, "verdict", verdict)


@settings(max_examples=25, deadline=None)
@given(st.lists(st.tuples(st.booleans(), st.booleans(), st.integers(0, 3)), min_size=1, max_size=6))
def test_samples_are_ranked_by_both_then_met_then_change_then_cost(facts: list[tuple[bool, bool, int]]) -> None:
    made = replace(setup(), objective=Objective((Term("head_height", {"height": 1.0}, tolerance=0.5),)))
    before = WALK.repeat(len(facts), 1, 1, 1)
    before[..., 0] += torch.arange(float(len(facts)))[:, None, None]
    after = before.clone()
    for sample, (met, _, change) in enumerate(facts):
        after[sample, :, 15, 1] = 1.0 if met else 3.0  # the head
        before[sample] = after[sample]
        before[sample, :, 20, 1] += 0.1 * change  # a wrist
    with pytest.MonkeyPatch.context() as patched:
        judged(patched, [believable for _, believable, _ in facts])
        best_first, rows = ranked(Motion(after), Motion(before), made, Scorer(made.scene), lambda what, done: None)
    told = [(row.good, row.met, round(row.pose_change or 0.0, 3), row.cost) for row in rows]
    assert told == sorted(told, key=lambda t: (not t[0], not t[1], t[2], t[3]))
    for place, row in enumerate(rows):
        met, believable, change = facts[row.index]
        assert (row.met, row.believable, row.good) == (met, believable, met and believable)
        assert row.pose_change == pytest.approx(0.1 * change / 22, abs=1e-6)
        assert torch.equal(best_first.joints[place], after[row.index])


def test_what_is_met_but_not_believable_comes_after_what_is_both_though_it_is_cheaper(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    judged(monkeypatch, [False, True])
    made = replace(setup(), objective=Objective((Term("head_height", {"height": 1.5}, tolerance=9.0),)))
    two = WALK.repeat(2, 1, 1, 1)
    two[1, :, :, 0] += 1.0
    two[1, :, 15, 1] += 1.0  # dearer
    _, rows = ranked(Motion(two), None, made, Scorer(made.scene), lambda what, done: None)
    assert [row.index for row in rows] == [1, 0] and rows[0].cost > rows[1].cost
    assert rows[1].met and not rows[1].believable and rows[1].verdict.sentence == LIMP.sentence


def test_the_judge_is_told_the_sentence_and_what_goals_exempt(monkeypatch: pytest.MonkeyPatch) -> None:
    seen: list[Judge] = []
    monkeypatch.setattr(Judge, "verdict", lambda self, motion, depths=None: seen.append(self) or Verdict())
    goals = [
        sc.Term("sdf_penetration", {"exempt": ["right_wrist"], "exempt_windows": [[0.5, 1.0]]}),
        sc.Term("swept_penetration", {"exempt": "left_foot"}),
        sc.Term("sdf_penetration", {"exempt_windows": [[1.0, 1.5]]}, name="the whole body"),
        sc.Term("sdf_penetration", name="nothing"),
        sc.Term("sdf_penetration", {"exempt": ["head"]}, weight=0.0, name="switched off"),
    ]
    made = setup(prompt="a person reaches", goals=goals)
    ranked(Motion(WALK[None]), None, made, Scorer(made.scene), lambda what, done: None)
    assert seen[0].prompt == Prompts.of("a person reaches")
    assert seen[0].exemptions == (
        (("right_wrist",), ((0.5, 1.0),)), (("left_foot",), None), ((), ((1.0, 1.5),)),
    )  # fmt: skip


def test_depths_are_asked_for_once(monkeypatch: pytest.MonkeyPatch) -> None:
    made = setup(scene=Scene(primitives=[Box((0.0, 1.0, 3.0), (1.0, 2.0, 0.4))], floor=0.0), start=[0.0, 0.0])
    asked, given_ = [], []
    depths = Scorer.depths
    monkeypatch.setattr(Scorer, "depths", lambda self, motion: asked.append(motion) or depths(self, motion))
    monkeypatch.setattr(Judge, "verdict", lambda self, motion, depths=None: given_.append(depths) or Verdict())
    monkeypatch.setattr(Judge, "series", lambda self, motion, depths=None: given_.append(depths) or {})
    ranked(Motion(WALK.repeat(3, 1, 1, 1)), None, made, Scorer(made.scene), lambda what, done: None)
    assert len(asked) == 3 and all(isinstance(one, Depths) for one in given_)


def test_a_goal_that_is_never_active_is_not_met() -> None:
    made = setup(avoid=False, goals=[sc.Term("head_height", {"height": 1.2}, at=1.9, tolerance=9.0)])
    short = Motion(WALK[None], torch.tensor([[True] * 15 + [False] * 5]))
    _, (row,) = ranked(short, None, made, Scorer(made.scene), lambda what, done: None)
    assert isinstance(row, Sample) and not row.met and row.diagnosis == "head_height is never active"
