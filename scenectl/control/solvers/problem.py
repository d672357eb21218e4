"""What solvers solve, and what they all share: counting passes, remembering the best points, knowing when to stop."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cached_property
from typing import Literal, Protocol, runtime_checkable

import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor

from scenectl.control.settings import SolverSettings

Cost = Callable[[Float[Tensor, "S n"]], Float[Tensor, " S"]]
"""Costs of a batch of points, differentiable, each depending on its own point alone."""

Reason = Literal["met", "no progress", "budget", "abandoned", "strained"]
"""Why a search ended: every term within its tolerance, nothing more to gain, all steps spent, enough other samples met,
or a body that could bear no more (`scenectl.control.refine.natural`)."""


@runtime_checkable
class Linearisation(Protocol):
    """Least-squares rows of a batch of points, and products with their Jacobian there.

    The gradient of a sample's sum of squares is the gradient of its goals' cost; its value need not be the cost
    (`objectives.Term.block`).
    """

    @property
    def rows(self) -> Float[Tensor, "S R"]: ...

    @property
    def cost(self) -> Float[Tensor, " S"]:
        """Of the goals, without the prior."""
        ...

    @property
    def met(self) -> Bool[Tensor, " S"]:
        """Which samples have every goal within its tolerance."""
        ...

    def jvp(self, tangent: Float[Tensor, "S n"]) -> Float[Tensor, "S R"]: ...

    def vjp(self, cotangent: Float[Tensor, "S R"]) -> Float[Tensor, "S n"]: ...

    def jacobian(self, rows: Bool[Tensor, " R"]) -> Float[Tensor, "S r n"]:
        """The Jacobian of some rows, one backward pass each."""
        ...


@dataclass(frozen=True)
class Problem:
    """Independent costs to be minimised from a start.

    Attributes:
        cost: goals and prior.
        start: where to begin, ``[S, n]``; the prior pulls towards it.
        done: says of a batch of points which are good enough to stop at; a `Linearisation` knows it of its own.
        linearise: the goals as least squares at a batch of points; without it only `cost` can be followed.
    """

    cost: Cost
    start: Float[Tensor, "S n"]
    done: Callable[[Tensor], Bool[Tensor, " S"]]
    linearise: Callable[[Float[Tensor, "S n"]], Linearisation] | None = None

    @cached_property
    def opening(self) -> Linearisation | None:
        """The goals as least squares at the start, which a choice of solver looks at and solvers begin with."""
        return None if self.linearise is None else self.linearise(self.start.detach())


@dataclass
class Solution:
    """Where a solver ended.

    Attributes:
        solver: which one it was.
        value: best points met, ``[S, n]``.
        cost: their costs, ``[S]``.
        reasons: why each sample's search ended.
        evaluations: passes (cost and gradient, or a linearisation) that were made.
        history: best costs after each step.
    """

    solver: str
    value: Float[Tensor, "S n"]
    cost: Float[Tensor, " S"]
    reasons: list[Reason]
    evaluations: int = 0
    history: list[Tensor] = field(default_factory=list)

    def replace(
        self, other: Solution, samples: Int[Tensor, " s"], better: Bool[Tensor, " s"], reason: Reason | None = None
    ) -> None:
        """Take over from a search of some `samples` those that are `better`; its passes count whichever they are."""
        taken = samples[better]
        self.value, self.cost = self.value.clone(), self.cost.clone()
        self.value[taken], self.cost[taken] = other.value[better], other.cost[better]
        for theirs, mine in enumerate(samples.tolist()):
            if better[theirs]:
                self.reasons[mine] = reason or other.reasons[theirs]
        self.evaluations += other.evaluations

    def settle(self, met: Bool[Tensor, " S"]) -> None:
        """Say of each sample what came of it in the end: what was met loosely may not be, and the other way round."""
        for sample, reached in enumerate(met.tolist()):
            if reached:
                self.reasons[sample] = "met"
            elif self.reasons[sample] == "met":
                self.reasons[sample] = "no progress"


_ASK_EVERY = 5
"""Steps after which a problem is asked whether all is met."""


class Search:
    """One solver at work on one problem.

    Attributes:
        active: samples that are still searched for.
        solution: the best so far.
    """

    def __init__(self, problem: Problem, settings: SolverSettings, name: str) -> None:
        """Begin to solve `problem`, under the name of a solver."""
        start = problem.start.detach()
        self.problem, self.settings, self.start = problem, settings, start
        worst = torch.full_like(start[:, 0], torch.inf)
        self.solution = Solution(name, start.clone(), worst, ["budget"] * len(start))
        self.idle = torch.zeros(len(start), dtype=torch.long)
        self.active = torch.ones(len(start), dtype=torch.bool)

    def evaluate(self, x: Float[Tensor, "S n"]) -> tuple[Float[Tensor, " S"], Float[Tensor, "S n"]]:
        """Cost and gradient; points that are not numbers count as infinitely bad."""
        x = x.detach().requires_grad_(True)
        with torch.enable_grad():
            value = self.problem.cost(x)
            (gradient,) = torch.autograd.grad(value.sum(), x)
        self.solution.evaluations += 1
        value = torch.where(value.isfinite(), value, torch.full_like(value, torch.inf)).detach()
        return value, torch.nan_to_num(gradient, 0.0, 0.0, 0.0)

    def linearise(self, x: Float[Tensor, "S n"]) -> tuple[Float[Tensor, " S"], Linearisation]:
        """Cost, prior included, and least-squares rows."""
        if self.problem.linearise is None or self.problem.opening is None:
            raise TypeError(f"solver '{self.solution.solver}' needs the goals as least squares")
        found = self.problem.opening if x is self.start else self.problem.linearise(x.detach())
        self.solution.evaluations += 1
        value = found.cost + self.settings.prior * (x - self.start).square().sum(1)
        return torch.where(value.isfinite(), value, torch.full_like(value, torch.inf)).detach(), found

    def accept(self, x: Tensor, value: Tensor, met: Bool[Tensor, " S"] | None = None) -> None:
        """Remember points that are better than any before, and retire samples that are done or stuck.

        Where it is not known which points are `met`, the problem is asked now and then, as that costs a decoding.
        """
        best = self.solution.cost
        worthwhile = value < best - self.settings.progress * best.abs().nan_to_num(posinf=0.0)
        better = value < best
        self.solution.value = torch.where(better[:, None], x.detach(), self.solution.value)
        self.solution.cost = torch.where(better, value, best)
        self.solution.history.append(self.solution.cost.clone())
        self.idle = torch.where(worthwhile | best.isinf(), torch.zeros_like(self.idle), self.idle + 1)
        self.retire(self.idle >= self.settings.patience, "no progress")
        if met is not None:
            self.retire(better & met, "met")
        elif len(self.solution.history) % _ASK_EVERY == 0:
            self.retire(self.problem.done(self.solution.value), "met")
        enough = self.settings.enough
        if enough is not None and self.solution.reasons.count("met") >= enough:
            self.retire(self.active.clone(), "abandoned")

    def retire(self, which: Bool[Tensor, " S"], reason: Reason) -> None:
        """Search no more for some samples."""
        for i in (which & self.active).nonzero()[:, 0].tolist():
            self.solution.reasons[i] = reason
        self.active &= ~which
