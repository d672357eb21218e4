"""Objectives as a guide: goals, scene and solver on one side, a generator's steps on the other."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from objectives import Context, Objective
from scenectl.control.problem import Solution
from scenectl.control.refinement import Refinement
from scenectl.control.settings import GuidanceSettings, SolverSettings
from scenectl.control.start import UNKNOWNS, FreeStart, MovedStep
from scenectl.generators.base import Generation, Progress, Step
from scenes.motion.motion import Motion


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
        start: FreeStart | None = None,
    ) -> None:
        """Make a guide.

        Args:
            objective: the goals.
            context: scene and body.
            solver, guidance: settings.
            progress: called with what is being done and the fraction done.
            start: where motions begin, if that shall be solved for; `finish` moves what a generator made then.
        """
        self.start = start
        self.objective, self.context = objective, context
        self.solver, self.guidance = solver or SolverSettings(), guidance or GuidanceSettings()
        self.progress = progress
        self.solution: Solution | None = None
        self._moves: Float[Tensor, "S T J 3"] | None = None

    def log_prob(self, step: Step) -> Float[Tensor, " S"]:
        """Minus the objective's cost (Eq. 40), times the guidance scale."""
        return -self.guidance.scale * self._cost(self._begun(step.decode(step.value)))

    def gradient(self, step: Step) -> Float[Tensor, "S *v"]:
        """Gradient of `log_prob` in the step's value; samples are independent, so one backward pass serves all."""
        value = step.value.detach().requires_grad_(True)
        with torch.enable_grad():
            cost = self._cost(self._begun(step.decode(value)))
            (gradient,) = torch.autograd.grad(cost.sum(), value)
        # One frame that is not a number must not silence the whole tilt.
        return -self.guidance.scale * torch.nan_to_num(gradient, 0.0, 0.0, 0.0)

    def refine(self, step: Step) -> Float[Tensor, "S *v"]:
        """Minimise the objective's cost from the step's value (Eq. 12), as far as a body bears it (`Refinement`)."""
        self.solution = self._moves = None
        if self.start is None:
            return self._refined(step)
        self.start.before = self.start.fit(step.motion, self._cost)
        found = self._refined(MovedStep.of(step, self.start, self.start.before))
        self.start.moves = found[:, -UNKNOWNS:]
        return found[:, :-UNKNOWNS].reshape(step.value.shape)

    def finish(self, made: Generation) -> Generation:
        """What a generator made, moved to the start that was found for it, and polished."""
        if self.start is not None and self.start.moves is not None:
            before = self.start.moves if self.start.before is None else self.start.before
            unrefined = None if made.unrefined is None else self.start.moved(made.unrefined, before)
            made = replace(made, motion=self.start.moved(made.motion, self.start.moves), unrefined=unrefined)
        if self._moves is None:
            return made
        return replace(made, motion=replace(made.motion, joints=made.motion.joints + self._moves))

    def _begun(self, motion: Motion) -> Motion:
        """The motion from where it had best begin, if that is free."""
        return motion if self.start is None else self.start.moved(motion, self.start.fit(motion, self._cost))

    def _cost(self, motion: Motion) -> Float[Tensor, " S"]:
        return self.objective.cost(motion, self.context)

    def _refined(self, step: Step) -> Float[Tensor, "S *v"]:
        if self.solver.iterations == 0:
            return step.value.detach()
        found = Refinement(step, self.objective, self.context, self.solver, self._pass_counter())
        self.solution, self._moves = found.solution, found.moves
        return found.value

    @torch.no_grad()
    def met(self, step: Step, value: Float[Tensor, "S *v"]) -> Bool[Tensor, " S"]:
        """Which samples have every term within its tolerance."""
        return self.objective.met(step.decode(value), self.context)

    def _pass_counter(self) -> Callable[[], None]:
        """What counts a pass, and says to whoever follows the progress which share of a usual number was made."""
        passes = 0

        def tell() -> None:
            nonlocal passes
            passes += 1
            if self.progress is not None:
                self.progress("refinement", min(passes / (1.25 * self.solver.iterations), 1.0))

        return tell
