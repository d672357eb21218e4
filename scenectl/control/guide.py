"""Objectives as a guide: goals, scene and solver on one side, a generator's steps on the other."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor

from objectives import Context, Objective
from scenectl.control.natural import LENIENCY, SOLVED, Natural, approach, finish
from scenectl.control.polish import SmoothStep, bearable, loosened
from scenectl.control.problem import Problem, Reason, Solution
from scenectl.control.residuals import Residuals
from scenectl.control.settings import GuidanceSettings, SolverSettings
from scenectl.control.solvers import minimise
from scenectl.control.start import UNKNOWNS, FreeStart, MovedStep
from scenectl.generators.base import Generation, Progress, Step
from scenes.motion import Motion


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
            start: where motions begin, if that shall be solved for; `placed` moves what a generator made then.
        """
        self.start = start
        self.objective, self.context = objective, context
        self.solver, self.guidance = solver or SolverSettings(), guidance or GuidanceSettings()
        self.progress = progress
        self.solution: Solution | None = None
        self._refinable = loosened(objective) if self.solver.polish else objective

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
        """Minimise the objective's cost from the step's value (Eq. 12), as far as a body bears it.

        Where that stretched bones or lifted feet that stood, an approach that minds them begins anew, and the goals
        are solved for from there, as far as a body bears it (`scenectl.control.natural`).
        """
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
        if self.solution is None or not self.solver.polish:
            return made
        return replace(made, motion=self._polished(made.motion))

    @torch.no_grad()
    def _polished(self, motion: Motion) -> Motion:
        """The last centimetre of those samples that have no more than that to go (`scenectl.control.polish`)."""
        assert self.solution is not None
        near = self._refinable.met(motion, self.context) & ~self.objective.met(motion, self.context)
        if not near.any():
            return motion
        some = replace(motion, joints=motion.joints[near], valid=motion.valid[near])
        step = SmoothStep.of(some)
        found = self._solved(step, step.value, self.objective, self.solver, self._pass_counter())
        after = step.decode(found.value.view_as(step.value))
        better = bearable(some, after) & (self._cost(after) < self._cost(some))
        joints = motion.joints.clone()
        joints[near] = torch.where(better[:, None, None, None], after.joints, some.joints)
        self.solution.unfinished(near.nonzero()[:, 0][~(better & self.objective.met(after, self.context))])
        return replace(motion, joints=joints)

    def _begun(self, motion: Motion) -> Motion:
        """The motion from where it had best begin, if that is free."""
        return motion if self.start is None else self.start.moved(motion, self.start.fit(motion, self._cost))

    def _cost(self, motion: Motion) -> Float[Tensor, " S"]:
        return self.objective.cost(motion, self.context)

    def _refined(self, step: Step) -> Float[Tensor, "S *v"]:
        if self.solver.iterations == 0:
            return step.value.detach()
        tell = self._pass_counter()
        begin, passes = self._led(step, tell)
        self.solution = self._solved(step, begin, self._refinable, self.solver, tell)
        self.solution.evaluations += passes
        refined = self.solution.value.view_as(step.value)
        if not self.solver.natural:
            return refined
        natural = Natural(self._refinable, step.motion, self.context)
        after, gone = step.at(refined).motion, torch.tensor([r == "abandoned" for r in self.solution.reasons])
        # What is met, or nearly, stays so for all that a foot is a little higher or a bone a little longer.
        solved = self._cost(after) <= SOLVED * self._cost(step.motion)
        worse = torch.where(solved, natural.strained(after, LENIENCY), natural.strained(after))
        strained = (worse & ~gone).nonzero()[:, 0]
        if len(strained):
            self._eased(step.at(step.value[strained]), strained, tell)
        return self.solution.value.view_as(step.value)

    def _led(self, step: Step, tell: Callable[[], None]) -> tuple[Float[Tensor, "S *v"], int]:
        """Where to begin, and the passes it took: a few steps in which only goals that pull are heeded.

        A wall is a hinge: once a body is on the wrong side of it, goals and wall hold each other in balance, and no
        solver gets it out. What leads (a path, a target) lies on the right side, and walls count from there on.
        """
        leading = tuple(term for term in self._refinable.counted if term.spec.pulls)
        if not self.solver.lead or len(leading) in (0, len(self._refinable.counted)):
            return step.value, 0
        settings = self.solver.model_copy(update={"iterations": self.solver.lead, "enough": None})
        found = self._solved(step, step.value, Objective(leading), settings, tell)
        return found.value.view_as(step.value), found.evaluations

    def _eased(self, step: Step, strained: Int[Tensor, " s"], tell: Callable[[], None]) -> None:
        """Solve anew for the samples that were strained, of which `step` holds the generator's own values."""
        assert self.solution is not None
        natural = Natural(self._refinable, step.motion, self.context)
        gentle = self._solved(step, step.value, natural, approach(self.solver), tell)
        self.solution.replace(gentle, strained, torch.ones_like(strained, dtype=torch.bool), "strained")
        begin = gentle.value.view_as(step.value)
        freed = self._solved(step, begin, natural.letting_go(), approach(self.solver), tell)
        within = self._taken(step, freed, natural, strained, "strained")
        stages: list[tuple[Tensor, Objective, Reason | None]] = [
            (within, natural.without_outliers, "strained"), (begin, self._refinable, None)
        ]  # fmt: skip
        for first, goals, reason in stages:
            self._taken(step, self._solved(step, first, goals, finish(self.solver), tell), natural, strained, reason)

    def _taken(
        self, step: Step, found: Solution, natural: Natural, samples: Int[Tensor, " s"], reason: Reason | None = None
    ) -> Float[Tensor, "S *v"]:
        """The values found, which are those of the solution from now on where a body bears them."""
        assert self.solution is not None
        value = found.value.view_as(step.value)
        self.solution.replace(found, samples, ~natural.strained(step.at(value).motion), reason)
        return value

    def _solved(
        self,
        step: Step,
        start: Float[Tensor, "S *v"],
        goals: Objective | Natural,
        settings: SolverSettings,
        tell: Callable[[], None],
    ) -> Solution:
        """The least cost of goals, and of the distance from `start`, near it."""
        begin = start.detach().flatten(1)

        def value(x: Tensor) -> Tensor:
            return x.view_as(step.value)

        def cost(x: Tensor) -> Tensor:
            tell()
            away = (x - begin).square().sum(1)
            return goals.cost(step.decode(value(x)), self.context) + settings.prior * away

        def linearise(x: Tensor) -> Residuals:
            tell()
            return Residuals(goals, self.context, step.at(value(x)))

        def done(x: Tensor) -> Tensor:
            with torch.no_grad():
                return goals.met(step.decode(value(x)), self.context)

        return minimise(Problem(cost, begin, done, linearise), settings)

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
