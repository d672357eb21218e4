"""One generation, start to end: a draft under guidance, its last step refined."""

from __future__ import annotations

from dataclasses import dataclass

from objectives import Context, Objective
from scenectl.control import Figure, FreeStart, GuidanceSettings, ObjectiveGuide, SolverSettings, refine
from scenectl.control.refine.polish import SmoothStep
from scenectl.control.solvers.problem import Solution
from scenectl.generators.base import Generator, Progress, silent
from scenectl.generators.prompts import Prompts
from scenectl.generators.steps import MappedStep
from scenectl.tasks.conditions import conditions_of
from scenes.motion.motion import Motion, Pose2D
from scenes.motion.rigid import rigid


@dataclass(frozen=True)
class Made:
    """Motions that were generated for goals.

    Attributes:
        motion: world coordinates, ``[S, T, J, 3]``.
        unrefined: the draft's, or None where there was nothing to refine for.
        solution: what refinement did.
        trace: figures of the generator's.
    """

    motion: Motion
    unrefined: Motion | None
    solution: Solution | None
    trace: dict[str, object]


def make(
    generator: Generator,
    prompts: Prompts | str,
    seconds: float,
    start: Pose2D,
    objective: Objective,
    context: Context,
    *,
    solver: SolverSettings | None = None,
    guidance: GuidanceSettings | None = None,
    free_start: bool = False,
    samples: int = 1,
    seed: int = 0,
    progress: Progress = silent,
) -> Made:
    """Generate under guidance towards an objective, and refine what came of it.

    Args:
        generator: of any family.
        prompts, seconds, start, samples, seed: as `Generator.generate` takes them.
        objective: the goals; without any, the draft is the motion. Families that take goals as inputs are told their
            targets.
        context: scene and body; motions are on its bones.
        solver, guidance: settings.
        free_start: where motions begin is solved for, from `start` on.
        progress: called with what is being done and the fraction done.
    """
    unknown = FreeStart(start.position) if free_start else None
    figure = Figure.between(generator.spec.skeleton, context.body.skeleton, start.position)
    guide = ObjectiveGuide(objective, context, guidance, unknown, figure=figure) if objective.counted else None
    takes = "conditions" in generator.spec.abilities and unknown is None
    conditions = conditions_of(objective, context, start, seconds, generator.spec, figure) if takes else None
    draft = generator.generate(
        prompts, seconds, start, conditions=conditions, guide=guide, samples=samples, seed=seed, progress=progress
    )
    if guide is None:
        return Made(draft.motion if figure is None else figure.of(draft.motion), None, None, draft.trace)
    step = MappedStep(SmoothStep.of(draft.motion), rigid) if draft.step is None else draft.step
    refined = refine(step, objective, context, solver, unknown, progress, figure)
    return Made(refined.motion, refined.unrefined, refined.solution, draft.trace)
