"""Which solver a problem is given to, by what products with its Jacobian cost, and that solver at work."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from math import ceil
from typing import Literal

from jaxtyping import Float
from torch import Tensor

from scenectl.control.settings import SolverSettings
from scenectl.control.solvers.first_order import adam, gradient_ascent, lbfgs
from scenectl.control.solvers.least_squares import gauss_newton, levenberg_marquardt
from scenectl.control.solvers.problem import Problem, Search, Solution
from scenectl.control.thresholds import THRESHOLDS, Thresholds

Name = Literal["gradient", "adam", "lbfgs", "lm", "gauss_newton"]

Solver = Callable[[Search], Float[Tensor, "S n"] | None]
"""Searches, and returns the points from which L-BFGS is to go on, or None where the search is over."""

_SOLVERS: dict[Name, Solver] = {
    "gradient": gradient_ascent,
    "adam": adam,
    "lbfgs": lbfgs,
    "lm": levenberg_marquardt,
    "gauss_newton": gauss_newton,
}


@dataclass(frozen=True)
class Choice:
    """A solver, and how many steps it is given."""

    name: Name
    iterations: int


def minimise(problem: Problem, settings: SolverSettings, thresholds: Thresholds = THRESHOLDS) -> Solution:
    """Minimise each sample's cost from the problem's start, by the solver of the settings or by the fitting one."""
    choice = choose(problem, settings, thresholds)
    search, name = Search(problem, settings.model_copy(update={"name": choice.name}), thresholds), choice.name
    search.iterations = choice.iterations
    left = _SOLVERS[name](search)
    if left is not None:
        name, search.begin, search.iterations = "lbfgs", left, search.iterations - max(len(search.history) - 1, 0)
        lbfgs(search)
    return search.solution(name)


def choose(problem: Problem, settings: SolverSettings, thresholds: Thresholds = THRESHOLDS) -> Choice:
    """The solver of the settings, or else the one that fits the rows at the start at the problem's prices.

    Few rows make a small dual system and many do not. A row that is exactly zero belongs to a goal that is one-sided
    (a wall, a height limit) and may wake up at any step. Levenberg-Marquardt learns of a few such; where walls wake
    by the hundred, Gauss-Newton gets there in few steps but pays more passes for each than L-BFGS needs in all.
    A step of Gauss-Newton takes about as many products as ten steps of the others take passes: it gets fewer steps.
    """
    if settings.name != "auto":
        return Choice(settings.name, settings.iterations)
    if problem.opening is None:
        return Choice("lbfgs", settings.iterations)
    rows = problem.opening.rows
    if not rows.shape[1] or not bool(rows.isfinite().all()):
        return Choice("lbfgs", settings.iterations)
    awake = (rows != 0).any(0)
    budget = thresholds.rows if awake.all() else thresholds.rows_sleeping
    if int(awake.sum()) <= round(budget / problem.price.row):
        return Choice("lm", settings.iterations)
    if bool(awake.all()) and problem.price.product <= thresholds.product:
        return Choice("gauss_newton", ceil(thresholds.newton_share * settings.iterations - 1e-9))
    return Choice("lbfgs", settings.iterations)
