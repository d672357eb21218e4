"""Refinement: a draft's last step is solved for the goals, as far as a body allows, and polished in joints."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

from objectives import Context, Objective
from scenectl.control.refine.refinement import Refinement
from scenectl.control.settings import SolverSettings
from scenectl.control.solvers.problem import Solution
from scenectl.control.start import FreeStart, MovedStep
from scenectl.generators.base import Progress, Step, silent
from scenes.motion.motion import Motion


@dataclass(frozen=True)
class Refined:
    """What refinement made of a step.

    Attributes:
        motion: world coordinates, ``[S, T, J, 3]``.
        unrefined: the step's own, from the start that suits it where that is solved for.
        solution: which solver, why each sample's search ended, and what it cost; None where nothing was solved.
    """

    motion: Motion
    unrefined: Motion
    solution: Solution | None


def refine(
    step: Step,
    objective: Objective,
    context: Context,
    solver: SolverSettings | None = None,
    start: FreeStart | None = None,
    progress: Progress = silent,
) -> Refined:
    """Minimise the objective's cost from the step's value (Eq. 12).

    Args:
        step: the last one of a draft.
        objective: the goals.
        context: scene and body.
        solver: settings; no iterations leave the motion as it is.
        start: where motions begin, if that is solved for along with the value.
        progress: called with the share of a usual number of passes.
    """
    solver = solver or SolverSettings()
    if start is not None:
        step = MovedStep.of(step, start, start.fit(step.motion, lambda motion: objective.cost(motion, context)))
    if solver.iterations == 0:
        return Refined(step.motion, step.motion, None)
    found = Refinement(step, objective, context, solver, _counter(solver, progress))
    motion = step.at(found.value).motion
    if found.moves is not None:
        motion = replace(motion, joints=motion.joints + found.moves)
    return Refined(motion, step.motion, found.solution)


def _counter(solver: SolverSettings, progress: Progress) -> Callable[[], None]:
    """Counts a pass, and tells which share of a usual number was made."""
    passes = 0

    def tell() -> None:
        nonlocal passes
        passes += 1
        progress("refinement", min(passes / (1.25 * solver.iterations), 1.0))

    return tell
