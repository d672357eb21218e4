"""Terms and objectives: kernels, reductions, times, reports and static checks."""

from __future__ import annotations

import json
import math
from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import torch
from torch.autograd import forward_ad

from objectives import Context, Masked, Objective, Term, diagnosis, forget, goal
from objectives.report import TermReport
from scenes.errors import UserError
from scenes.motion.motion import Motion
from tests.objectives.cases import Joints, context, standing, wandering


@pytest.fixture
def given() -> Iterator[Any]:
    """A goal whose residual is stated by the test: `given.rows` [T, k], entries of `given.sizes`."""

    class Holder:
        rows: torch.Tensor
        sizes: int = 1

    @goal(unit="m", name="given")
    def _given(motion: Motion, context: Any) -> Masked:
        return Masked(Holder.rows.expand(*motion.valid.shape, -1), sizes=Holder.sizes)

    yield Holder
    forget("given")


def cost(motion: Motion, **options: Any) -> float:
    return float(Term("given", **options).cost(motion, context()))


def test_kernels_and_reductions(given: Any) -> None:
    motion = wandering(frames=4)
    given.rows = torch.tensor([[0.0, 0.05], [0.3, -0.4], [0.0, 0.0], [2.0, 0.0]], dtype=torch.float64)
    assert cost(motion) == pytest.approx(0.0025 + 0.25 + 4)
    assert cost(motion, reduction="mean") == pytest.approx((0.0025 + 0.25 + 4) / 8)
    assert cost(motion, kernel="linear") == pytest.approx(0.05 + 0.7 + 2)
    huber = 0.0025 + (2 * 0.1 * 0.3 - 0.01) + (2 * 0.1 * 0.4 - 0.01) + (2 * 0.1 * 2 - 0.01)
    assert cost(motion, kernel="huber", delta=0.1) == pytest.approx(huber)
    saturated = sum(0.01 * r**2 / (0.01 + r**2) for r in (0.05, 0.3, 0.4, 2.0))
    assert cost(motion, kernel="geman_mcclure", delta=0.1) == pytest.approx(saturated)
    given.sizes = 2  # now each frame holds one vector
    assert cost(motion, kernel="linear") == pytest.approx(0.05 + 0.5 + 2)
    assert cost(motion, kernel="linear", reduction="mean") == pytest.approx((0.05 + 0.5 + 2) / 4)
    given.sizes = 1


def test_times_and_windows(given: Any) -> None:
    motion = wandering(frames=6, t0=1.0)  # frames at 1.00, 1.05, ... 1.25 s
    given.rows = torch.arange(1.0, 7.0, dtype=torch.float64)[:, None]
    assert cost(motion, at=1.11) == 9
    assert cost(motion, at=[1.0, 1.25]) == 1 + 36
    assert cost(motion, at=[1.0, 1.25], weights=[2, 0.5]) == 2 + 18
    assert cost(motion, at=1.3) == 36  # the end is the last frame
    assert cost(motion, at=[0.5, 7.0]) == 0  # another window's business
    assert cost(motion, window=(1.05, 1.15), reduction="mean") == pytest.approx((4 + 9 + 16) / 3)
    assert cost(motion, window=(1.05, 1.15), at=[1.0, 1.1]) == 9
    assert cost(motion, window=(5, 6), reduction="mean") == 0


def test_sometime_is_the_best_of_its_frames(given: Any) -> None:
    motion = wandering(frames=6, t0=1.0)  # frames at 1.00, 1.05, ... 1.25 s
    given.rows = torch.tensor([0.0, 3.0, -2.0, 4.0, -9.0, 1.0], dtype=torch.float64)[:, None]
    assert cost(motion, sometime=(1.05, 1.2)) == 4
    assert cost(motion, sometime=(1.05, 1.2), kernel="linear", reduction="mean") == 2
    assert cost(motion, sometime=(0, 9)) == 0
    assert cost(motion, sometime=(5, 6)) == 0
    report = Term("given", sometime=(1.05, 1.2)).report(motion, context())[0]
    assert report.when == pytest.approx(1.1) and report.active_frames == 1


def test_sometime_is_every_samples_own_time_and_always_as_many_rows() -> None:
    motion = wandering(4, frames=20)
    wanted = motion.joint("head")[torch.arange(4), torch.tensor([3, 8, 12, 3])]
    for sample in range(4):
        term = Term("joint_target", {"joint": "head", "position": wanted[sample].tolist()}, sometime=(0.1, 0.7))
        rows = term.block(motion, context())
        assert rows.shape == (4, 1, 3)
        frames = (motion.joint("head") - wanted[sample]).norm(dim=-1)[:, 2:15]  # 0.1 to 0.7 s
        scale = term.spec.scale
        torch.testing.assert_close(rows.square().sum((1, 2)), scale * frames.amin(1).square())
        torch.testing.assert_close(term.cost(motion, context()), scale * frames.amin(1).square())
        report = term.report(motion, context())
        assert [r.when for r in report] == pytest.approx([(2 + int(i)) / 20 for i in frames.argmin(1)])


def test_sometime_moves_on_where_another_moment_is_better() -> None:
    """Its gradient is that of the frame chosen, which is that of the least cost over the frames."""
    motion = wandering(2, frames=20)
    joints = motion.joints.clone().requires_grad_(True)
    term = Term("joint_target", {"position": [0.3, 1.0, 0.2]}, sometime=(0.0, 0.9))
    (gradient,) = torch.autograd.grad(term.cost(replace(motion, joints=joints), context()).sum(), joints)
    least = (joints[:, :19, 0] - joints.new_tensor([0.3, 1.0, 0.2])).square().sum(-1).amin(1) * term.spec.scale
    (expected,) = torch.autograd.grad(least.sum(), joints)
    torch.testing.assert_close(gradient, expected)


def test_an_assessment_is_its_parts() -> None:
    motion, world = wandering(3), context()
    objective = Objective((
        Term("sdf_penetration", weight=10),
        Term("joint_target", {"position": motion.joints[1, 6, 0].tolist()}, tolerance=0.01, at=0.3),
        Term("joint_target", {"position": [0, 1, 0]}, kernel="huber", sometime=(0.1, 0.5), tolerance=9.0),
        Term("barrier", weight=0),
    ))  # fmt: skip
    found = objective.assess(motion, world)
    cost = sum((term.cost(motion, world) for term in objective.counted), start=torch.zeros(3))
    met = torch.stack([term.met(motion, world) for term in objective.counted]).all(0)
    for costs, all_met in ((found.cost, found.met), objective.judge(motion, world)):
        torch.testing.assert_close(costs, cost)
        assert torch.equal(all_met, met)
    torch.testing.assert_close(objective.cost(motion, world), cost)
    assert torch.equal(objective.met(motion, world), met)
    for rows, expected in zip(found.rows, objective.residuals(motion, world), strict=True):
        torch.testing.assert_close(rows, expected)
    empty = Objective().assess(motion, world)
    assert empty.rows == [] and empty.met.all() and not empty.cost.any()


def test_means_count_valid_frames_only(given: Any) -> None:
    given.rows = torch.arange(1.0, 7.0, dtype=torch.float64)[:, None]
    motion = replace(wandering(2, frames=6), valid=torch.tensor([[True] * 2 + [False] * 4, [True] * 6]))
    costs = Term("given", reduction="mean").cost(motion, context())
    assert costs.tolist() == pytest.approx([(1 + 4) / 2, 91 / 6])


def test_an_objective_sums_its_terms() -> None:
    motion, world = wandering(2), context()
    terms = (
        Term("sdf_penetration", weight=10),
        Term("joint_target", {"position": [0, 1, 0], "at": 0.3}),
        Term("barrier"),
    )
    objective = Objective(terms)
    total = sum(term.cost(motion, world) for term in terms)
    torch.testing.assert_close(objective.cost(motion, world), total)
    double = Objective(tuple(replace(term, weight=2 * term.weight) for term in terms))
    torch.testing.assert_close(double.cost(motion, world), 2 * total)
    assert objective.residuals(motion, world)[1].shape == (2, 1, 3)  # only the frame that counts


def test_an_empty_objective_costs_nothing_and_has_a_gradient() -> None:
    motion = wandering(3)
    joints = motion.joints.clone().requires_grad_()
    cost = Objective().cost(replace(motion, joints=joints), context())
    (gradient,) = torch.autograd.grad(cost.sum(), joints)
    assert cost.tolist() == [0, 0, 0] and not gradient.any()
    assert Objective().report(motion, context()) == [[], [], []]


def test_the_report_says_when_and_where() -> None:
    joints = standing(20, 2) + torch.tensor([0, 0.02, 0], dtype=torch.float64)
    joints[1, 13, 21] += torch.tensor([0.3, 0.0, 0.4])  # the right wrist of sample 1, in frame 13
    motion, world = Motion(joints, t0=2.0), context()
    names = ["left_wrist", "right_wrist"]
    objective = Objective(tuple(Term("height_limit", {"limit": 3, "joints": n}, name=n) for n in names))
    target = Term("joint_target", {"joint": "right_wrist", "position": joints[0, 0, 21].tolist()}, tolerance=0.1)
    reports = Objective((*objective.terms, target)).report(motion, world)
    assert [[r.met for r in rows] for rows in reports] == [[True, True, True], [True, True, False]]
    row = reports[1][2]
    assert row.worst == pytest.approx(0.5) and row.mean == pytest.approx(0.5 / 20)
    assert row.when == pytest.approx(2.0 + 13 / 20) and row.where == "right_wrist"
    assert row.position == pytest.approx(joints[1, 13, 21].tolist())
    assert row.cost == pytest.approx(200 * 0.25)
    assert "not met (worst 0.5 m at right_wrist at 2.65 s" in row.sentence()
    again = json.loads(json.dumps(row.as_dict(), allow_nan=False))
    assert again["where"] == "right_wrist" and again["met"] is False and len(again["position"]) == 3


def test_what_is_not_a_number_is_never_met() -> None:
    motion = wandering()
    motion.joints[3, 0, 0] = torch.nan
    report = Term("joint_target", {"position": [0, 1, 0]}, tolerance=100).report(motion, context())[0]
    assert not report.met and report.when == pytest.approx(3 / 20)
    assert json.dumps(report.as_dict(), allow_nan=False)


def test_a_term_that_was_never_active_says_so() -> None:
    term, motion, world = Term("foot_contact", window=(50, 60)), wandering(), context()
    report = term.report(motion, world)[0]
    assert report.when is None and report.active_frames == 0 and not report.met
    assert report.sentence() == "foot_contact: not met (never active)"
    assert report.as_dict()["worst"] is None and set(report.series) == {None}
    objective = Objective((term,))
    assert not term.met(motion, world) and not objective.met(motion, world)
    assert not objective.assess(motion, world).met and not objective.cost(motion, world).any()
    assert diagnosis(objective, motion, world) == "foot_contact is never active"
    empty = replace(motion, valid=torch.zeros_like(motion.valid))
    assert not Objective((Term("foot_contact"),)).met(empty, world)


THREE = {"kind": "array", "positions": np.zeros((4, 3, 3)).tolist()}
LINE = {"kind": "line", "start": [0, 1, 0], "end": [1, 1, 1], "times": [0, 3]}


@pytest.mark.parametrize(
    ("table", "sentence"),
    [
        ({"use": "joint_target", "position": [0, 1, 0], "at": 9}, "goal 'joint_target': time 9 s lies outside"),
        ({"use": "head_height", "height": 1, "at": [1, -2]}, "goal 'head_height': time -2 s lies outside"),
        ({"use": "smoothness", "sometime": [7, 8]}, r"goal 'smoothness': sometime \[7.0, 8.0\] s does not touch"),
        ({"use": "smoothness", "window": [7, 8]}, r"goal 'smoothness': window \[7.0, 8.0\] s does not touch"),
        ({"use": "sdf_penetration", "exempt_windows": [[8, 9]]}, "goal 'sdf_penetration': window"),
        ({"use": "joint_target", "track": LINE}, None),
        ({"use": "joint_target", "track": {**LINE, "times": [0, 7]}}, "time 7 s lies outside"),
        ({"use": "joint_target", "track": {**LINE, "end": [1, 1, 50]}}, "'track' has z = .* m, outside the scene"),
        ({"use": "sphere_repulsion", "center": {**LINE, "times": [-9, 20]}, "radius": 1}, None),
        ({"use": "joint_target", "position": [0, 1, 50], "name": "far"}, r"'far' .*: 'position' has z = 50 m"),
        ({"use": "joint_target", "position": [-3.6, 1, 0]}, "'position' has x = -3.6 m, outside the scene"),
        ({"use": "joint_target", "position": [-3.4, 1, 0]}, None),  # half a metre of slack
        ({"use": "follow_path", "path": [[0, 0], [0, 99]]}, "'path' has z = 99 m"),
        ({"use": "follow_path", "path": [[0, 0], [0, 0]]}, "at least two different points"),
        ({"use": "follow_path", "path": [[0, 0], [0, 1]], "begin": 1}, "'begin' and a later 'end'"),
        ({"use": "joint_target", "joint": "heda", "position": [0, 1, 0]}, "unknown joint 'heda'; did you mean 'head'"),
        ({"use": "sdf_penetration", "exempt": ["left_hand"]}, "unknown joint 'left_hand'"),
        ({"use": "joint_target"}, "needs either 'position' or 'track'"),
        ({"use": "joint_target", "position": [[0, 1], [1, 1]], "at": 1}, "2 positions need as many times"),
        ({"use": "joint_target", "position": [[0, 1], [1, 1]], "at": [1, 1.01]}, "fall on the same frame"),
        ({"use": "joint_target", "position": [0, 1], "axes": "xyz"}, r"states only \[x, z\]"),
        ({"use": "joint_target", "joint": ["head", "neck"], "track": THREE}, "3 columns for 2 joints"),
        ({"use": "head_height", "height": [1, 2]}, "3 moments need 3 heights"),
        ({"use": "height_limit", "limit": 1, "region": {"x": [2, 1]}}, r"x must be \[lowest, highest\]"),
        ({"use": "height_limit", "limit": 1, "region": {"y": [0, 1]}}, "unknown key 'y'"),
    ],
)  # fmt: skip
def test_mistakes_found_before_a_model_is_loaded(table: dict[str, Any], sentence: str | None) -> None:
    def check() -> None:
        Objective.from_tables([table]).check(context(), seconds=5.0)

    if sentence is None:
        check()
        return
    with pytest.raises(UserError, match=sentence) as caught:
        check()
    assert "\n" not in str(caught.value) and str(caught.value).startswith("goal '")


def test_checks_name_goals_of_users_that_fail() -> None:
    @goal(unit="m", name="broken")
    def broken(motion: Motion, context: Any, *, rows: int = 3) -> torch.Tensor:
        return motion.joints[..., 99, :rows]

    try:
        with pytest.raises(UserError, match="goal 'broken': its function failed on a standing person"):
            Objective((Term("broken"),)).check(context(), seconds=2.0)
    finally:
        forget("broken")


def test_a_check_bakes_nothing() -> None:
    class Costly:
        bounds = np.array([[-1.0, 0, -1], [1, 2, 1]])

        def distance(self, points: torch.Tensor, time: torch.Tensor | None = None) -> torch.Tensor:
            raise AssertionError("asked for distances")

    world = Context(Costly(), Joints())
    Objective((Term("sdf_penetration"), Term("foot_contact"))).check(world, seconds=2.0)


def test_rows_have_forward_derivatives() -> None:
    """Gauss-Newton solvers push tangents through the rows: J v agrees with differences."""
    motion, world = wandering(2), context()
    objective = Objective((Term("sdf_penetration"), Term("joint_target", {"position": [0, 1, 0], "at": 0.2})))
    tangent = torch.randn(motion.joints.shape, dtype=torch.float64)

    def rows(joints: torch.Tensor) -> list[torch.Tensor]:
        return objective.residuals(replace(motion, joints=joints), world)

    with forward_ad.dual_level():
        pushed = [forward_ad.unpack_dual(r).tangent for r in rows(forward_ad.make_dual(motion.joints, tangent))]
    step = 1e-6
    ahead, behind = rows(motion.joints + step * tangent)[1], rows(motion.joints - step * tangent)[1]
    torch.testing.assert_close(pushed[1], (ahead - behind) / (2 * step))
    assert torch.isfinite(pushed[0]).all()


def test_a_report_of_a_term_comes_back_from_json_whatever_it_holds() -> None:
    whole = {"name": "a", "goal": "a", "unit": "m", "worst": 1, "mean": None, "tolerance": 0, "met": True, "cost": 2.0}
    told = TermReport.from_dict({**whole, "weight": 3, "active_frames": 0, "when": 0, "position": [None, 1, 0.5]})
    assert told.mean == math.inf and told.when == 0.0 and told.position is not None and math.isnan(told.position[0])
    assert TermReport.from_dict({**whole, "weight": 3, "active_frames": 0}).when is None
