"""Solvers that know residuals, not just their cost: Levenberg-Marquardt in dual form, and Gauss-Newton.

Both minimise, around a point x,

    |r + J d|^2 + prior |x + d - x0|^2 + damping |d|^2

where x0 is the generator's own value, so that what the goals leave free stays as it was made. With few rows the dual
form of the solution is cheap and exact: a system of as many unknowns as rows. With many, conjugate gradients need
only products with J. The damping is each sample's own, and so are acceptance and rejection.

Rows of hinges (walls, limits) count by max(0, r + J d). Where such a row sleeps, its gradient is zero and says nothing
of the wall behind it, so each keeps the plane that it had where it was last awake, on the way or at a trial that came
to nothing; the set of rows that count is found anew for every step (a semismooth Newton method, which for the dual is
the primal-dual active set method: Hintermüller, Ito and Kunisch 2002).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from scenectl.control.solvers.problem import Linearisation, Search


class _Damping:
    """Each sample's damping, by how well its model foretold the cost (Nielsen's rule)."""

    def __init__(self, first: Float[Tensor, " S"], least: float) -> None:
        self.value, self._growth, self._least = first.clamp_min(least), torch.full_like(first, 2.0), least

    def update(self, gain: Float[Tensor, " S"], better: Bool[Tensor, " S"], tried: Bool[Tensor, " S"]) -> None:
        """Less where steps were as good as foretold, more and more where they were no use."""
        eased = self.value * (1 - (2 * gain.clamp(0, 1) - 1) ** 3).clamp_min(1 / 5)
        raised = self.value * self._growth
        growth = torch.where(better, torch.full_like(self._growth, 2.0), 2 * self._growth)
        self.value = torch.where(tried, torch.where(better, eased, raised), self.value).clamp_min(self._least)
        self._growth = torch.where(tried, growth, self._growth)


class _Hinges:
    """Which rows hold on one side only: those seen at exactly zero, and never below."""

    def __init__(self, rows: Float[Tensor, "S R"]) -> None:
        self._slept, self._below = rows == 0, rows < 0

    def see(self, rows: Float[Tensor, "S R"]) -> None:
        """Take note of the rows at another point."""
        self._slept, self._below = self._slept | (rows == 0), self._below | (rows < 0)

    @property
    def one_sided(self) -> Bool[Tensor, "S R"]:
        return self._slept & ~self._below


def _has_cost(value: Float[Tensor, "S r"], one_sided: Bool[Tensor, "S r"]) -> Bool[Tensor, "S r"]:
    return ~one_sided | (value > 0)


def levenberg_marquardt(search: Search) -> Float[Tensor, "S n"] | None:
    """Dual steps; a Jacobian is kept for as long as steps with it go well.

    Returns the points from which to go on without a Jacobian, where walls wake by the dozen for any of the samples:
    each would cost a row wherever it is formed. None where the search is over.
    """
    x, limits, row = search.begin, search.thresholds, search.problem.price.row
    value, at = search.linearise(x)
    search.accept(x, value, at.met)
    rows, first = at.rows, (at.rows != 0).any(0)
    if int(first.sum()) > round(limits.rows_first / row):
        return x if search.active.any() else None
    model, hinges = _Rows.of(at), _Hinges(at.rows)
    scale = model.jacobian.square().sum(-1).mean(-1).nan_to_num(0.0)
    damping = _Damping(limits.damping * scale, limits.least_damping)
    stale = torch.zeros_like(search.active)
    for _ in range(search.iterations):
        if not search.active.any():
            return None
        step = _dual_step(model, search, x, damping.value)
        trial = torch.where(search.active[:, None], x + step, x)
        trial_value, trial_at = search.linearise(trial)
        hinges.see(trial_at.rows)
        better = trial_value < value
        woken = model.unforeseen(trial_at) & search.active
        failed = search.active & stale & ~better
        gain = (value - trial_value) / _foretold([model], [model.linear(step)], search, x, step)
        damping.update(gain, better, search.active & (better | ~stale))
        search.accept(trial, trial_value, trial_at.met)
        good = better & (trial_value <= limits.good * value)
        model = model.moved(step, trial_at.rows, better)
        x, value = torch.where(better[:, None], trial, x), torch.where(better, trial_value, value)
        rows = torch.where(better[:, None], trial_at.rows, rows)
        awake = (trial_at.rows != 0) & trial_at.rows.isfinite() & search.active[:, None]
        if int((awake.any(0) & ~first).sum()) > round(limits.rows_woken / row):
            return x if search.active.any() else None
        if bool((woken & ~better).any()):
            model = model.warned(trial_at, step, woken & ~better)
        renew = failed | (search.active & better & (~good | woken))
        if renew.any():  # where failed, the old Jacobian is to blame, and not the damping
            model = model.renewed(trial_at if not failed.any() else search.linearise(x)[1], renew)
        model = model.with_hinges(hinges, rows)
        stale = ~renew & (stale | better)
    return None


@dataclass(frozen=True)
class _Rows:
    """Rows as first-order functions around a point, each with the gradient from where it was last awake.

    Attributes:
        chosen: those that were awake anywhere; the others are met, and their gradients zero.
        value: of the chosen ones at the point, at most 0 where they sleep.
        jacobian: their gradients; zero where a sample knows none.
        one_sided: which of them are hinges.
    """

    chosen: Bool[Tensor, " R"]
    value: Float[Tensor, "S r"]
    jacobian: Float[Tensor, "S r n"]
    one_sided: Bool[Tensor, "S r"]

    @classmethod
    def of(cls, at: Linearisation) -> _Rows:
        """What is awake at a point."""
        chosen = (at.rows != 0).any(0)
        value = at.rows[:, chosen]
        return cls(chosen, value, at.jacobian(chosen), value == 0)

    def linear(self, step: Float[Tensor, "S n"]) -> Float[Tensor, "S r"]:
        """Values at a step from the point."""
        return self.value + (self.jacobian @ step[..., None]).squeeze(-1)

    def counts(self, value: Float[Tensor, "S r"]) -> Bool[Tensor, "S r"]:
        """Which rows have a cost at such values."""
        return _has_cost(value, self.one_sided)

    def unforeseen(self, at: Linearisation) -> Bool[Tensor, " S"]:
        """Samples with a row awake whose gradient is not known."""
        known = torch.zeros_like(at.rows, dtype=torch.bool)
        known[:, self.chosen] = (self.jacobian != 0).any(-1)
        return ((at.rows != 0) & ~known).any(1)

    def moved(self, step: Float[Tensor, "S n"], rows: Float[Tensor, "S R"], samples: Bool[Tensor, " S"]) -> _Rows:
        """The point moved by a step, in some samples, to where the rows are these."""
        now, guessed = rows[:, self.chosen], self.linear(step)
        wrong = samples[:, None] & (now == 0) & (guessed > 0)
        value = torch.where(now == 0, guessed.clamp_max(0), now)
        jacobian = torch.where(wrong[..., None], 0.0, self.jacobian)
        return replace(self, value=torch.where(samples[:, None], value, self.value), jacobian=jacobian)

    def warned(self, at: Linearisation, step: Float[Tensor, "S n"], samples: Bool[Tensor, " S"]) -> _Rows:
        """With planes of rows that sleep at the point, from where they are awake a step away, in some samples."""
        sleeps = torch.ones_like(at.rows, dtype=torch.bool)
        sleeps[:, self.chosen] = self.value <= 0
        return self._told(at, samples[:, None] & (at.rows > 0) & sleeps, step)

    def renewed(self, at: Linearisation, samples: Bool[Tensor, " S"]) -> _Rows:
        """With the gradients at the point itself for what is awake there, in some samples."""
        return self._told(at, samples[:, None] & (at.rows != 0))

    def with_hinges(self, hinges: _Hinges, rows: Float[Tensor, "S R"]) -> _Rows:
        """With what is known of hinges by now; what sleeps and is none of them has no plane to remember."""
        one_sided = hinges.one_sided[:, self.chosen]
        forget = ~one_sided & (rows[:, self.chosen] == 0)
        jacobian = torch.where(forget[..., None], 0.0, self.jacobian)
        return replace(self, value=torch.where(forget, 0.0, self.value), jacobian=jacobian, one_sided=one_sided)

    def _told(self, at: Linearisation, news: Bool[Tensor, "S R"], step: Float[Tensor, "S n"] | None = None) -> _Rows:
        """With the planes of some rows at a point, or at a step from it, where they aren't awake at this one."""
        fresh = news.any(0)
        wide, told = self._widened(fresh), at.jacobian(fresh)
        value, news = at.rows[:, fresh], news[:, fresh]
        if step is not None:
            value = value - (told @ step[..., None]).squeeze(-1)
            news = news & (value <= 0)
        into = fresh[wide.chosen]
        wide.value[:, into] = torch.where(news, value, wide.value[:, into])
        wide.jacobian[:, into] = torch.where(news[..., None], told, wide.jacobian[:, into])
        return wide

    def _widened(self, rows: Bool[Tensor, " R"]) -> _Rows:
        """A copy with room for more rows."""
        chosen = self.chosen | rows
        held, samples = self.chosen[chosen], len(self.value)
        value, one_sided = self.value.new_zeros(samples, len(held)), self.one_sided.new_ones(samples, len(held))
        jacobian = self.jacobian.new_zeros(*value.shape, self.jacobian.shape[-1])
        value[:, held], one_sided[:, held], jacobian[:, held] = self.value, self.one_sided, self.jacobian
        return _Rows(chosen, value, jacobian, one_sided)


def _dual_step(model: _Rows, search: Search, x: Tensor, damping: Float[Tensor, " S"]) -> Float[Tensor, "S n"]:
    """The minimiser, by the push-through identity: a system of as many unknowns as rows for every sample."""
    prior = search.prior
    total = prior + damping
    home = (prior / total)[:, None] * (search.start - x)
    gram = model.jacobian @ model.jacobian.mT
    wanted = -model.linear(home)
    step, counts = home, model.counts(model.value)
    for _ in range(search.thresholds.dual_rounds):
        # A row that doesn't count has a system of its own, with the answer 0.
        system = gram * counts[:, None] * counts[..., None] + torch.diag_embed(total[:, None].expand_as(wanted))
        factor, _ = torch.linalg.cholesky_ex(system)
        dual = torch.cholesky_solve((wanted * counts)[..., None], factor)
        step = torch.nan_to_num(home + (model.jacobian.mT @ dual).squeeze(-1), 0.0, 0.0, 0.0)
        before, counts = counts, model.counts(model.linear(step))
        if torch.equal(before, counts):
            break
    return step


def _foretold(
    planes: Sequence[_Rows | _Plane], linear: Sequence[Tensor], search: Search, x: Tensor, step: Tensor
) -> Float[Tensor, " S"]:
    """By how much the model says that the cost falls, with its rows as they are `linear` ly after the step."""
    away, prior = x - search.start, search.prior
    fall = prior * (away.square().sum(1) - (away + step).square().sum(1))
    for plane, value in zip(planes, linear, strict=True):
        before, after = (v * plane.counts(v) for v in (plane.value, value))
        fall = fall + before.square().sum(1) - after.square().sum(1)
    return fall.clamp_min(1e-12)


def gauss_newton(search: Search) -> None:
    """Steps by conjugate gradients on the normal equations, truncated (Nocedal and Wright, algorithm 7.1)."""
    x, limits = search.begin, search.thresholds
    value, at = search.linearise(x)
    search.accept(x, value, at.met)
    damping = _Damping(limits.damping * at.rows.square().mean(1), limits.least_damping)
    hinges = _Hinges(at.rows)
    behind: list[_Left] = []
    for _ in range(search.iterations):
        if not search.active.any():
            return
        planes = [left.seen_from(x, hinges) for left in behind]
        search.evaluations += len(planes)
        mine = torch.ones_like(at.rows, dtype=torch.bool)
        for plane in planes:
            mine = mine & ~plane.mine
        planes.append(_Plane(at, at.rows, mine, hinges.one_sided))
        step, linear = _conjugate_gradients(planes, search, x, damping.value)
        trial = torch.where(search.active[:, None], x + step, x)
        trial_value, trial_at = search.linearise(trial)
        hinges.see(trial_at.rows)
        better = trial_value < value
        foretold = _foretold(planes, linear, search, x, step)
        warned = (trial_at.rows > 0) & (at.rows == 0) & ~better[:, None]
        damping.update((value - trial_value) / foretold, better, search.active)
        search.accept(trial, trial_value, trial_at.met)
        before, before_x = at, x
        x, value = torch.where(better[:, None], trial, x), torch.where(better, trial_value, value)
        if better.any():
            at = trial_at if bool((better | ~search.active).all()) else search.linearise(x)[1]
        left = (before.rows > 0) & (at.rows == 0) & better[:, None]
        behind = _kept(behind, [_Left(before, before_x, left), _Left(trial_at, trial, warned)], at, search.active)


@dataclass(frozen=True)
class _Plane:
    """Rows as first-order functions around a point, by products with a Jacobian.

    Attributes:
        at: whose Jacobian it is.
        value: of the rows at the point.
        mine: those for which this Jacobian is the one that counts.
        one_sided: which are hinges.
    """

    at: Linearisation
    value: Float[Tensor, "S R"]
    mine: Bool[Tensor, "S R"]
    one_sided: Bool[Tensor, "S R"]

    def counts(self, value: Float[Tensor, "S R"]) -> Bool[Tensor, "S R"]:
        """Which rows have a cost at such values."""
        return self.mine & _has_cost(value, self.one_sided)


@dataclass(frozen=True)
class _Left:
    """A point where rows were awake that sleep now.

    Attributes:
        at: the goals there.
        x: the point.
        rows: those whose last awake point this is.
    """

    at: Linearisation
    x: Float[Tensor, "S n"]
    rows: Bool[Tensor, "S R"]

    def seen_from(self, x: Float[Tensor, "S n"], hinges: _Hinges) -> _Plane:
        """Its planes around another point, at which the rows sleep."""
        guessed = self.at.rows + self.at.jvp(x - self.x)
        return _Plane(self.at, guessed.clamp_max(0), self.rows & hinges.one_sided, hinges.one_sided)


def _kept(behind: Sequence[_Left], new: Sequence[_Left], at: Linearisation, active: Bool[Tensor, " S"]) -> list[_Left]:
    """Each active sample's latest point that has a say; none about rows that are awake at the point itself."""
    kept: list[_Left] = []
    spoken_for = (at.rows != 0) | ~active[:, None]
    for left in [*reversed(new), *reversed(behind)]:
        rows = left.rows & ~spoken_for
        if rows.any():
            kept.append(replace(left, rows=rows))
            spoken_for = spoken_for | rows.any(1)[:, None]
    return kept[::-1]


def _conjugate_gradients(
    planes: Sequence[_Plane], search: Search, x: Tensor, damping: Float[Tensor, " S"]
) -> tuple[Float[Tensor, "S n"], list[Float[Tensor, "S R"]]]:
    """A step, and each plane's rows after it."""
    step, linear = torch.zeros_like(x), [plane.value for plane in planes]
    counts = [plane.counts(value) for plane, value in zip(planes, linear, strict=True)]
    for _ in range(search.thresholds.cg_rounds):
        step = _truncated(planes, counts, search, x, step, damping)
        if not step.any():
            break
        search.evaluations += len(planes)
        linear = [plane.value + plane.at.jvp(step) for plane in planes]
        before, counts = counts, [plane.counts(value) for plane, value in zip(planes, linear, strict=True)]
        if all(torch.equal(a, b) for a, b in zip(before, counts, strict=True)):
            break
    return step, linear


def _truncated(
    planes: Sequence[_Plane],
    counts: Sequence[Bool[Tensor, "S R"]],
    search: Search,
    x: Tensor,
    step: Float[Tensor, "S n"],
    damping: Float[Tensor, " S"],
) -> Float[Tensor, "S n"]:
    """Conjugate gradients from a step, for the rows that count."""
    prior, limits = search.prior, search.thresholds
    total = (prior + damping)[:, None]

    def image(d: Tensor) -> Tensor:
        search.evaluations += len(planes)
        out = total * d
        for plane, mine in zip(planes, counts, strict=True):
            out = out + plane.at.vjp(plane.at.jvp(d) * mine)
        return out

    downhill = prior * (search.start - x)
    for plane, mine in zip(planes, counts, strict=True):
        downhill = downhill - plane.at.vjp(plane.value * mine)
    rest = downhill - image(step) if step.any() else downhill
    direction, size, begun = rest.clone(), rest.square().sum(1), downhill.square().sum(1)
    for _ in range(limits.cg_steps):
        if not bool(((size > limits.cg_tolerance**2 * begun) & search.active).any()):
            break
        curved = image(direction)
        curvature = (direction * curved).sum(1)
        length = torch.where(curvature > 0, size / curvature.clamp_min(1e-30), torch.zeros_like(size))[:, None]
        step, rest = step + length * direction, rest - length * curved
        now = rest.square().sum(1)
        direction = rest + (now / size.clamp_min(1e-30))[:, None] * direction
        size = now
    return torch.nan_to_num(step, 0.0, 0.0, 0.0)
