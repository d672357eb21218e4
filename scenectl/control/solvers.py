"""Minimisers of a batch of independent costs: the paper's gradient steps, Adam, and L-BFGS.

Samples never influence one another: every step length, line search and memory is the sample's own, so a
batch gives what a loop over its samples would.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from scenectl.control.settings import SolverSettings

Cost = Callable[[Float[Tensor, "S n"]], Float[Tensor, " S"]]
"""Costs of a batch of points, differentiable, each depending on its own point alone."""


@dataclass
class Solution:
    """Where a solver ended.

    Attributes:
        value: best points met, ``[S, n]``.
        cost: their costs, ``[S]``.
        evaluations: passes (cost and gradient) that were made.
        history: best costs after each step.
    """

    value: Float[Tensor, "S n"]
    cost: Float[Tensor, " S"]
    evaluations: int = 0
    history: list[Tensor] = field(default_factory=list)


def minimise(
    cost: Cost, start: Float[Tensor, "S n"], settings: SolverSettings, done: Callable[[Tensor], Bool[Tensor, " S"]]
) -> Solution:
    """Minimise each sample's cost from `start`.

    Args:
        cost: the costs.
        start: where to begin.
        settings: which solver, how many steps.
        done: says of a batch of points which ones are good enough to stop at; asked now and then.
    """
    problem = _Problem(cost, done, settings, start.detach())
    {"lbfgs": _lbfgs, "adam": _adam, "gradient": _gradient}[settings.name](problem)
    return problem.solution


class _Problem:
    """Counts passes, remembers the best points and decides when to stop."""

    def __init__(self, cost: Cost, done: Callable[[Tensor], Tensor], settings: SolverSettings, start: Tensor) -> None:
        self.cost, self.done, self.settings, self.start = cost, done, settings, start
        self.solution = Solution(start.clone(), torch.full_like(start[:, 0], torch.inf))
        self.idle = torch.zeros(len(start), dtype=torch.long)
        self.active = torch.ones(len(start), dtype=torch.bool)

    def evaluate(self, x: Float[Tensor, "S n"]) -> tuple[Float[Tensor, " S"], Float[Tensor, "S n"]]:
        """Cost and gradient; points that are not numbers count as infinitely bad."""
        x = x.detach().requires_grad_(True)
        with torch.enable_grad():
            value = self.cost(x)
            (gradient,) = torch.autograd.grad(value.sum(), x)
        self.solution.evaluations += 1
        value = torch.where(value.isfinite(), value, torch.full_like(value, torch.inf)).detach()
        return value, torch.nan_to_num(gradient, 0.0, 0.0, 0.0)

    def accept(self, x: Tensor, value: Tensor) -> None:
        """Remember points that are better than any before, and retire samples that are done or stuck."""
        best = self.solution.cost
        worthwhile = value < best - self.settings.progress * best.abs().nan_to_num(posinf=0.0)
        better = value < best
        self.solution.value = torch.where(better[:, None], x.detach(), self.solution.value)
        self.solution.cost = torch.where(better, value, best)
        self.solution.history.append(self.solution.cost.clone())
        self.idle = torch.where(worthwhile | best.isinf(), torch.zeros_like(self.idle), self.idle + 1)
        self.active &= self.idle < self.settings.patience
        if len(self.solution.history) % 5 == 0:
            self.active &= ~self.done(self.solution.value)


def _gradient(problem: _Problem) -> None:
    """Eq. 12 as algorithm 3 writes it: a constant step along the gradient."""
    x, step = problem.start, problem.settings.step or 0.01
    for _ in range(problem.settings.iterations):
        value, gradient = problem.evaluate(x)
        problem.accept(x, value)
        if not problem.active.any():
            return
        x = torch.where(problem.active[:, None], x - step * gradient, x)
    problem.accept(x, problem.evaluate(x)[0])


def _adam(problem: _Problem) -> None:
    """Adam with a constant step; its scaling is per number, so samples stay independent."""
    x, step = problem.start.clone(), problem.settings.step or 0.05
    first, second = torch.zeros_like(x), torch.zeros_like(x)
    for i in range(1, problem.settings.iterations + 1):
        value, gradient = problem.evaluate(x)
        problem.accept(x, value)
        if not problem.active.any():
            return
        first = 0.9 * first + 0.1 * gradient
        second = 0.999 * second + 0.001 * gradient.square()
        move = step * (first / (1 - 0.9**i)) / ((second / (1 - 0.999**i)).sqrt() + 1e-8)
        x = torch.where(problem.active[:, None], x - move, x)
    problem.accept(x, problem.evaluate(x)[0])


_MEMORY = 12
_WOLFE_DECREASE, _WOLFE_CURVATURE = 1e-4, 0.9
_MAX_SEARCH = 10


def _lbfgs(problem: _Problem) -> None:
    """L-BFGS with a weak-Wolfe bisection search, batched (Nocedal and Wright, algorithms 7.4 and 3.5)."""
    x = problem.start.clone()
    value, gradient = problem.evaluate(x)
    problem.accept(x, value)
    pairs: list[tuple[Tensor, Tensor, Tensor]] = []
    fresh = torch.ones_like(problem.active)  # samples without memory: their first step is short
    for _ in range(problem.settings.iterations):
        direction = -_two_loops(gradient, pairs)
        slope = (direction * gradient).sum(1)
        # Where memory gives no descent, start again from the gradient.
        direction = torch.where((slope >= 0)[:, None], -gradient, direction)
        short = (0.1 / gradient.norm(dim=1).clamp_min(1e-12)).clamp_max(1.0)
        length = torch.where(fresh, short, torch.ones_like(short)) * problem.active
        moved, new_value, new_gradient = _search(problem, x, value, gradient, direction, length)
        # A kink in the cost (a wall, a hinge) can spoil the memory: a sample whose search found nothing forgets it.
        fresh = (moved == x).all(1)
        pairs = [(s, y, torch.where(fresh, torch.zeros_like(rho), rho)) for s, y, rho in pairs]
        s, y = moved - x, new_gradient - gradient
        sy = (s * y).sum(1)
        keep = sy > 1e-10 * s.norm(dim=1) * y.norm(dim=1)
        pairs.append((s, y, torch.where(keep, 1.0 / sy.clamp_min(1e-30), torch.zeros_like(sy))))
        pairs = pairs[-_MEMORY:]
        x, value, gradient = moved, new_value, new_gradient
        problem.accept(x, value)
        if not problem.active.any():
            return


def _two_loops(gradient: Tensor, pairs: list[tuple[Tensor, Tensor, Tensor]]) -> Tensor:
    """Product of the inverse Hessian estimate with the gradient; a pair with rho = 0 counts for nothing."""
    q, alphas = gradient.clone(), []
    for s, y, rho in reversed(pairs):
        alpha = rho * (s * q).sum(1)
        q = q - alpha[:, None] * y
        alphas.append(alpha)
    scale = torch.ones_like(q[:, 0])
    for s, y, rho in pairs:  # the latest valid pair wins
        scale = torch.where(rho > 0, (s * y).sum(1) / y.square().sum(1).clamp_min(1e-30), scale)
    q = q * scale[:, None]
    for (s, y, rho), alpha in zip(pairs, reversed(alphas), strict=True):
        beta = rho * (y * q).sum(1)
        q = q + (alpha - beta)[:, None] * s
    return q


def _search(
    problem: _Problem, x: Tensor, value: Tensor, gradient: Tensor, direction: Tensor, length: Tensor
) -> tuple[Tensor, Tensor, Tensor]:
    """Step lengths with enough decrease and a flatter slope, by bisection; samples that find none stay put."""
    slope = (direction * gradient).sum(1)
    low, high = torch.zeros_like(length), torch.full_like(length, torch.inf)
    found = ~(length > 0)
    best_x, best_value, gradient_at = x, value, gradient
    for _ in range(_MAX_SEARCH):
        trial = x + length[:, None] * direction
        trial_value, trial_gradient = problem.evaluate(trial)
        decreases = trial_value <= value + _WOLFE_DECREASE * length * slope
        flat = (trial_gradient * direction).sum(1) >= _WOLFE_CURVATURE * slope
        take = ~found & decreases
        best_x = torch.where(take[:, None], trial, best_x)
        best_value = torch.where(take, trial_value, best_value)
        gradient_at = torch.where(take[:, None], trial_gradient, gradient_at)
        low, high = torch.where(take, length, low), torch.where(~found & ~decreases, length, high)
        found = found | (decreases & flat)
        if found.all():
            break
        wider = torch.where(high.isinf(), 2 * length, (low + high) / 2)
        length = torch.where(found, length, wider)
    return best_x, best_value, gradient_at
