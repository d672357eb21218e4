"""Objectives as a guide: goals, scene and solver on one side, a generator's steps on the other."""

from __future__ import annotations

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from objectives import Context, Objective
from scenectl.control.problem import Problem, Solution
from scenectl.control.residuals import Residuals
from scenectl.control.settings import GuidanceSettings, SolverSettings
from scenectl.control.solvers import minimise
from scenectl.generators.base import Progress, Step


class ObjectiveGuide:
    """Steers any generator towards an objective in a context.

    Attributes:
        solution: what the last refinement did, or None.
    """

    def __init__(
        self,
        objective: Objective,
        context: Context,
        solver: SolverSettings | None = None,
        guidance: GuidanceSettings | None = None,
        progress: Progress | None = None,
    ) -> None:
        self.objective, self.context = objective, context
        self.solver, self.guidance = solver or SolverSettings(), guidance or GuidanceSettings()
        self.progress = progress
        self.solution: Solution | None = None

    def log_prob(self, step: Step) -> Float[Tensor, " S"]:
        """Minus the objective's cost (Eq. 40), times the guidance scale."""
        return -self.guidance.scale * self.objective.cost(step.decode(step.value), self.context)

    def gradient(self, step: Step) -> Float[Tensor, "S *v"]:
        """Gradient of `log_prob` in the step's value; samples are independent, so one backward pass serves all."""
        value = step.value.detach().requires_grad_(True)
        with torch.enable_grad():
            cost = self.objective.cost(step.decode(value), self.context)
            (gradient,) = torch.autograd.grad(cost.sum(), value)
        # One frame that is not a number must not silence the whole tilt.
        return -self.guidance.scale * torch.nan_to_num(gradient, 0.0, 0.0, 0.0)

    def refine(self, step: Step) -> Float[Tensor, "S *v"]:
        """Minimise the objective's cost from the step's value (Eq. 12)."""
        if self.solver.iterations == 0:
            return step.value.detach()
        shape, start = step.value.shape, step.value.detach().flatten(1)
        passes = 0

        def value(x: Tensor) -> Tensor:
            return x.unflatten(1, shape[1:])

        def tell() -> None:
            nonlocal passes
            passes += 1
            if self.progress is not None:
                self.progress("refinement", min(passes / (1.25 * self.solver.iterations), 1.0))

        def cost(x: Tensor) -> Tensor:
            tell()
            goals = self.objective.cost(step.decode(value(x)), self.context)
            return goals + self.solver.prior * (x - start).square().sum(1)

        def linearise(x: Tensor) -> Residuals:
            tell()
            return Residuals(self.objective, self.context, step.at(value(x)))

        problem = Problem(cost, start, lambda x: self.met(step, value(x)), linearise)
        self.solution = minimise(problem, self.solver)
        return value(self.solution.value)

    @torch.no_grad()
    def met(self, step: Step, value: Float[Tensor, "S *v"]) -> Bool[Tensor, " S"]:
        """Which samples have every term within its tolerance."""
        return self.objective.met(step.decode(value), self.context)
