"""What every stage of a refinement is given, and how it solves for goals from there."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import cached_property

import torch
from jaxtyping import Float, Int
from torch import Tensor

from objectives import Context, Objective
from scenectl.control.refine.body_costs import BodyCosts
from scenectl.control.refine.polish import SmoothStep
from scenectl.control.settings import SolverSettings
from scenectl.control.solvers.choice import minimise
from scenectl.control.solvers.problem import Problem, Solution
from scenectl.control.solvers.residuals import Residuals
from scenectl.control.thresholds import THRESHOLDS, Thresholds
from scenectl.generators.base import Step
from scenectl.generators.steps import MappedStep
from scenes.motion.motion import Motion
from scenes.motion.rigid import rigid

_REMEMBERED = 2
"""Steps: what a search ended with is asked for again, and is among its last trials as a rule."""


def _uncounted() -> None:
    """No pass is counted."""


@dataclass(frozen=True)
class Setting:
    """A step, the goals, and how to search.

    Attributes:
        step: with the generator's own value.
        objective: the goals.
        context: scene and body.
        solver: settings; at least one iteration.
        count: called at every pass.
        thresholds: see there.
    """

    step: Step
    objective: Objective
    context: Context
    solver: SolverSettings
    count: Callable[[], None] = _uncounted
    thresholds: Thresholds = THRESHOLDS
    _recent: deque[Step] = field(default_factory=lambda: deque(maxlen=_REMEMBERED), repr=False, compare=False)

    @cached_property
    def goals(self) -> Objective:
        """The objective; where polishing follows, with targets that count as met within its reach."""
        if not self.solver.polish:
            return self.objective
        return Objective(tuple(term.loosened(self.thresholds.reach) for term in self.objective.terms))

    def of(self, samples: Int[Tensor, " s"]) -> Setting:
        """The same for some samples."""
        return replace(self, step=self.step.take(samples))

    def in_joints(self, step: SmoothStep, solver: SolverSettings) -> Setting:
        """The same goals for a move of joints, which keeps bones rigid, and how to search for it."""
        return Setting(MappedStep(step, rigid), self.objective, self.context, solver, self.count, self.thresholds)

    def body_costs(self) -> BodyCosts:
        """What a body is held to, beside the step's own motion."""
        return BodyCosts.beside(self.step.motion, self.goals, self.context, self.thresholds)

    def motion(self, found: Solution) -> Motion:
        """The motion of what was found."""
        motion = self._at(found.value.view_as(self.step.value)).motion
        return motion if found.moves is None else replace(motion, joints=motion.joints + found.moves)

    @torch.no_grad()
    def cost(self, motion: Motion) -> Float[Tensor, " S"]:
        """Of the objective."""
        return self.objective.cost(motion, self.context)

    def solve(
        self,
        goals: Objective | BodyCosts,
        begin: Float[Tensor, "S n"] | None = None,
        settings: SolverSettings | None = None,
    ) -> Solution:
        """The least cost of goals, and of the distance from where the search begins: by default at the step's value."""
        shape, settings = self.step.value.shape, settings or self.solver

        def judge(x: Tensor) -> tuple[Tensor, Tensor]:
            self.count()
            return goals.judge(self.step.decode(x.view(shape)), self.context)

        def linearise(x: Tensor) -> Residuals:
            self.count()
            return Residuals(goals, self.context, self._at(x.view(shape)))

        start = self.step.value.detach().flatten(1) if begin is None else begin.detach()
        problem = Problem(judge, start, linearise, self.step.price, self.step.unit)
        return minimise(problem, settings, self.thresholds)

    def _at(self, value: Float[Tensor, "S *v"]) -> Step:
        """The step at a value; the last ones are remembered, as each costs a pass."""
        for known in (self.step, *self._recent):
            if type(known) is type(self.step) and torch.equal(known.value, value):
                return known
        self._recent.append(self.step.at(value))
        return self._recent[-1]
