"""What each threshold of control is worth: the same drafts refined with one entry of the table changed at a time."""

from __future__ import annotations

import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any

from objectives import Context, Objective, Term
from scenectl.bench.engine import ENGINE, Engine, Result, Row
from scenectl.control import FreeStart, ObjectiveGuide, SolverSettings, refine
from scenectl.control.refine.body_costs import BodyCosts
from scenectl.control.refine.polish import SmoothStep
from scenectl.control.thresholds import THRESHOLDS, Thresholds, entries
from scenectl.generators.base import Generator, Step
from scenectl.tasks.schema import AVOID
from scenes.body.body import DEFAULT_BODY
from scenes.errors import UserError, did_you_mean
from scenes.mesh.primitives import Box
from scenes.motion.motion import Pose2D
from scenes.world.scene import Scene

PROMPT = "a person walks forward"
FACTORS = (0.5, 2.0)
WALLS = Term.from_table({"use": "sdf_penetration", **AVOID})
FLOOR = Context(Scene.empty(-DEFAULT_BODY.sole_offset), DEFAULT_BODY)
POSTS = Context(
    Scene(primitives=[Box((0.15, 1.0, 1.2), (0.3, 2.0, 0.3)), Box((-0.5, 1.0, 2.4), (0.4, 2.0, 0.4))]), DEFAULT_BODY
)


def _targets(joint: str, places: Sequence[Sequence[float]], at: Sequence[float], tolerance: float = 0.01) -> Term:
    return Term("joint_target", {"joint": joint, "position": places}, at=list(at), tolerance=tolerance)


_WAY = [0.1 * i for i in range(1, 30)]
CASES: dict[str, tuple[Objective, Context, bool]] = {
    "keyframes": (
        Objective((_targets("right_wrist", [[-0.3, 1.0, 0.9], [-0.2, 1.1, 2.4]], (1.0, 2.6), 0.002),)), FLOOR, False,
    ),
    "out of reach": (
        Objective((_targets("left_wrist", [[0.3, 1.2, 0.6], [0.3, 3.6, 1.0], [0.3, 1.2, 1.6]], (1.0, 1.5, 2.0)),)),
        FLOOR, False,
    ),
    "lowered head": (Objective((_targets("head", [[0.1, 1.45, 2.2]], (2.0,), 0.002), WALLS)), FLOOR, False),
    "past posts": (Objective((_targets("pelvis", [[0.2, 0.9, 3.0]], (3.0,), 0.05), WALLS)), POSTS, False),
    "led": (
        Objective((_targets("pelvis", [[0.0, 0.9, 0.6 * t] for t in _WAY], _WAY, 0.05), WALLS)), FLOOR, False,
    ),
    "free start": (Objective((_targets("pelvis", [[0.5, 0.9, -1.0], [0.5, 0.9, -2.2]], (1.0, 2.5)),)), FLOOR, True),
}  # fmt: skip
"""Goals, where, and whether the start is solved for: like those of the benches of keyframes, bad targets and rooms."""


@dataclass(frozen=True)
class _Draft:
    step: Step
    goals: Objective
    context: Context
    start: FreeStart | None


def bench_thresholds(
    generator: Generator,
    names: Sequence[str] = (),
    factors: Sequence[float] = FACTORS,
    seed: int = 0,
    engine: Engine = ENGINE,
) -> Result:
    """Refine the drafts of `CASES` with the table as it is, and with each entry multiplied by each factor.

    Args:
        generator: what makes the drafts, once.
        names: entries of `scenectl.control.thresholds`; all of them by default.
        factors: on the entry's value; whole numbers are rounded, and stay above 0.
        seed: of the drafts.
        engine: tells progress, keeps rows and goes on from them.

    Returns:
        ``{"summary", "rows"}``: a row for each entry and factor with the share of cases whose goals are met, the mean
        of the cost, how far (m) a foot is lifted at worst that stood before refinement, the mean distance (m) of joints
        from the result without the change, passes and seconds.

    Raises:
        UserError: an entry that is not in the table.
    """
    table = {entry["name"]: entry for entry in entries()}
    for name in names:
        if name not in table:
            raise UserError(f"unknown threshold '{name}'{did_you_mean(name, table)}")
    drafts = list(_drafts(generator, seed))
    base = [_refined(draft, THRESHOLDS) for draft in drafts]
    same = {"name": "(none)", "value": None, "unit": "", **_figures(base, base), "decides": "", "source": ""}

    def rows(change: tuple[str, float | int]) -> list[Row]:
        name, factor = change
        if not name:
            return [same]
        old = getattr(THRESHOLDS, name)
        value = max(1, round(factor * old)) if isinstance(old, int) else factor * old
        found = [_refined(draft, replace(THRESHOLDS, **{name: value})) for draft in drafts]
        return [{**table[name], "value": value, **_figures(found, base)}]

    changes: list[tuple[str, float | int]] = [("", 1.0), *((n, f) for n in names or table for f in factors)]
    cases = [(f"thresholds: {name}", (name, factor)) for name, factor in changes]
    return engine.run(
        cases, rows, lambda _: {"cases": len(drafts), "seed": seed}, {"bench": "thresholds", "seed": seed}
    )


def _drafts(generator: Generator, seed: int) -> Iterator[_Draft]:
    for goals, context, free in CASES.values():
        start = FreeStart((0.0, 0.0, 0.0)) if free else None
        guide = ObjectiveGuide(goals, context, None, start)
        draft = generator.generate(PROMPT, 3.2, Pose2D(), guide=guide, seed=seed)
        step = SmoothStep.of(draft.motion) if draft.step is None else draft.step
        yield _Draft(step, goals, context, start)


@dataclass(frozen=True)
class _Found:
    joints: Any
    met: bool
    cost: float
    lift: float
    passes: int
    seconds: float


def _refined(draft: _Draft, thresholds: Thresholds) -> _Found:
    began = time.perf_counter()
    made = refine(draft.step, draft.goals, draft.context, SolverSettings(), draft.start, thresholds=thresholds)
    seconds = time.perf_counter() - began
    body = BodyCosts.beside(made.unrefined, draft.goals, draft.context)
    return _Found(
        made.motion.joints,
        bool(draft.goals.met(made.motion, draft.context).all()),
        float(draft.goals.cost(made.motion, draft.context).mean()),
        float(body.lift(made.motion).max()),
        0 if made.solution is None else made.solution.evaluations,
        seconds,
    )


def _figures(found: Sequence[_Found], base: Sequence[_Found]) -> dict[str, float]:
    moved = [float((a.joints - b.joints).norm(dim=-1).mean()) for a, b in zip(found, base, strict=True)]
    return {
        "met": sum(one.met for one in found) / len(found),
        "cost": sum(one.cost for one in found) / len(found),
        "lift_m": max(one.lift for one in found),
        "moved_m": sum(moved) / len(moved),
        "passes": sum(one.passes for one in found),
        "seconds": sum(one.seconds for one in found),
    }
