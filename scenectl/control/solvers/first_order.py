"""Solvers that follow the gradient: the paper's constant steps, Adam, and L-BFGS.

Samples never influence one another: every step length, line search and memory is the sample's own, so a
batch gives what a loop over its samples would.
"""

from __future__ import annotations

import torch
from torch import Tensor

from scenectl.control.solvers.problem import Point, Search


def gradient_ascent(search: Search) -> None:
    """Eq. 12 as algorithm 3 writes it: a constant step along the gradient."""
    step, at = search.settings.step or 0.01, search.evaluate(search.begin)
    for _ in range(search.iterations):
        search.reach(at)
        if not search.active.any():
            return
        at = search.evaluate(torch.where(search.active[:, None], at.x - step * at.gradient, at.x))
    search.reach(at)


def adam(search: Search) -> None:
    """Adam with a constant step; its scaling is per number, so samples stay independent."""
    step, at = search.settings.step or 0.05, search.evaluate(search.begin)
    first, second = torch.zeros_like(at.x), torch.zeros_like(at.x)
    for i in range(1, search.iterations + 1):
        search.reach(at)
        if not search.active.any():
            return
        first = 0.9 * first + 0.1 * at.gradient
        second = 0.999 * second + 0.001 * at.gradient.square()
        move = step * (first / (1 - 0.9**i)) / ((second / (1 - 0.999**i)).sqrt() + 1e-8)
        at = search.evaluate(torch.where(search.active[:, None], at.x - move, at.x))
    search.reach(at)


def lbfgs(search: Search) -> None:
    """L-BFGS with a strong-Wolfe search by bisection, batched (Nocedal and Wright, algorithms 7.4 and 3.5)."""
    limits, at = search.thresholds, search.evaluate(search.begin)
    search.reach(at)
    pairs: list[tuple[Tensor, Tensor, Tensor]] = []
    fresh = torch.ones_like(search.active)  # samples without memory: their first step is short
    for _ in range(search.iterations):
        if not search.active.any():
            return
        direction = -_two_loops(at.gradient, pairs)
        slope = (direction * at.gradient).sum(1)
        # Where memory gives no descent, start again from the gradient.
        direction = torch.where((slope >= 0)[:, None], -at.gradient, direction)
        short = (limits.first_move / at.gradient.norm(dim=1).clamp_min(1e-12)).clamp_max(1.0)
        length = torch.where(fresh, short, torch.ones_like(short)) * search.active
        moved = _line_search(search, at, direction, length)
        # A kink in the cost (a wall, a hinge) can spoil the memory: a sample whose search found nothing forgets it, and
        # is done if it had none, as it would only try the same again.
        still = (moved.x == at.x).all(1)
        search.retire(still & fresh, "no progress")
        fresh = still
        pairs = [(s, y, torch.where(fresh, torch.zeros_like(rho), rho)) for s, y, rho in pairs]
        s, y = moved.x - at.x, moved.gradient - at.gradient
        sy = (s * y).sum(1)
        keep = sy > 1e-10 * s.norm(dim=1) * y.norm(dim=1)
        pairs.append((s, y, torch.where(keep, 1.0 / sy.clamp_min(1e-30), torch.zeros_like(sy))))
        pairs, at = pairs[-limits.memory :], moved
        search.reach(at)


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


def _line_search(search: Search, at: Point, direction: Tensor, length: Tensor) -> Point:
    """Step lengths with enough decrease and a flatter slope, by bisection; samples that find none stay put."""
    slope, limits, best = (direction * at.gradient).sum(1), search.thresholds, at
    low, high = torch.zeros_like(length), torch.full_like(length, torch.inf)
    found = ~(length > 0)
    for _ in range(limits.trials):
        trial = search.evaluate(at.x + length[:, None] * direction)
        decreases = trial.value <= at.value + limits.decrease * length * slope
        trial_slope = (trial.gradient * direction).sum(1)
        flat = trial_slope.abs() <= limits.curvature * slope.abs()
        beyond = ~decreases | (trial_slope > 0)  # a minimum lies before the trial
        better = decreases & (trial.value <= best.value)
        best = best.moved(~found & better, trial)
        low, high = torch.where(~found & ~beyond, length, low), torch.where(~found & beyond, length, high)
        found = found | (decreases & flat) | (better & trial.met)
        if found.all():
            break
        wider = torch.where(high.isinf(), 2 * length, (low + high) / 2)
        length = torch.where(found, length, wider)
    return best
