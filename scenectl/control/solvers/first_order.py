"""Solvers that follow the gradient: the paper's constant steps, Adam, and L-BFGS.

Samples never influence one another: every step length, line search and memory is the sample's own, so a
batch gives what a loop over its samples would.
"""

from __future__ import annotations

import torch
from torch import Tensor

from scenectl.control.solvers.problem import Search


def gradient_ascent(search: Search) -> None:
    """Eq. 12 as algorithm 3 writes it: a constant step along the gradient."""
    x, step = search.begin, search.settings.step or 0.01
    for _ in range(search.iterations):
        value, gradient = search.evaluate(x)
        search.accept(x, value)
        if not search.active.any():
            return
        x = torch.where(search.active[:, None], x - step * gradient, x)
    search.accept(x, search.evaluate(x)[0])


def adam(search: Search) -> None:
    """Adam with a constant step; its scaling is per number, so samples stay independent."""
    x, step = search.begin.clone(), search.settings.step or 0.05
    first, second = torch.zeros_like(x), torch.zeros_like(x)
    for i in range(1, search.iterations + 1):
        value, gradient = search.evaluate(x)
        search.accept(x, value)
        if not search.active.any():
            return
        first = 0.9 * first + 0.1 * gradient
        second = 0.999 * second + 0.001 * gradient.square()
        move = step * (first / (1 - 0.9**i)) / ((second / (1 - 0.999**i)).sqrt() + 1e-8)
        x = torch.where(search.active[:, None], x - move, x)
    search.accept(x, search.evaluate(x)[0])


def lbfgs(search: Search) -> None:
    """L-BFGS with a strong-Wolfe search by bisection, batched (Nocedal and Wright, algorithms 7.4 and 3.5)."""
    x, limits = search.begin.clone(), search.thresholds
    value, gradient = search.evaluate(x)
    search.accept(x, value)
    pairs: list[tuple[Tensor, Tensor, Tensor]] = []
    fresh = torch.ones_like(search.active)  # samples without memory: their first step is short
    for _ in range(search.iterations):
        direction = -_two_loops(gradient, pairs)
        slope = (direction * gradient).sum(1)
        # Where memory gives no descent, start again from the gradient.
        direction = torch.where((slope >= 0)[:, None], -gradient, direction)
        short = (limits.first_move / gradient.norm(dim=1).clamp_min(1e-12)).clamp_max(1.0)
        length = torch.where(fresh, short, torch.ones_like(short)) * search.active
        moved, new_value, new_gradient = _line_search(search, x, value, gradient, direction, length)
        # A kink in the cost (a wall, a hinge) can spoil the memory: a sample whose search found nothing forgets it, and
        # is done if it had none, as it would only try the same again.
        still = (moved == x).all(1)
        if (stuck := still & fresh & search.active).any():
            search.retire(stuck & search.problem.done(x), "met")
            search.retire(stuck, "no progress")
        fresh = still
        pairs = [(s, y, torch.where(fresh, torch.zeros_like(rho), rho)) for s, y, rho in pairs]
        s, y = moved - x, new_gradient - gradient
        sy = (s * y).sum(1)
        keep = sy > 1e-10 * s.norm(dim=1) * y.norm(dim=1)
        pairs.append((s, y, torch.where(keep, 1.0 / sy.clamp_min(1e-30), torch.zeros_like(sy))))
        pairs = pairs[-limits.memory :]
        x, value, gradient = moved, new_value, new_gradient
        search.accept(x, value)
        if not search.active.any():
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


def _line_search(
    search: Search, x: Tensor, value: Tensor, gradient: Tensor, direction: Tensor, length: Tensor
) -> tuple[Tensor, Tensor, Tensor]:
    """Step lengths with enough decrease and a flatter slope, by bisection; samples that find none stay put."""
    slope, limits = (direction * gradient).sum(1), search.thresholds
    low, high = torch.zeros_like(length), torch.full_like(length, torch.inf)
    found = ~(length > 0)
    best_x, best_value, gradient_at = x, value, gradient
    for _ in range(limits.trials):
        trial = x + length[:, None] * direction
        trial_value, trial_gradient = search.evaluate(trial)
        decreases = trial_value <= value + limits.decrease * length * slope
        trial_slope = (trial_gradient * direction).sum(1)
        flat = trial_slope.abs() <= limits.curvature * slope.abs()
        beyond = ~decreases | (trial_slope > 0)  # a minimum lies before the trial
        take = ~found & decreases & (trial_value <= best_value)
        best_x = torch.where(take[:, None], trial, best_x)
        best_value = torch.where(take, trial_value, best_value)
        gradient_at = torch.where(take[:, None], trial_gradient, gradient_at)
        low, high = torch.where(~found & ~beyond, length, low), torch.where(~found & beyond, length, high)
        found = found | (decreases & flat)
        if found.all():
            break
        wider = torch.where(high.isinf(), 2 * length, (low + high) / 2)
        length = torch.where(found, length, wider)
    return best_x, best_value, gradient_at
