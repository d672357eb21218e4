"""Ranking: each motion measured, judged and reported, the best first."""

from __future__ import annotations

import torch
from jaxtyping import Float
from torch import Tensor

from objectives import diagnosis
from scenectl.generators.base import Progress
from scenectl.measures.believability.judge import Judge
from scenectl.measures.metrics import Scorer, measure, pose_change
from scenectl.pipeline.results import Sample
from scenectl.tasks.setup import Setup, start_of
from scenes.motion.motion import Motion


def ranked(
    motion: Motion, unrefined: Motion | None, setup: Setup, scorer: Scorer, progress: Progress
) -> tuple[Motion, list[Sample]]:
    """Motions and rows, in the world, in this order: met and believable, met, the rest.

    Each of the three by how little refinement changed poses, to the millimetre, and then by cost; what is not a number
    comes last. Motions are given in the setup's frame.
    """
    objective, context = setup.objective, setup.context
    with torch.no_grad():
        costs = objective.cost(motion, context)
        before = None if unrefined is None else objective.cost(unrefined, context)
        changes = None if unrefined is None else pose_change(unrefined, motion)
    terms = objective.report(motion, context)
    judge = Judge.of(scorer, setup.prompts, objective)
    rows = []
    for index in range(len(motion.joints)):
        one = motion[index]
        depths = scorer.depths(one)
        row = Sample(
            index,
            _number(costs[index]),
            terms[index],
            measure(one, scorer, depths),
            judge.verdict(one, depths),
            _of(before, index),
            diagnosis(objective, one, context),
            start_of(one, setup.body),
            _of(changes, index),
            judge.series(one, depths),
        )
        rows.append(row.moved(setup.origin))
        progress("measuring", (index + 1) / len(motion.joints))
    rows.sort(key=_badness)
    order = [row.index for row in rows]
    return motion[order].moved(setup.origin), rows


def _badness(row: Sample) -> tuple[bool, bool, float, float]:
    return not row.good, not row.met, round(row.pose_change or 0.0, 3), row.cost


def _of(figures: Float[Tensor, " S"] | None, index: int) -> float | None:
    return None if figures is None else _number(figures[index])


def _number(value: Tensor) -> float:
    return float(value.nan_to_num(nan=1e30, posinf=1e30))
