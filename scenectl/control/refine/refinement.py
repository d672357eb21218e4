"""From a draft's last step to a motion that meets the goals, or meets them as well as a body can."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from objectives import Context, Objective
from scenectl.control.figure import Figure
from scenectl.control.refine.setting import Setting
from scenectl.control.refine.stages import solved
from scenectl.control.rise import Rise
from scenectl.control.settings import SolverSettings
from scenectl.control.solvers.problem import Solution
from scenectl.control.start import FreeStart, MovedStep
from scenectl.control.thresholds import THRESHOLDS, Thresholds
from scenectl.generators.base import Progress, Step, silent
from scenectl.generators.steps import MappedStep
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
    figure: Figure | None = None,
    thresholds: Thresholds = THRESHOLDS,
) -> Refined:
    """Minimise the objective's cost from the step's value (Eq. 12).

    Args:
        step: the last one of a draft.
        objective: the goals.
        context: scene and body.
        solver: settings; no iterations leave the motion as it is.
        start: where motions begin, if that is solved for along with the value.
        progress: called with the share of a usual number of passes.
        figure: of the body, where the step's motions are another's.
        thresholds: what stages and solvers decide by.
    """
    solver = solver or SolverSettings()
    if figure is not None:
        step = MappedStep(step, figure.of)
    if (rise := Rise.of(objective)) is not None:
        step = MappedStep(step, rise.under)
    if start is not None:
        step = MovedStep.of(step, start, start.fit(step.motion, objective, context, thresholds))
    if solver.iterations == 0:
        return Refined(step.motion, step.motion, None)
    setting = Setting(step, objective, context, solver, _counter(solver, progress), thresholds)
    found = solved(setting)
    return Refined(setting.motion(found), step.motion, found)


def _counter(solver: SolverSettings, progress: Progress) -> Callable[[], None]:
    """Counts a pass, and tells which share of a usual number was made."""
    passes = 0

    def tell() -> None:
        nonlocal passes
        passes += 1
        progress("refinement", min(passes / (1.25 * solver.iterations), 1.0))

    return tell
