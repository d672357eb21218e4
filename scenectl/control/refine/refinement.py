"""One refinement, start to end: goals that pull lead, then all goals count, a body is minded, joints are polished."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from dataclasses import replace

import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor

from objectives import Context, Objective
from scenectl.control.refine import natural as body
from scenectl.control.refine.natural import Natural
from scenectl.control.refine.polish import SmoothStep, bearable, loosened, polishing
from scenectl.control.settings import SolverSettings
from scenectl.control.solvers.choice import minimise
from scenectl.control.solvers.problem import Problem, Reason, Solution
from scenectl.control.solvers.residuals import Residuals
from scenectl.generators.base import Step
from scenes.motion.motion import Motion

_REMEMBERED = 2
"""Steps: what a search ended with is asked for again, and is among its last trials as a rule."""


class Refinement:
    """Looks for the values of a step that meet goals best (Eq. 12), as far as a body bears it.

    Attributes:
        value: what was found, in the shape of the step's value.
        solution: how.
        moves: of joints, m, ``[S, T, J, 3]``, which polishing adds to the motion of `value`; None where it adds none.
    """

    def __init__(
        self,
        step: Step,
        objective: Objective,
        context: Context,
        solver: SolverSettings,
        tell: Callable[[], None] = lambda: None,
    ) -> None:
        """Refine.

        Args:
            step: with the generator's own value.
            objective: the goals.
            context: scene and body.
            solver: settings; at least one iteration.
            tell: called at every pass.
        """
        self._objective, self._context, self._solver, self._tell = objective, context, solver, tell
        self._goals = loosened(objective) if solver.polish else objective
        self._recent: deque[Step] = deque(maxlen=_REMEMBERED)
        self.moves: Float[Tensor, "S T J 3"] | None = None
        self.solution = self._searched(step)
        if solver.natural:
            self._ease(step)
        if solver.polish:
            self._polish(step)
        self.solution.settle(self._met(step))
        self.value = self.solution.value.view_as(step.value)

    def _searched(self, step: Step) -> Solution:
        """All goals, from where those that pull have led; from the generator's own value where that was no help.

        A wall is a hinge: once a body is on the wrong side of it, goals and wall hold each other in balance, and no
        solver gets it out. What leads (a path, a target) lies on the right side, and walls count from there on.
        """
        leading, lead = tuple(t for t in self._goals.counted if t.spec.pulls), self._solver.lead
        if not lead or len(leading) in (0, len(self._goals.counted)):
            return self._solved(step, step.value, self._goals, self._solver)
        goals = self._goals
        if self._solver.natural and body.leads(goals, step.motion, self._context):
            goals = body.minding_walk(goals)
        few = {"iterations": min(lead, self._solver.iterations), "enough": None}
        led = self._solved(step, step.value, Objective(leading), self._solver.model_copy(update=few))
        found = self._solved(step, led.value.view_as(step.value), goals, self._solver)
        found.evaluations += led.evaluations
        lost = ~(self._cost(self._motion(step, found)) <= self._cost(step.motion))
        if lost.any():  # nan, too
            at = step.at(step.value[lost])
            again = self._solved(at, at.value, goals, self._solver)
            found.replace(again, lost.nonzero()[:, 0], torch.ones_like(lost[lost]))
        return found

    def _ease(self, step: Step) -> None:
        """Solve anew for samples whose body was strained, minding it (`scenectl.control.refine.natural`)."""
        natural, after = Natural(self._goals, step.motion, self._context), self._motion(step, self.solution)
        gone = torch.tensor([reason == "abandoned" for reason in self.solution.reasons])
        # What is met, or nearly, stays so for all that a bone is a little longer.
        goals_met = self._goals.met(after, self._context)
        solved = goals_met | (self._cost(after) <= body.SOLVED * self._cost(step.motion))
        worse = torch.where(solved, natural.strained(after, body.LENIENT), natural.strained(after))
        strained = (worse & ~gone).nonzero()[:, 0]
        hopeful = goals_met & ~natural.strained(after, body.HOPEFUL)
        met = strained[hopeful[strained]]
        if len(met):
            begin = self.solution.value.view_as(step.value)[met]
            bears = self._insisted(step.at(step.value[met]), begin, met)
            strained = strained[~torch.isin(strained, met[bears])]
        if len(strained):
            self._eased(step.at(step.value[strained]), strained)

    def _eased(self, step: Step, strained: Int[Tensor, " s"]) -> None:
        """The same for the strained ones, of which `step` holds the generator's own values."""
        natural = Natural(self._goals, step.motion, self._context)
        gentle = self._solved(step, step.value, natural, body.approach(self._solver))
        self.solution.replace(gentle, strained, torch.ones_like(strained, dtype=torch.bool), "strained")
        begin = gentle.value.view_as(step.value)
        left = torch.ones_like(strained, dtype=torch.bool)
        if (near := natural.in_reach(self._motion(step, gentle), self._context)).any():
            left[near] = ~self._insisted(step.at(step.value[near]), begin[near], strained[near])
        if left.any():
            self._let_go(step.at(step.value[left]), begin[left], strained[left])

    def _insisted(self, step: Step, begin: Float[Tensor, "s *v"], samples: Int[Tensor, " s"]) -> Bool[Tensor, " s"]:
        """From near the goals, with the body's costs, and the last of the way without; which samples it helped."""
        natural = Natural(self._goals, step.motion, self._context)
        found = self._solved(step, begin, natural.insisting(), body.approach(self._solver))
        there = self._motion(step, found)
        helped = natural.in_reach(there, self._context) & ~natural.strained(there)
        self.solution.replace(found, samples, helped, "strained")
        closer = self._solved(step, found.value.view_as(begin), self._goals, body.finish(self._solver))
        there = self._motion(step, closer)
        bears = self._goals.met(there, self._context) & ~natural.strained(there)
        self.solution.replace(closer, samples, bears)
        return helped | bears

    def _let_go(self, step: Step, begin: Float[Tensor, "s *v"], samples: Int[Tensor, " s"]) -> None:
        """From where some goals are far off: without those, or after all with them, if a body bears it."""
        natural = Natural(self._goals, step.motion, self._context)
        approach, finish = body.approach(self._solver), body.finish(self._solver)

        def take(found: Solution, reason: Reason | None) -> None:
            self.solution.replace(found, samples, ~natural.strained(self._motion(step, found)), reason)

        freed = self._solved(step, begin, natural.letting_go(), approach)
        take(freed, "strained")
        within = freed.value.view_as(step.value)  # to be judged by what comes of it
        take(self._solved(step, within, natural.without_outliers, finish), "strained")
        take(self._solved(step, begin, self._goals, finish), None)

    def _polish(self, step: Step) -> None:
        """The last centimetre of those that have no more to go: in joints, or else through the decoder after all."""
        motion = self._motion(step, self.solution)
        near = (self._goals.met(motion, self._context) & ~self._objective.met(motion, self._context)).nonzero()[:, 0]
        if not len(near):
            return
        some = replace(motion, joints=motion.joints[near], valid=motion.valid[near])
        done, moves = torch.zeros_like(near, dtype=torch.bool), torch.zeros_like(some.joints)
        smooth = SmoothStep.of(some)
        # Targets alone, as so small a move takes other goals out of their tolerances but seldom; then all goals.
        for goals in (Objective(tuple(t for t in self._objective.counted if t.spec.pulls)), self._objective):
            found = self._solved(smooth, smooth.value, goals, polishing(self._solver))
            after = smooth.decode(found.value.view_as(smooth.value))
            good = bearable(some, after) & self._objective.met(after, self._context) & ~done
            moves[good] = (after.joints - some.joints)[good]
            done |= good
            if done.all():
                break
        self.moves = torch.zeros_like(motion.joints)
        self.moves[near] = moves
        if not done.all():
            self._finish_unpolished(step, near[~done])

    def _finish_unpolished(self, step: Step, samples: Int[Tensor, " s"]) -> None:
        value = self.solution.value.view_as(step.value)[samples]
        found = self._solved(step.at(value), value, self._objective, body.finish(self._solver))
        better = self._objective.met(self._motion(step.at(value), found), self._context)
        if self._solver.natural:
            before = step.at(step.value[samples])
            natural = Natural(self._goals, before.motion, self._context)
            better &= ~natural.strained(self._motion(before, found), body.LENIENT)
        self.solution.replace(found, samples, better)

    def _met(self, step: Step) -> Bool[Tensor, " S"]:
        motion = self._motion(step, self.solution)
        moved = motion if self.moves is None else replace(motion, joints=motion.joints + self.moves)
        return self._objective.met(moved, self._context)

    def _motion(self, step: Step, found: Solution) -> Motion:
        """The motion of what was found."""
        return self._at(step, found.value.view_as(step.value)).motion

    def _at(self, step: Step, value: Float[Tensor, "S *v"]) -> Step:
        """The step at a value; the last ones are remembered, as each costs a pass."""
        for known in (step, *self._recent):
            if type(known) is type(step) and torch.equal(known.value, value):
                return known
        self._recent.append(step.at(value))
        return self._recent[-1]

    @torch.no_grad()
    def _cost(self, motion: Motion) -> Float[Tensor, " S"]:
        return self._objective.cost(motion, self._context)

    def _solved(
        self, step: Step, start: Float[Tensor, "S *v"], goals: Objective | Natural, settings: SolverSettings
    ) -> Solution:
        """The least cost of goals, and of the distance from `start`, near it."""
        begin = start.detach().flatten(1)

        def value(x: Tensor) -> Tensor:
            return x.view_as(step.value)

        def cost(x: Tensor) -> Tensor:
            self._tell()
            away = (x - begin).square().sum(1)
            return goals.cost(step.decode(value(x)), self._context) + settings.prior * away

        def linearise(x: Tensor) -> Residuals:
            self._tell()
            return Residuals(goals, self._context, self._at(step, value(x)))

        def done(x: Tensor) -> Tensor:
            with torch.no_grad():
                return goals.met(step.decode(value(x)), self._context)

        return minimise(Problem(cost, begin, done, linearise), settings)
