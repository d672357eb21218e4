"""Solvers that know residuals, not just their cost: Levenberg-Marquardt in dual form, and Gauss-Newton.

Both minimise, around a point x,

    |r + J d|^2 + prior |x + d - x0|^2 + damping |d|^2

where x0 is the generator's own value, so that what the goals leave free stays as it was made. With few rows the dual
form of the solution is cheap and exact: a system of as many unknowns as rows. With many, conjugate gradients need
only products with J. The damping is each sample's own, and so are acceptance and rejection.
"""

from __future__ import annotations

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from scenectl.control.problem import Linearisation, Search

_FIRST_DAMPING = 5e-2
"""Of the mean diagonal of J J^T (or of the rows' mean square, where J is not formed)."""
_LEAST_DAMPING = 1e-8
_GOOD = 0.1
"""A Jacobian serves once more where the cost has fallen to this share of what it was, or lower."""
_CG_ITERATIONS, _CG_TOLERANCE = 20, 0.05


class _Damping:
    """Each sample's damping, by how well its model foretold the cost (Nielsen's rule)."""

    def __init__(self, first: Float[Tensor, " S"]) -> None:
        self.value, self._growth = first.clamp_min(_LEAST_DAMPING), torch.full_like(first, 2.0)

    def update(self, gain: Float[Tensor, " S"], better: Bool[Tensor, " S"], tried: Bool[Tensor, " S"]) -> None:
        """Less where steps were as good as foretold, more and more where they were no use."""
        eased = self.value * (1 - (2 * gain.clamp(0, 1) - 1) ** 3).clamp_min(1 / 5)
        raised = self.value * self._growth
        growth = torch.where(better, torch.full_like(self._growth, 2.0), 2 * self._growth)
        self.value = torch.where(tried, torch.where(better, eased, raised), self.value).clamp_min(_LEAST_DAMPING)
        self._growth = torch.where(tried, growth, self._growth)


def levenberg_marquardt(search: Search) -> None:
    """Dual steps; a Jacobian is kept for as long as steps with it go well."""
    x = search.start
    value, at = search.linearise(x)
    search.accept(x, value, at.met)
    r, (rows, jacobian) = at.rows, _active(at)
    damping = _Damping(_FIRST_DAMPING * jacobian.square().sum(-1).mean(-1).nan_to_num(0.0))
    stale = torch.zeros_like(search.active)
    for _ in range(search.settings.iterations):
        if not search.active.any():
            return
        step = _dual_step(r[:, rows], jacobian, search, x, damping.value)
        trial = torch.where(search.active[:, None], x + step, x)
        trial_value, trial_at = search.linearise(trial)
        better = trial_value < value
        gain = (value - trial_value) / _foretold(r[:, rows], jacobian, search, x, step).clamp_min(1e-12)
        damping.update(gain, better, search.active & (better | ~stale))
        search.accept(trial, trial_value, trial_at.met)
        failed = search.active & stale & ~better  # the old Jacobian is to blame, and not the damping
        good = better & (trial_value <= _GOOD * value)
        r = torch.where(better[:, None], trial_at.rows, r)
        x, value = torch.where(better[:, None], trial, x), torch.where(better, trial_value, value)
        woken = (r != 0).any(0)
        renew = search.active & (failed | (better & ~good) | (better & bool((woken & ~rows).any())))
        if renew.any():
            at = trial_at if not failed.any() else search.linearise(x)[1]
            now, fresh = _active(at, woken | rows)
            jacobian = torch.where(renew[:, None, None], fresh, _widened(jacobian, rows, now))
            rows = now
        stale = ~renew & (stale | better)


def _dual_step(
    r: Float[Tensor, "S r"], jacobian: Float[Tensor, "S r n"], search: Search, x: Tensor, damping: Float[Tensor, " S"]
) -> Float[Tensor, "S n"]:
    """The minimiser, by the push-through identity: a system of as many unknowns as rows for every sample."""
    prior = search.settings.prior
    total = prior + damping
    home = (prior / total)[:, None] * (search.start - x)
    gram = jacobian @ jacobian.mT
    system = gram + total[:, None, None] * torch.eye(gram.shape[-1], dtype=gram.dtype)
    wanted = -(r + (jacobian @ home[..., None]).squeeze(-1))
    factor, _ = torch.linalg.cholesky_ex(system)
    dual = torch.cholesky_solve(wanted[..., None], factor)
    step = home + (jacobian.mT @ dual).squeeze(-1)
    return torch.nan_to_num(step, 0.0, 0.0, 0.0)


def _foretold(r: Tensor, jacobian: Tensor, search: Search, x: Tensor, step: Tensor) -> Float[Tensor, " S"]:
    """By how much the linear model says that the cost falls."""
    linear = (jacobian @ step[..., None]).squeeze(-1)
    away, prior = x - search.start, search.settings.prior
    goals = r.square().sum(1) - (r + linear).square().sum(1)
    return goals + prior * (away.square().sum(1) - (away + step).square().sum(1))


def _active(at: Linearisation, rows: Bool[Tensor, " R"] | None = None) -> tuple[Tensor, Float[Tensor, "S r n"]]:
    """Rows that say anything in some sample, and their Jacobian; the others are met, and their gradients zero."""
    rows = (at.rows != 0).any(0) if rows is None else rows
    return rows, at.jacobian(rows)


def _widened(jacobian: Float[Tensor, "S r n"], rows: Bool[Tensor, " R"], now: Bool[Tensor, " R"]) -> Tensor:
    """The Jacobian of some rows as one of more, which were of no account."""
    if torch.equal(rows, now):
        return jacobian
    wide = jacobian.new_zeros(len(jacobian), int(now.sum()), jacobian.shape[-1])
    wide[:, rows[now]] = jacobian
    return wide


def gauss_newton(search: Search) -> None:
    """Steps by conjugate gradients on the normal equations, truncated (Nocedal and Wright, algorithm 7.1)."""
    x = search.start
    value, at = search.linearise(x)
    search.accept(x, value, at.met)
    damping = _Damping(_FIRST_DAMPING * at.rows.square().mean(1))
    for _ in range(search.settings.iterations):
        if not search.active.any():
            return
        step, foretold = _conjugate_gradients(at, search, x, damping.value)
        trial = torch.where(search.active[:, None], x + step, x)
        trial_value, trial_at = search.linearise(trial)
        better = trial_value < value
        damping.update((value - trial_value) / foretold.clamp_min(1e-12), better, search.active)
        search.accept(trial, trial_value, trial_at.met)
        x, value = torch.where(better[:, None], trial, x), torch.where(better, trial_value, value)
        if better.any():
            at = trial_at if bool((better | ~search.active).all()) else search.linearise(x)[1]


def _conjugate_gradients(
    at: Linearisation, search: Search, x: Tensor, damping: Float[Tensor, " S"]
) -> tuple[Float[Tensor, "S n"], Float[Tensor, " S"]]:
    """A step, and by how much the linear model says that the cost falls."""
    prior = search.settings.prior
    total = (prior + damping)[:, None]
    downhill = prior * (search.start - x) - at.vjp(at.rows)
    rest = downhill
    step, direction = torch.zeros_like(rest), rest.clone()
    size = begun = rest.square().sum(1)
    for _ in range(_CG_ITERATIONS):
        if bool((size <= _CG_TOLERANCE**2 * begun).all()):
            break
        image = at.vjp(at.jvp(direction)) + total * direction
        search.solution.evaluations += 1
        curvature = (direction * image).sum(1)
        length = torch.where(curvature > 0, size / curvature.clamp_min(1e-30), torch.zeros_like(size))[:, None]
        step, rest = step + length * direction, rest - length * image
        now = rest.square().sum(1)
        direction = rest + (now / size.clamp_min(1e-30))[:, None] * direction
        size = now
    step = torch.nan_to_num(step, 0.0, 0.0, 0.0)
    # The model's curvature along the step is step . (downhill - rest), damping included, which is no part of the cost.
    curvature = (step * (downhill - rest)).sum(1) - damping * step.square().sum(1)
    return step, 2 * (step * downhill).sum(1) - curvature
