"""What solvers solve, and what they all share: counting passes, remembering the best points, knowing when to stop."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Literal, Protocol, runtime_checkable

import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor

from scenectl.control.settings import SolverSettings
from scenectl.control.thresholds import THRESHOLDS, Thresholds
from scenectl.generators.base import Price
from scenectl.generators.steps import LINEARISED

Cost = Callable[[Float[Tensor, "S n"]], Float[Tensor, " S"]]
"""Costs of a batch of points, differentiable, each depending on its own point alone."""

Judge = Callable[[Float[Tensor, "S n"]], tuple[Float[Tensor, " S"], Bool[Tensor, " S"]]]
"""Costs of a batch of points, as `Cost`, and which of these are good enough to stop at."""

Reason = Literal["met", "no progress", "budget", "abandoned", "lifted"]
"""Why a search ended: every term within its tolerance, no further decrease, all steps spent, enough other samples met,
or a body held to the ground that goals would lift off it (`scenectl.control.refine.body_costs`)."""


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
        """The Jacobian of some rows."""
        ...


def judged(cost: Cost, met: Callable[[Tensor], Bool[Tensor, " S"]] | None = None) -> Judge:
    """A judge of costs, and of what says which points are `met`; without it none is good enough."""

    def judge(x: Tensor) -> tuple[Tensor, Tensor]:
        return cost(x), torch.zeros_like(x[:, 0], dtype=torch.bool) if met is None else met(x.detach())

    return judge


@dataclass(frozen=True)
class Problem:
    """Independent costs to be minimised from a start.

    Attributes:
        judge: costs of the goals, to which solvers add the prior, and whether they are met.
        start: where to begin, ``[S, n]``; the prior pulls towards it.
        linearise: the goals as least squares at a batch of points; without it only costs can be followed.
        price: what products with the Jacobian cost, in passes (`Step.price`).
        unit: distance from the start that the prior counts as one (`Step.unit`).
    """

    judge: Judge
    start: Float[Tensor, "S n"]
    linearise: Callable[[Float[Tensor, "S n"]], Linearisation] | None = None
    price: Price = LINEARISED
    unit: float = 1.0

    @cached_property
    def opening(self) -> Linearisation | None:
        """The goals as least squares at the start, which a choice of solver looks at and solvers begin with."""
        return None if self.linearise is None else self.linearise(self.start.detach())


@dataclass(frozen=True)
class Solution:
    """Where a solver ended.

    Attributes:
        solver: which one it was.
        value: best points met, ``[S, n]``.
        cost: their costs, ``[S]``.
        reasons: why each sample's search ended.
        evaluations: passes (cost and gradient, or a linearisation) that were made.
        history: best costs after each step.
        moves: of joints, m, to be added to the motion of `value`; None where none are.
    """

    solver: str
    value: Float[Tensor, "S n"]
    cost: Float[Tensor, " S"]
    reasons: list[Reason]
    evaluations: int = 0
    history: tuple[Tensor, ...] = ()
    moves: Float[Tensor, "S T J 3"] | None = None

    def merged(
        self, other: Solution, samples: Int[Tensor, " s"], better: Bool[Tensor, " s"], reason: Reason | None = None
    ) -> Solution:
        """With those of some `samples` of another search that are `better`; its passes count in any case."""
        taken, value, cost, reasons = samples[better], self.value.clone(), self.cost.clone(), list(self.reasons)
        value[taken], cost[taken] = other.value[better], other.cost[better]
        for theirs, mine in enumerate(samples.tolist()):
            if better[theirs]:
                reasons[mine] = reason or other.reasons[theirs]
        evaluations = self.evaluations + other.evaluations
        return replace(self, value=value, cost=cost, reasons=reasons, evaluations=evaluations)

    def settled(self, met: Bool[Tensor, " S"]) -> Solution:
        """With the reasons that agree with which samples are met in the end, at the goals' own tolerances."""
        reasons: list[Reason] = []
        for reached, reason in zip(met.tolist(), self.reasons, strict=True):
            reasons.append("met" if reached else "no progress" if reason == "met" else reason)
        return replace(self, reasons=reasons)


@dataclass(frozen=True)
class Point:
    """Where the searches for a batch of samples are.

    Attributes:
        x: ``[S, n]``.
        value: cost there, prior included; infinite where it is no number.
        gradient: of the value, ``[S, n]``.
        met: which are good enough to stop at.
    """

    x: Float[Tensor, "S n"]
    value: Float[Tensor, " S"]
    gradient: Float[Tensor, "S n"]
    met: Bool[Tensor, " S"]

    def moved(self, which: Bool[Tensor, " S"], other: Point) -> Point:
        """With those of `which` at the other."""
        rows = which[:, None]
        return Point(
            torch.where(rows, other.x, self.x),
            torch.where(which, other.value, self.value),
            torch.where(rows, other.gradient, self.gradient),
            torch.where(which, other.met, self.met),
        )


class Search:
    """One solver at work on one problem.

    Attributes:
        start: the problem's, at which the prior is zero.
        begin: where the solver sets out: the start, or where another solver has left off.
        iterations: steps at most.
        prior: cost of a squared distance of one from the start.
        active: samples that are still searched for.
        met: samples whose best point is good enough to stop at.
        evaluations: passes so far.
    """

    def __init__(self, problem: Problem, settings: SolverSettings, thresholds: Thresholds = THRESHOLDS) -> None:
        """Begin to solve `problem`."""
        start = problem.start.detach()
        self.problem, self.settings, self.thresholds = problem, settings, thresholds
        self.start, self.begin, self.iterations = start, start, settings.iterations
        self.prior = settings.prior / problem.unit**2
        self.evaluations, self.history = 0, list[Tensor]()
        self.value, self.cost = start.clone(), torch.full_like(start[:, 0], torch.inf)
        self.reasons: list[Reason] = ["budget"] * len(start)
        self.idle = torch.zeros_like(start[:, 0], dtype=torch.long)
        self.active = torch.ones_like(start[:, 0], dtype=torch.bool)
        self.met = torch.zeros_like(self.active)

    def solution(self, solver: str) -> Solution:
        """The best so far, under the name of a solver."""
        return Solution(solver, self.value, self.cost, list(self.reasons), self.evaluations, tuple(self.history))

    def evaluate(self, x: Float[Tensor, "S n"]) -> Point:
        """Cost, prior included, gradient, and what is met; points that are not numbers count as infinitely bad."""
        x = x.detach().requires_grad_(True)
        with torch.enable_grad():
            value, met = self.problem.judge(x)
            value = value + self.prior * (x - self.start).square().sum(1) if self.prior else value
            (gradient,) = torch.autograd.grad(value.sum(), x)
        self.evaluations += 1
        value = torch.where(value.isfinite(), value, torch.full_like(value, torch.inf)).detach()
        return Point(x.detach(), value, torch.nan_to_num(gradient, 0.0, 0.0, 0.0), met)

    def linearise(self, x: Float[Tensor, "S n"]) -> tuple[Float[Tensor, " S"], Linearisation]:
        """Cost, prior included, and least-squares rows."""
        if self.problem.linearise is None or self.problem.opening is None:
            raise TypeError(f"solver '{self.settings.name}' needs the goals as least squares")
        found = self.problem.opening if x is self.start else self.problem.linearise(x.detach())
        self.evaluations += 1
        value = found.cost + self.prior * (x - self.start).square().sum(1)
        return torch.where(value.isfinite(), value, torch.full_like(value, torch.inf)).detach(), found

    def accept(self, x: Tensor, value: Tensor, met: Bool[Tensor, " S"]) -> None:
        """Remember points that are better than any before, and retire samples that are done or stuck."""
        best = self.cost
        worthwhile = value < best - self.settings.progress * best.abs().nan_to_num(posinf=0.0)
        better = value < best
        self.value = torch.where(better[:, None], x.detach(), self.value)
        self.cost = torch.where(better, value, best)
        self.history.append(self.cost.clone())
        self.idle = torch.where(worthwhile | best.isinf(), torch.zeros_like(self.idle), self.idle + 1)
        self.retire(self.idle >= self.settings.patience, "no progress")
        self.met = torch.where(better, met, self.met)
        if len(self.history) > self.settings.least:
            self.retire(self.met, "met")
        enough = self.settings.enough
        if enough is not None and self.reasons.count("met") >= enough:
            self.retire(self.active.clone(), "abandoned")

    def reach(self, at: Point) -> None:
        """`accept` a point."""
        self.accept(at.x, at.value, at.met)

    def retire(self, which: Bool[Tensor, " S"], reason: Reason) -> None:
        """Search no more for some samples."""
        for i in (which & self.active).nonzero()[:, 0].tolist():
            self.reasons[i] = reason
        self.active = self.active & ~which
