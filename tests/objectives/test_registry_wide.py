"""What must hold for every registered goal."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import torch

from objectives import Context, Objective, Term, WorldZ, forget, get_goal, goal, goals
from scenes.errors import UserError
from scenes.motion.motion import Motion
from tests.objectives.cases import EXAMPLES, SATISFIED, context, standing, wandering

CASES = [
    pytest.param(name, example, id=f"{name}-{i}") for name, all_ in EXAMPLES.items() for i, example in enumerate(all_)
]


def term(name: str, parameters: dict[str, Any], **options: Any) -> Term:
    return Term.from_table({"use": name, **parameters, **options})


def test_every_goal_has_an_example_and_documentation() -> None:
    assert {spec.name for spec in goals()} == set(EXAMPLES) == set(SATISFIED)
    for spec in goals():
        assert spec.summary and spec.unit
        assert all(p.doc for p in spec.parameters.values()), spec.name


@pytest.mark.parametrize("kernel", [None, "squared", "linear", "huber", "geman_mcclure"])
@pytest.mark.parametrize(("name", "example"), CASES)
def test_gradient(name: str, example: Any, kernel: str | None) -> None:
    """The example has a residual, and autograd agrees with central differences along random directions."""
    one = term(name, example(0.0), **({"kernel": kernel} if kernel else {}))
    motion, world = wandering(), context()

    def cost(joints: torch.Tensor) -> torch.Tensor:
        return one.cost(replace(motion, joints=joints), world)

    joints = motion.joints.clone().requires_grad_()
    value = cost(joints)
    (gradient,) = torch.autograd.grad(value, joints)
    assert value > 0 and gradient.abs().max() > 0
    assert torch.autograd.gradcheck(cost, joints, eps=1e-7, atol=1e-5, rtol=1e-4, fast_mode=True)


@pytest.mark.parametrize("name", SATISFIED)
@pytest.mark.parametrize("kernel", ["squared", "linear", "huber", "geman_mcclure"])
def test_satisfied_exactly(name: str, kernel: str) -> None:
    """Zero cost, a finite (zero) gradient, and met."""
    joints, world = standing(9) + torch.tensor([0, 0.02, 0], dtype=torch.float64), context(x=2.0)
    parameters = dict(SATISFIED[name])
    if name == "joint_target":
        parameters["position"] = joints[0, 0].tolist()
    if name == "head_height":
        parameters["height"] = float(joints[0, 15, 1])
    one, motion = term(name, parameters, kernel=kernel), Motion(joints.requires_grad_())
    cost = one.cost(motion, world)
    (gradient,) = torch.autograd.grad(cost, joints)
    assert cost == 0
    assert torch.equal(gradient, torch.zeros_like(gradient))
    assert one.report(motion, world)[0].met


@pytest.mark.parametrize(("name", "example"), CASES)
def test_batch_equals_loop(name: str, example: Any) -> None:
    one, motion, world = term(name, example(0.0)), wandering(2, 3), context()
    costs = one.cost(motion, world)
    assert costs.shape == (2, 3)
    rows = one.report(motion, world)
    for i in range(2):
        for j in range(3):
            single = motion[i][j]
            torch.testing.assert_close(one.cost(single, world), costs[i, j])
            assert one.report(single, world)[0].worst == pytest.approx(rows[3 * i + j].worst)


@pytest.mark.parametrize(("name", "example"), CASES)
def test_padding_is_ignored(name: str, example: Any) -> None:
    """Frames after the end change nothing, whatever is in them, and get no gradient."""
    one, motion, world = term(name, example(0.0)), wandering(frames=9), context()
    for junk in (0.0, 7.0, torch.nan, torch.inf):
        joints = torch.cat([motion.joints, torch.full((4, 22, 3), junk, dtype=torch.float64)]).requires_grad_()
        padded = Motion(joints, torch.arange(13) < 9)
        cost = one.cost(padded, world)
        torch.testing.assert_close(cost, one.cost(motion, world))
        (gradient,) = torch.autograd.grad(cost, joints)
        assert torch.isfinite(gradient).all() and not gradient[9:].any()
        assert one.report(padded, world)[0].worst == pytest.approx(one.report(motion, world)[0].worst)


@pytest.mark.parametrize(("name", "example"), CASES)
def test_time_shift(name: str, example: Any) -> None:
    """Only the task's clock counts: shift it and every stated time together, and nothing changes."""
    here, there = wandering(t0=0.0), wandering(t0=2.5)
    was, now = term(name, example(0.0)), term(name, example(2.5))
    torch.testing.assert_close(was.cost(here, context()), now.cost(there, context(epoch=2.5)))
    before, after = was.report(here, context())[0], now.report(there, context(epoch=2.5))[0]
    assert after.when == pytest.approx(before.when + 2.5)


@pytest.mark.parametrize(("name", "example"), [case for case in CASES if get_goal(str(case.values[0])).local])
def test_a_local_goal_says_the_same_of_a_part(name: str, example: Any) -> None:
    """What a term with a window shows its goal is all that counts there: velocities at its edges, too."""
    motion, world, given = wandering(2, frames=60), context(), example(0.0)
    one = term(name, given) if {"at", "window"} & given.keys() else term(name, given, window=(0.35, 0.6))
    part, whole = one.evaluate(motion, world), one._evaluated(motion, world)
    assert one._applies(motion) is not None
    assert torch.equal(part.mask, whole.mask)
    for key in ("residual", "square"):
        torch.testing.assert_close(getattr(part, key), getattr(whole, key), atol=1e-9, rtol=1e-7)
    torch.testing.assert_close(one.cost(motion, world), one._cost(whole), atol=1e-9, rtol=1e-7)
    now = part.mask.any(-1)
    for a, b in ((part.points, whole.points), (part.targets, whole.targets)):
        if a is not None and b is not None:
            torch.testing.assert_close(a[now], b.expand(a.shape)[now], equal_nan=True)


@pytest.mark.parametrize(("name", "example"), CASES)
def test_a_part_of_a_motion_has_a_clock_of_its_own(name: str, example: Any) -> None:
    """Every time of a goal says that it is one, those that it takes by default too."""
    first, later = wandering(2), wandering(2, t0=5.0)
    here = term(name, example(0.0)).residual(first, context())
    there = term(name, example(0.0)).during(5.0, 5.0 + later.seconds).residual(later, context(epoch=5.0))
    torch.testing.assert_close(there, here, atol=1e-6, rtol=1e-6)


@pytest.mark.parametrize(("name", "example"), CASES)
def test_weight_zero_equals_absent(name: str, example: Any) -> None:
    motion, world = wandering(2), context()
    other = term("smoothness", {"limit": 5.0})
    absent, silent = Objective((other,)), Objective((other, term(name, example(0.0), weight=0.0)))
    assert torch.equal(absent.cost(motion, world), silent.cost(motion, world))
    assert len(silent.residuals(motion, world)) == 1
    assert silent.report(motion, world) == absent.report(motion, world)


@pytest.mark.parametrize(("name", "example"), CASES)
def test_kernels_are_zero_with_the_residual_only(name: str, example: Any) -> None:
    motion, world = wandering(3), context()
    for kernel in ("squared", "linear", "huber"):
        one = term(name, example(0.0), kernel=kernel)
        cost, residual = one.cost(motion, world), one.residual(motion, world)
        assert (cost >= 0).all()
        assert torch.equal(cost > 0, (residual != 0).flatten(1).any(1))


@pytest.mark.parametrize("kernel", ["squared", "linear", "huber", "geman_mcclure"])
@pytest.mark.parametrize(("name", "example"), CASES)
def test_rows_for_least_squares(name: str, example: Any, kernel: str) -> None:
    """Squared: the squares sum to the cost. All: their gradient is the cost's."""
    motion, world = wandering(2), context()
    joints = motion.joints.clone().requires_grad_()
    moving = replace(motion, joints=joints)
    one = term(name, example(0.0), kernel=kernel, weight=1.7)
    cost, squares = one.cost(moving, world), one.block(moving, world).square().sum((-2, -1))
    if kernel == "squared":
        torch.testing.assert_close(squares, cost)
    (wanted,) = torch.autograd.grad(cost.sum(), joints)
    (found,) = torch.autograd.grad(squares.sum(), joints)
    torch.testing.assert_close(found, wanted)


@pytest.mark.parametrize(("name", "example"), CASES)
def test_where_everything_lies_elsewhere_nothing_changes(name: str, example: Any) -> None:
    """Every coordinate of a goal says that it is one, those that it takes by default too."""
    one, motion, world, by = term(name, example(0.0)), wandering(2), context(), (5.0, 3.0, -7.0)
    ball = replace(world.scene, center=tuple(np.add(world.scene.center, by)), floor=by[1])
    there = motion.moved(by), Context(ball, world.body)
    torch.testing.assert_close(one.moved(by).residual(*there), one.residual(motion, world), atol=1e-9, rtol=0)
    assert [m.shape for m in one.moved(by).marks(there[0][0], there[1])] == [
        m.shape for m in one.marks(motion[0], world)
    ]
    back = one.moved(by).moved((-5.0, -3.0, 7.0))
    torch.testing.assert_close(back.residual(motion, world), one.residual(motion, world), atol=1e-9, rtol=0)


def test_a_number_that_can_only_be_a_coordinate_says_which() -> None:
    @goal(unit="m")
    def beside(motion: Motion, context: Context, *, x: float = 0.0, z: WorldZ = 0.0, strength: float = 2000.0) -> Any:
        """Stay there."""
        return motion.joint("pelvis")[..., ::2] - torch.tensor([x, z])

    try:
        assert Term(beside, {"z": 4500002.0}).moved((-5e5, 0.0, -4.5e6)).parameters["z"] == 2.0
        message = r"goal 'beside': parameter 'x': 500002.25 looks like a coordinate .* annotate it .* WorldX"
        with pytest.raises(UserError, match=message):
            Term(beside, {"x": 500002.25}).moved((-5e5, 0.0, -4.5e6))
    finally:
        forget("beside")
