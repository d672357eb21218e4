"""Which solver a problem is given to, and that solver at work."""

from __future__ import annotations

from collections.abc import Callable
from typing import Literal

from scenectl.control.first_order import adam, gradient_ascent, lbfgs
from scenectl.control.least_squares import gauss_newton, levenberg_marquardt
from scenectl.control.problem import Problem, Search, Solution
from scenectl.control.settings import SolverSettings

Name = Literal["gradient", "adam", "lbfgs", "lm", "gauss_newton"]

FEW_ROWS = 48
"""Rows up to which a system of their own size, and a backward pass for each, is cheaper than products with J."""

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

    A row that is exactly zero there belongs to a goal that is one-sided (a wall, a height limit): it may wake up at any
    step, which second-order models of the rows do not foresee and L-BFGS takes in its stride. Of the others, few make
    a small dual system and many do not.
    """
    if problem.opening is None:
        return "lbfgs"
    rows = problem.opening.rows
    if not rows.shape[1] or bool((rows == 0).any()) or not bool(rows.isfinite().all()):
        return "lbfgs"
    return "lm" if rows.shape[1] <= FEW_ROWS else "gauss_newton"
