"""Ranking: each motion measured and reported, the best first."""

from __future__ import annotations

from dataclasses import replace

import torch
from jaxtyping import Float
from torch import Tensor

from objectives import diagnosis
from scenectl.generators.base import Progress
from scenectl.measures.metrics import Scorer, measure, pose_change
from scenectl.pipeline.results import Sample
from scenectl.tasks.setup import Setup, start_of
from scenes.motion.motion import Motion


def ranked(
    motion: Motion, unrefined: Motion | None, setup: Setup, scorer: Scorer, progress: Progress
) -> tuple[Motion, list[Sample]]:
    """Motions and rows, in the world: those that meet all goals first, by how little refinement changed poses, by cost.

    A cost that is not a number comes last. Motions are given in the setup's frame.
    """
    objective, context = setup.objective, setup.context
    with torch.no_grad():
        costs = objective.cost(motion, context)
        before = None if unrefined is None else objective.cost(unrefined, context)
        changes = None if unrefined is None else pose_change(unrefined, motion)
    met = objective.met(motion, context).tolist()

    def badness(i: int) -> tuple[bool, float, float]:
        change = 0.0 if changes is None or not met[i] else round(float(changes[i]), 3)
        return not met[i], change, float(costs[i].nan_to_num(nan=torch.inf))

    order = sorted(range(len(met)), key=badness)
    terms = objective.report(motion, context)
    rows = []
    for done, index in enumerate(order):
        figures = measure(motion[index], scorer)
        why = diagnosis(objective, motion[index], context)
        start = start_of(motion[index], setup.body)
        change, cost = _of(changes, index), _number(costs[index])
        row = Sample(index, cost, terms[index], figures, _of(before, index), why, start, change)
        rows.append(row.moved(setup.origin))
        progress("measuring", (done + 1) / len(order))
    best_first = replace(motion, joints=motion.joints[order], valid=motion.valid[order])
    return best_first.moved(setup.origin), rows


def _of(figures: Float[Tensor, " S"] | None, index: int) -> float | None:
    return None if figures is None else _number(figures[index])


def _number(value: Tensor) -> float:
    return float(value.nan_to_num(nan=1e30, posinf=1e30))
