"""Solvers on problems whose answers are known, one sample at a time and in batches."""

from __future__ import annotations

from collections.abc import Callable
from functools import cached_property, partial

import pytest
import torch
from pydantic import ValidationError
from torch import Tensor

from scenectl.control.settings import GuidanceSettings, SolverSettings
from scenectl.control.solvers.choice import Choice, choose, minimise
from scenectl.control.solvers.least_squares import levenberg_marquardt
from scenectl.control.solvers.problem import Problem, Search, Solution, judged
from scenectl.generators.base import Price
from scenectl.generators.steps import AUTOGRAD, LINEARISED

NAMES = ["lbfgs", "adam", "gradient", "lm", "gauss_newton"]
STEPLESS = ("lbfgs", "lm", "gauss_newton")
CENTRES = torch.tensor([[1.0, -2.0, 0.5], [0.0, 0.3, 4.0], [-1.0, -1.0, -1.0]])


def never(x: Tensor) -> Tensor:
    return torch.zeros(len(x), dtype=torch.bool)


Rows = Callable[[Tensor], Tensor]
"""Residuals ``[S, R]`` of points ``[S, n]``; the cost is their sum of squares."""


class Dense:
    """Residuals at a point, differentiated by torch."""

    def __init__(self, residual: Rows, x: Tensor, done: Callable[[Tensor], Tensor] = never) -> None:
        self.residual, self.x, self.met = residual, x, done(x)
        self.rows = residual(x)
        self.cost = self.rows.square().sum(1)

    @cached_property
    def whole(self) -> Tensor:
        """``[S, R, n]``: samples do not see one another, so the sum over them has each one's own gradient."""
        by_row = torch.autograd.functional.jacobian(lambda x: self.residual(x).sum(0), self.x)
        return by_row.transpose(0, 1)

    def jvp(self, tangent: Tensor) -> Tensor:
        return (self.whole @ tangent[..., None]).squeeze(-1)

    def vjp(self, cotangent: Tensor) -> Tensor:
        return (self.whole.mT @ cotangent[..., None]).squeeze(-1)

    def jacobian(self, rows: Tensor) -> Tensor:
        return self.whole[:, rows]


def solve(
    residual: Rows,
    start: Tensor,
    name: str,
    done: Callable[[Tensor], Tensor] = never,
    **settings: object,
) -> Solution:
    given = SolverSettings.model_validate({"name": name, "prior": 0.0, **settings})

    return minimise(Problem(judged(partial(cost_of, residual), done), start, lambda x: Dense(residual, x, done)), given)


def cost_of(residual: Rows, x: Tensor) -> Tensor:
    return residual(x).square().sum(1)


def quadratic(x: Tensor) -> Tensor:
    """Each sample its own centre and its own scale."""
    n = len(x)
    return torch.tensor([0.5, 5.0, 20.0])[:n, None].sqrt() * ((x - CENTRES[:n]) * torch.tensor([1.0, 0.7, 0.4]))


def rosenbrock(x: Tensor) -> Tensor:
    return torch.stack([1 - x[:, 0], 10 * (x[:, 1] - x[:, 0].square())], dim=1)


def hinge(x: Tensor) -> Tensor:
    """Flat where it is satisfied, as distances to obstacles are."""
    return (1.0 - x).clamp_min(0.0)


@pytest.mark.parametrize("name", NAMES)
def test_a_quadratic_is_solved(name: str) -> None:
    step = {"adam": 0.05, "gradient": 0.02}.get(name)
    got = solve(quadratic, torch.zeros(3, 3), name, iterations=2000, step=step, patience=500, progress=1e-9)
    torch.testing.assert_close(got.value, CENTRES, atol=2e-2, rtol=0)
    torch.testing.assert_close(got.cost, cost_of(quadratic, got.value))


def test_lbfgs_walks_along_the_valley_of_rosenbrock() -> None:
    start = torch.tensor([[-1.2, 1.0], [2.0, -3.0], [0.0, 0.0]])
    got = solve(rosenbrock, start, "lbfgs", iterations=150)
    torch.testing.assert_close(got.value, torch.ones(3, 2), atol=1e-2, rtol=0)
    assert got.evaluations < 300


@pytest.mark.parametrize("name", NAMES)
def test_a_hinge_is_reached_and_what_is_satisfied_stays(name: str) -> None:
    start = torch.tensor([[-1.0, 3.0], [0.5, 0.5], [2.0, 2.0]])
    got = solve(hinge, start, name, iterations=400, step=None if name in STEPLESS else 0.05, patience=100)
    assert hinge(got.value).max() < 0.04
    assert got.value[0, 1] == 3.0 and torch.equal(got.value[2], start[2])


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("cost", [quadratic, rosenbrock, hinge])
def test_a_batch_gives_what_a_loop_gives(name: str, cost: Callable[[Tensor], Tensor]) -> None:
    size = 3 if cost is quadratic else 2
    start = torch.tensor([[-1.2, 1.0, 0.0], [1.0, 1.0, 1.0], [3.0, -0.5, 2.0]])[:, :size]
    settings = {"iterations": 30, "step": None if name in STEPLESS else 1e-3, "patience": 5}

    def only(sample: int) -> Callable[[Tensor], Tensor]:
        return lambda x: cost(torch.cat([start[:sample], x, start[sample + 1 :]]))[sample : sample + 1]

    together = solve(cost, start, name, **settings)
    for sample in range(3):
        alone = solve(only(sample), start[sample : sample + 1], name, **settings)
        torch.testing.assert_close(together.value[sample], alone.value[0], atol=1e-4, rtol=1e-4)
        torch.testing.assert_close(together.cost[sample], alone.cost[0], atol=1e-5, rtol=1e-3)


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("step", [1e-3, 10.0])
def test_no_solver_ever_returns_worse_than_it_was_given(name: str, step: float) -> None:
    start = torch.randn(6, 2)
    got = solve(rosenbrock, start, name, iterations=15, step=step)
    assert (got.cost <= cost_of(rosenbrock, start)).all()
    torch.testing.assert_close(got.cost, cost_of(rosenbrock, got.value))
    history = torch.stack(got.history)
    assert (history.diff(dim=0) <= 0).all()


@pytest.mark.parametrize("name", NAMES)
def test_no_iterations_leave_the_start_and_know_its_cost(name: str) -> None:
    start = torch.randn(3, 3)
    got = solve(quadratic, start, name, iterations=0)
    assert torch.equal(got.value, start) and got.evaluations == 1
    torch.testing.assert_close(got.cost, cost_of(quadratic, start))


@pytest.mark.parametrize("name", NAMES)
def test_costs_that_are_no_numbers_are_survived(name: str) -> None:
    def cliff(x: Tensor) -> Tensor:
        """A parabola that is not a number beyond 1, nor ever for the second sample; infinite for the third."""
        rows = (x - 0.9) + torch.where(x > 1.0, torch.nan, 0.0)
        return rows + torch.tensor([0.0, torch.nan, torch.inf])[:, None]

    start = torch.zeros(3, 2)
    got = solve(cliff, start, name, iterations=100, step=None if name in STEPLESS else 0.1, patience=50)
    assert torch.isfinite(got.value).all()
    assert got.cost[0] < 0.05 and got.cost[1:].isinf().all()
    assert torch.equal(got.value[1:], start[1:])


@pytest.mark.parametrize("name", NAMES)
def test_a_search_that_gets_nowhere_ends_after_its_patience(name: str) -> None:
    passes = 0

    def flat(x: Tensor) -> Tensor:
        nonlocal passes
        passes += 1
        return 0.0 * x + 1.0

    got = solve(flat, torch.zeros(2, 3), name, iterations=1000, patience=4)
    assert got.reasons == ["no progress"] * 2 and len(got.history) <= 6 and got.evaluations <= passes < 60


@pytest.mark.parametrize("name", NAMES)
def test_samples_that_are_good_enough_stop_and_the_others_go_on(name: str) -> None:
    def enough(x: Tensor) -> Tensor:
        return torch.tensor([True, False])

    start = torch.zeros(2, 3)
    settings = {"iterations": 60, "step": None if name in STEPLESS else 0.02, "patience": 60, "progress": 1e-12}

    def slow(x: Tensor) -> Tensor:
        return (x - 1).square()

    got = solve(slow, start, name, enough, **settings)
    free = solve(slow, start, name, **settings)
    assert got.cost[0] > free.cost[0]
    torch.testing.assert_close(got.cost[1], free.cost[1], atol=1e-6, rtol=1e-3)


def test_a_retired_sample_costs_no_further_passes() -> None:
    alone = solve(rosenbrock, torch.tensor([[-1.2, 1.0]]), "lbfgs", iterations=150)
    pair = solve(rosenbrock, torch.tensor([[-1.2, 1.0], [1.0, 1.0]]), "lbfgs", iterations=150)
    torch.testing.assert_close(pair.value[0], alone.value[0], atol=1e-3, rtol=0)
    assert pair.evaluations <= alone.evaluations + 11


def test_gradient_ascent_is_the_papers_with_its_step_of_a_hundredth() -> None:
    x = torch.zeros(3, 3, requires_grad=True)
    for _ in range(7):
        (gradient,) = torch.autograd.grad(cost_of(quadratic, x).sum(), x)
        x = (x - 0.01 * gradient).detach().requires_grad_(True)
    got = solve(quadratic, torch.zeros(3, 3), "gradient", iterations=7)
    torch.testing.assert_close(got.value, x.detach())


def test_adam_is_torchs_adam() -> None:
    x = torch.zeros(3, 3, requires_grad=True)
    optimiser = torch.optim.Adam([x], lr=0.05)
    for _ in range(12):
        optimiser.zero_grad()
        cost_of(quadratic, x).sum().backward()
        optimiser.step()
    got = solve(quadratic, torch.zeros(3, 3), "adam", iterations=12)
    torch.testing.assert_close(got.value, x.detach(), atol=1e-5, rtol=1e-4)


@pytest.mark.parametrize(
    "wrong", [{"name": "newton"}, {"iterations": -1}, {"step": 0.0}, {"prior": -1.0}, {"patience": 0}, {"steps": 3}]
)
def test_settings_are_checked(wrong: dict[str, object]) -> None:
    with pytest.raises(ValidationError):
        SolverSettings.model_validate(wrong)
    with pytest.raises(ValidationError):
        GuidanceSettings(scale=-0.1)


@pytest.mark.parametrize("name", ["lm", "gauss_newton"])
def test_second_order_needs_few_passes(name: str) -> None:
    start = torch.tensor([[-1.2, 1.0], [2.0, -3.0], [0.0, 0.0]])
    got = solve(rosenbrock, start, name, iterations=100, progress=1e-12)
    torch.testing.assert_close(got.value, torch.ones(3, 2), atol=1e-2, rtol=0)
    assert len(got.history) < 40


def test_few_equations_are_met_by_the_smallest_change() -> None:
    matrix, wanted = torch.randn(3, 8), torch.randn(3)
    start = torch.randn(2, 8)
    got = solve(lambda x: x @ matrix.T - wanted, start, "lm", iterations=30, progress=1e-12)
    nearest = start - (start @ matrix.T - wanted) @ torch.linalg.pinv(matrix).T
    torch.testing.assert_close(got.value, nearest, atol=1e-3, rtol=1e-3)


@pytest.mark.parametrize("name", ["lm", "gauss_newton", "lbfgs"])
def test_solvers_agree_on_what_the_prior_gives_up(name: str) -> None:
    matrix, wanted, start = torch.randn(4, 6), torch.randn(4), torch.randn(1, 6)
    got = solve(lambda x: x @ matrix.T - wanted, start, name, iterations=60, prior=0.5, progress=1e-12)
    system = matrix.T @ matrix + 0.5 * torch.eye(6)
    exact = torch.linalg.solve(system, wanted @ matrix + 0.5 * start[0])
    torch.testing.assert_close(got.value[0], exact, atol=2e-3, rtol=2e-3)


def many(x: Tensor) -> Tensor:
    """Ninety rows, all awake."""
    return x.repeat(1, 30) - 7.0


@pytest.mark.parametrize(
    ("residual", "columns", "price", "chosen"),
    [
        (rosenbrock, 2, LINEARISED, "lm"),
        (many, 3, LINEARISED, "gauss_newton"),
        (hinge, 2, LINEARISED, "lm"),
        (lambda x: (x.repeat(1, 30) - 2.0).clamp_min(0.0) * (torch.arange(90) < 60), 3, LINEARISED, "lbfgs"),
        (lambda x: many(x)[:, :48], 3, LINEARISED, "lm"),
        (lambda x: many(x)[:, :49], 3, LINEARISED, "gauss_newton"),
        (lambda x: many(x)[:, :50] * (torch.arange(50) < 24), 3, LINEARISED, "lm"),
        (lambda x: many(x)[:, :50] * (torch.arange(50) < 25), 3, LINEARISED, "lbfgs"),
        (rosenbrock, 2, AUTOGRAD, "lm"),
        (lambda x: many(x)[:, :48], 3, AUTOGRAD, "lbfgs"),
        (many, 3, AUTOGRAD, "lbfgs"),
        (rosenbrock, 2, Price(product=1.0, row=10.0), "gauss_newton"),
        (rosenbrock, 2, Price(product=20.0, row=10.0), "lbfgs"),
    ],
)
def test_the_solver_is_chosen_by_the_rows_at_their_price(
    residual: Rows, columns: int, price: Price, chosen: str
) -> None:
    start = torch.full((2, columns), 2.5)
    problem = Problem(judged(partial(cost_of, residual)), start, lambda x: Dense(residual, x), price)
    settings = SolverSettings(iterations=30)
    choice = choose(problem, settings)
    assert choice == Choice(chosen, 3 if chosen == "gauss_newton" else 30)  # type: ignore[arg-type]
    assert choose(problem, SolverSettings(name="adam", iterations=7)) == Choice("adam", 7)
    assert minimise(problem, settings.model_copy(update={"iterations": 3})).solver == chosen


def test_a_row_that_wakes_up_on_the_way_is_taken_in() -> None:
    def wall(x: Tensor) -> Tensor:
        """Reach x = 3 on the far side of y > x - 1, which is satisfied at the start."""
        return torch.stack([3.0 - x[:, 0], (x[:, 0] - 1.0 - x[:, 1]).clamp_min(0.0)], dim=1)

    got = solve(wall, torch.zeros(2, 2), "lm", iterations=60, progress=1e-12)
    assert got.cost.max() < 1e-4


def wall(x: Tensor) -> Tensor:
    """Reach x = 3 from before a stiff wall at x = 1."""
    return torch.stack([3.0 - x[:, 0], 30 * (x[:, 0] - 1.0).clamp_min(0.0)], dim=1)


def pillar(x: Tensor) -> Tensor:
    """Reach (3, 0) past a disc in the way, which one may not enter."""
    away = (x - torch.tensor([1.5, 0.3])).norm(dim=1, keepdim=True)
    return torch.cat([torch.tensor([3.0, 0.0]) - x, 30 * (1.0 - away).clamp_min(0.0)], dim=1)


DRAWN = torch.Generator().manual_seed(0)
PULL, WALLS = torch.randn(20, 8, generator=DRAWN), torch.randn(12, 8, generator=DRAWN)


def polyhedron(x: Tensor) -> Tensor:
    """More pulls than can be met, between twelve stiff walls."""
    return torch.cat([0.3 * x @ PULL.T - 1, 30 * (x @ WALLS.T - 0.2).clamp_min(0.0)], dim=1)


@pytest.mark.parametrize("name", ["lm", "gauss_newton"])
def test_walls_that_wake_are_met_in_a_few_steps(name: str) -> None:
    """With no memory of walls both take 10 steps for one wall, and 50 for twelve."""
    for residual, columns, steps in ((wall, 2, 3), (polyhedron, 8, 6)):
        got = solve(residual, torch.zeros(1, columns), name, iterations=100, progress=1e-9)
        exact = solve(residual, torch.zeros(1, columns), "lbfgs", iterations=400, progress=1e-9, patience=50)
        torch.testing.assert_close(got.cost, exact.cost, atol=1e-3, rtol=1e-4)
        reached = torch.cat(got.history) <= 1.001 * exact.cost
        assert int(reached.nonzero()[0]) <= steps


@pytest.mark.parametrize("name", ["lm", "gauss_newton"])
def test_a_wall_once_left_counts_on_its_wrong_side_only(name: str) -> None:
    """Its plane is remembered, but as one that only counts on its wrong side."""

    def behind(x: Tensor) -> Tensor:
        return torch.stack([3.0 - x[:, 0], 30 * (1.0 - x[:, 0]).clamp_min(0.0)], dim=1)

    got = solve(behind, torch.zeros(1, 2), name, iterations=8, progress=1e-9)
    assert float(got.cost) < 1e-4


@pytest.mark.parametrize("name", ["lm", "gauss_newton"])
@pytest.mark.parametrize("start", [5.0, 1.5, 0.5, -2.0])
def test_rows_that_sleep_between_two_sides_are_no_walls(name: str, start: float) -> None:
    """Goals with a slack (bones, speeds) wake with either sign."""

    def slack(x: Tensor) -> Tensor:
        return torch.cat([10 * (x - x.clamp(-1, 1)), 0.5 * (x + 3)], dim=1)

    got = solve(slack, torch.tensor([[start]]), name, iterations=60, patience=60)
    assert float(got.cost) == pytest.approx(0.9975, abs=1e-3)


def test_a_batch_of_gauss_newton_gives_each_wall_its_rounds() -> None:
    """A sample of bad condition takes all iterations it may; its neighbour's wall wakes all the same."""
    hard = torch.linalg.svd(torch.randn(40, 40, generator=DRAWN))
    stiff = hard[0] @ torch.diag(torch.logspace(0, -3, 40)) @ hard[2]

    def both(x: Tensor) -> Tensor:
        y = x[:1, :1]
        first = torch.cat([0.5 * (3 - y), 30 * (y - 1).clamp_min(0), torch.zeros(1, 38)], dim=1)
        return torch.cat([first, (x[1:] - 1) @ stiff.T])

    got = solve(both, torch.zeros(2, 40), "gauss_newton", iterations=5)
    assert float(got.cost[0]) < 1.01


def test_lbfgs_calls_met_what_needs_no_search() -> None:
    """Asleep goals have no gradient, and so no line search finds anything."""
    start = torch.tensor([[0.0, 0.0], [30.0, 30.0]])
    got = solve(lambda x: (x - 1).clamp_min(0), start, "lbfgs", lambda x: (x <= 1).all(1), iterations=3, enough=1)
    assert got.reasons == ["met", "abandoned"]


@pytest.mark.parametrize("name", ["lm", "gauss_newton"])
def test_walls_that_wake_at_other_times_leave_samples_alone(name: str) -> None:
    start = torch.tensor([[0.0, 0.0], [0.2, 0.9], [1.4, -2.0], [3.5, 0.5]])
    together = solve(pillar, start, name, iterations=40, progress=1e-9)
    assert together.cost.max() < 1e-3
    for sample in range(len(start)):
        alone = solve(pillar, start[sample : sample + 1], name, iterations=40, progress=1e-9)
        torch.testing.assert_close(together.cost[sample], alone.cost[0], atol=1e-3, rtol=0)


def test_many_walls_that_wake_are_left_to_lbfgs() -> None:
    """A Jacobian of each would cost more passes than all of L-BFGS."""
    formed = 0

    class Counted(Dense):
        def jacobian(self, rows: Tensor) -> Tensor:
            nonlocal formed
            formed = max(formed, int(rows.sum()))
            return super().jacobian(rows)

    def rows(x: Tensor) -> Tensor:
        walls = (x[:, None] - torch.linspace(1, 2, 300)[:, None]).clamp_min(0).flatten(1)
        return torch.cat([5.0 - x, walls], dim=1)

    def cost(x: Tensor) -> Tensor:
        return rows(x).square().sum(1)

    problem = Problem(judged(cost), torch.zeros(1, 1), lambda x: Counted(rows, x))
    got = minimise(problem, SolverSettings(name="lm", prior=0.0, progress=1e-9))
    best = cost(torch.linspace(0, 5, 5001)[:, None]).min()
    assert formed < 60 and float(got.cost) < 1.001 * float(best) and got.solver == "lbfgs"
    search = Search(problem, SolverSettings(name="lm", prior=0.0, progress=1e-9))
    left = levenberg_marquardt(search)  # says so, and leaves going on to what chose it
    assert left is not None and len(search.history) < 5 and search.solution("lm").reasons == ["budget"]
    few = minimise(problem, SolverSettings(name="lm", prior=0.0, iterations=2))
    assert len(few.history) <= 2 + 3  # the start is looked at twice


def test_a_line_search_that_found_nothing_is_not_repeated() -> None:
    """At a kink that no descent leads away from."""
    passes = 0

    def kink(x: Tensor) -> Tensor:
        nonlocal passes
        passes += 1
        return 1.0 + torch.where(x > 0, x, -3 * x).sum(1)

    problem = Problem(judged(kink), torch.zeros(1, 2))
    got = minimise(problem, SolverSettings(name="lbfgs", patience=10))
    assert got.reasons == ["no progress"] and passes <= 12


def test_reasons_name_what_ended_each_sample() -> None:
    def first(x: Tensor) -> Tensor:
        return torch.tensor([True, False])[: len(x)]

    got = solve(quadratic, torch.zeros(2, 3), "lm", first, iterations=2)
    assert got.reasons == ["met", "budget"]


@pytest.mark.parametrize("name", NAMES)
def test_a_search_ends_with_the_pass_that_meets_its_goals(name: str) -> None:
    told: list[bool] = []

    def done(x: Tensor) -> Tensor:
        near = (x - CENTRES[:1]).norm(dim=1) < 1.0
        told.append(bool(near))
        return near

    start = torch.tensor([[6.0, 5.0, -4.0]])
    got = solve(quadratic, start, name, done, **({} if name in STEPLESS else {"step": 0.1}), iterations=200)
    assert got.reasons == ["met"] and told[-1] and not any(told[:-1])
    told.clear()
    assert solve(quadratic, CENTRES[:1] + 0.1, name, done).reasons == ["met"] and len(told) == 1
    step = None if name in STEPLESS else 0.01
    got = solve(quadratic, CENTRES[:1] + 0.5, name, done, step=step, least=3, progress=1e-9)
    assert got.reasons == ["met"] and len(got.history) == 4  # with the start, and better than it


def test_a_solver_of_residuals_wants_residuals() -> None:
    with pytest.raises(TypeError, match="lm"):
        minimise(Problem(judged(lambda x: x.sum(1)), torch.zeros(1, 2)), SolverSettings(name="lm"))


@pytest.mark.parametrize("name", NAMES)
def test_once_enough_samples_are_met_the_others_are_abandoned(name: str) -> None:
    """The first sample begins where all is met but for a little, the others far away."""
    start = CENTRES + torch.tensor([[0.02], [40.0], [60.0]])

    def done(x: Tensor) -> Tensor:
        return cost_of(quadratic, x) < 1e-3

    step = {"adam": 0.02, "gradient": 0.02}.get(name)
    got = solve(quadratic, start, name, done, iterations=400, step=step, patience=400, enough=1)
    assert "met" in got.reasons and got.reasons[0] == "met"
    assert set(got.reasons) <= {"met", "abandoned"}
    if name in ("adam", "gradient"):
        assert got.reasons == ["met", "abandoned", "abandoned"]
    alone = solve(quadratic, start, name, done, iterations=400, step=step, patience=400)
    assert got.evaluations <= alone.evaluations and "abandoned" not in alone.reasons


def test_solutions_are_merged_without_changing_either() -> None:
    first = solve(quadratic, torch.zeros(3, 3), "lm", iterations=1)
    other = solve(quadratic, torch.ones(2, 3), "lm", iterations=2)
    value, reasons = first.value.clone(), list(first.reasons)
    got = first.merged(other, torch.tensor([2, 0]), torch.tensor([True, False]), "lifted")
    assert torch.equal(got.value[2], other.value[0]) and torch.equal(got.value[:2], value[:2])
    assert got.cost[2] == other.cost[0] and got.reasons == [*reasons[:2], "lifted"]
    assert got.evaluations == first.evaluations + other.evaluations
    assert torch.equal(first.value, value) and first.reasons == reasons
    settled = got.settled(torch.tensor([True, False, False]))
    assert settled.reasons == ["met", reasons[1], "lifted"] and got.reasons[0] == reasons[0]
    assert settled.settled(torch.zeros(3, dtype=torch.bool)).reasons[0] == "no progress"
