"""Which solver a problem is given to, and that solver at work."""

from __future__ import annotations

from collections.abc import Callable
from typing import Literal

from scenectl.control.settings import SolverSettings
from scenectl.control.solvers.first_order import adam, gradient_ascent, lbfgs
from scenectl.control.solvers.least_squares import gauss_newton, levenberg_marquardt
from scenectl.control.solvers.problem import Problem, Search, Solution

Name = Literal["gradient", "adam", "lbfgs", "lm", "gauss_newton"]

FEW_ROWS = 48
"""Rows up to which a system of their own size, and a backward pass for each, is cheaper than products with J."""

FEW_AWAKE = 24
"""The same where other rows sleep: they cost passes as they wake."""

_PASSES = 10
"""That a step of Gauss-Newton takes, about: where it is chosen, it makes so many times fewer steps than others."""

_SOLVERS: dict[str, Callable[[Search], None]] = {
    "gradient": gradient_ascent,
    "adam": adam,
    "lbfgs": lbfgs,
    "lm": levenberg_marquardt,
    "gauss_newton": gauss_newton,
}


def minimise(problem: Problem, settings: SolverSettings) -> Solution:
    """Minimise each sample's cost from the problem's start, by the solver of the settings or by the fitting one."""
    name = choose(problem) if settings.name == "auto" else settings.name
    if settings.name == "auto" and name == "gauss_newton":
        settings = settings.model_copy(update={"iterations": -(-settings.iterations // _PASSES)})
    search = Search(problem, settings, name)
    _SOLVERS[name](search)
    return search.solution


def choose(problem: Problem) -> Name:
    """The solver that fits the rows at the start.

    Few make a small dual system and many do not. A row that is exactly zero there belongs to a goal that is one-sided
    (a wall, a height limit) and may wake up at any step. Levenberg-Marquardt learns of a few such; where walls wake
    by the hundred, Gauss-Newton gets there in few steps but pays more passes for each than L-BFGS needs in all.
    """
    if problem.opening is None:
        return "lbfgs"
    rows = problem.opening.rows
    if not rows.shape[1] or not bool(rows.isfinite().all()):
        return "lbfgs"
    awake = (rows != 0).any(0)
    if awake.sum() <= (FEW_ROWS if awake.all() else FEW_AWAKE):
        return "lm"
    return "gauss_newton" if awake.all() else "lbfgs"
