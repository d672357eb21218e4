"""ProgMoGen's tasks HSI-1, HSI-2 and HSI-3, as their evaluation defines them, with and without control.

* HSI-1: the head at stated heights in the first, the middle and the last frame. Constraint error: mean absolute error
  of the three heights. A sample succeeds when each is less than 5 cm off.
* HSI-2: the head at least 1.5 m high in the first and last frame, at most 0.5 m in the middle one, both foot joints
  there at or below y = 0. Constraint error: the hinges, weighted 1/3 and 1/2.
* HSI-3: all joints inside the square |x|, |z| <= 1 m. Constraint error: mean excess over joints, frames and sides.

Motions are in HumanML3D's frame: pelvis over the origin at first, facing +z, y = 0 where the lowest joint stands.
Skating and acceleration look at the L frames asked for. R-precision and FID, which HSI-1 has as well, need the
evaluator networks of text-to-motion and are not computed.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import torch

from objectives import Objective, Term
from scenectl.bench.control.keyframes import ON_FLOOR
from scenectl.bench.control.progmogen_prompts import FPS, HeadHeights, ProgMoGenPrompts, Prompt, load_progmogen
from scenectl.bench.engine import ENGINE, Engine, Result, Row
from scenectl.control import GuidanceSettings, SolverSettings
from scenectl.generators.base import Generator
from scenectl.measures.metrics import max_acceleration, skating_ratio
from scenectl.pipeline.generation import make
from scenes.errors import UserError, did_you_mean
from scenes.motion.motion import Motion, Pose2D
from scenes.motion.skeleton import FEET

TASKS = ("hsi1", "hsi2", "hsi3")
COUNTS: Mapping[str, int] = {"hsi1": 64, "hsi2": 32, "hsi3": 32}
"""Prompts a run takes from the start of each list; the published HSI-1 has 544."""

SUCCESS = 0.05
"""HSI-1: all three heights must be off by less (m)."""
PADDED_FRAMES = 196
"""ProgMoGen generates this many frames whatever the length, and HSI-3's square holds for all of them."""
PUBLISHED: Mapping[str, Mapping[str, Mapping[str, float]]] = {
    "ProgMoGen": {
        "hsi1": {"constraint_error_m": 0.011, "unsuccess_rate": 0.092},
        "hsi2": {"constraint_error_m": 0.073, "skating_ratio": 0.220, "max_acceleration_m_per_frame2": 0.153},
        "hsi3": {"constraint_error_m": 0.014, "skating_ratio": 0.121, "max_acceleration_m_per_frame2": 0.093},
    },
    "MSCoT": {
        "hsi1": {"constraint_error_m": 0.000, "unsuccess_rate": 0.000},
        "hsi2": {"constraint_error_m": 0.000, "skating_ratio": 0.141, "max_acceleration_m_per_frame2": 0.117},
        "hsi3": {"constraint_error_m": 0.000, "skating_ratio": 0.101, "max_acceleration_m_per_frame2": 0.072},
    },
}
"""Table 2 of the MSCoT paper; HSI-1 there has 544 prompts."""

# What control minimises: the published expressions with a smooth foot (huber), at a strength (nats) that leaves
# millimetres against refinement's pull to the generator's own motion: measured on reconstructed captures, 0.3 mm for
# HSI-1, 2.5 mm for HSI-2 and less than 0.1 mm for HSI-3. Scores use the published expressions as they are.
_STRENGTH = {"hsi1": 1000.0, "hsi2": 10000.0, "hsi3": 5000.0}
_TOLERANCE = 0.0003  # m; refinement may stop once no residual exceeds this
_SOLVER = SolverSettings(natural=False)
"""Published methods are scored by their goals alone, whatever becomes of the body."""
_GOALS = {"hsi1": "head_height", "hsi2": "barrier", "hsi3": "square_region"}


@dataclass(frozen=True)
class Case:
    """One prompt of one task.

    Attributes:
        task: "hsi1", "hsi2" or "hsi3".
        index: place in the list, from 0.
        caption: the prompt.
        length: frames L that are scored for skating and acceleration.
        frames: frames that are generated; more than `length` only for the padded HSI-3.
        heights: HSI-1's three heights (m), else nothing.
    """

    task: str
    index: int
    caption: str
    length: int
    frames: int
    heights: tuple[float, float, float] | None = None

    @property
    def parameters(self) -> dict[str, Any]:
        """Of the task's goal."""
        return {} if self.heights is None else {"height": list(self.heights)}

    def objective(self) -> Objective:
        """What control minimises."""
        kernel = None if self.task == "hsi1" else "huber"
        goal = _GOALS[self.task]
        term = Term(goal, self.parameters, tolerance=_TOLERANCE, kernel=kernel)
        return Objective((replace(term, weight=_STRENGTH[self.task] / term.spec.scale),))

    @property
    def hard(self) -> bool:
        """HSI-1: not just 'stay upright' (heights that differ by more than 0.3 m, or a middle below 1 m)."""
        heights = self.heights
        return heights is not None and (max(heights) - min(heights) > 0.3 or heights[1] < 1.0)


def cases(prompts: ProgMoGenPrompts, task: str, count: int | None = None, padded: bool = True) -> list[Case]:
    """The first `count` prompts of a task (by default `COUNTS`).

    Args:
        prompts: from `load_progmogen`.
        task: one of `TASKS`.
        count: how many.
        padded: HSI-3 over 196 frames whatever the length, as its published figures are.

    Raises:
        UserError: unknown task, or more prompts than there are.
    """
    if task not in TASKS:
        raise UserError(f"unknown ProgMoGen task '{task}'{did_you_mean(task, TASKS)}")
    rows: Sequence[HeadHeights | Prompt] = prompts.hsi1 if task == "hsi1" else prompts.n32
    wanted = min(COUNTS[task], len(rows)) if count is None else count
    if not 1 <= wanted <= len(rows):
        raise UserError(f"{task} has {len(rows)} prompts; ask for 1 to {len(rows)} and not {wanted}")
    return [
        Case(
            task,
            index,
            row.caption,
            row.length,
            PADDED_FRAMES if task == "hsi3" and padded else row.length,
            row.head_heights_m if isinstance(row, HeadHeights) else None,
        )
        for index, row in enumerate(rows[:wanted])
    ]


def score(case: Case, motion: Motion) -> dict[str, float | bool]:
    """Figures of one motion ``[T, 22, 3]`` for one case: metres, m/frame^2, ratios.

    Raises:
        UserError: the motion has fewer frames than the case asks for.
    """
    if motion.frames < case.frames:
        raise UserError(f"{case.task}: the generator made {motion.frames} of {case.frames} frames")
    # A generator may round its length up; what was not asked for is not judged.
    motion = _cropped(motion, case.frames)
    cropped = _cropped(motion, case.length)
    errors = _height_errors(case, motion) if case.task == "hsi1" else []
    figures: dict[str, float | bool] = {
        "constraint_error_m": sum(errors) / 3 if errors else _expression(case, motion),
        "skating_ratio": float(skating_ratio(cropped)),
        "max_acceleration_m_per_frame2": float(max_acceleration(cropped)),
        "lowest_foot_m": float(cropped.select(FEET)[..., 1].min()),
    }
    if errors:
        figures["success"] = all(error < SUCCESS for error in errors)
    if case.frames != case.length:
        figures["constraint_error_cropped_m"] = _expression(case, cropped)
    return figures


def _cropped(motion: Motion, frames: int) -> Motion:
    return replace(motion, joints=motion.joints[:frames], valid=torch.ones_like(motion.valid[:frames]))


def _expression(case: Case, motion: Motion) -> float:
    """The published expression of HSI-2 or HSI-3, whatever scale the goal has for control."""
    reduction = "mean" if case.task == "hsi3" else "sum"
    term = Term(_GOALS[case.task], case.parameters, kernel="linear", reduction=reduction)
    return float(term.cost(motion, ON_FLOOR)) / term.spec.scale


def _height_errors(case: Case, motion: Motion) -> list[float]:
    """Absolute errors (m) at the first, middle and last frame."""
    found = Term(_GOALS[case.task], case.parameters).evaluate(motion, ON_FLOOR)
    return [float(error) for error in found.square.sqrt().sum(0)]


@dataclass(frozen=True)
class _Setup:
    """What all motions of a run share."""

    generator: Generator
    seed: int
    solver: SolverSettings
    guidance: GuidanceSettings

    def make(self, case: Case, control: bool) -> dict[str, Any]:
        """One motion, its figures and the seconds it took."""
        objective = case.objective() if control else Objective(())
        began = time.perf_counter()
        # The same seed with and without control: the two differ by control alone.
        made = make(
            self.generator, case.caption, case.frames / FPS, Pose2D(), objective, ON_FLOOR,
            solver=self.solver, guidance=self.guidance, seed=self.seed + case.index,
        )  # fmt: skip
        seconds = time.perf_counter() - began
        return {"controlled": control, **score(case, made.motion[0]), "seconds": seconds}

    def rows(self, case: Case) -> list[Row]:
        """One with control, one without."""
        facts = {"task": case.task, "index": case.index, "caption": case.caption, "length_frames": case.length}
        if case.heights is not None:
            facts |= {"head_heights_m": list(case.heights), "hard": case.hard}
        made = (self.make(case, control) for control in (True, False))
        return [{**facts, **{key: _plain(value) for key, value in figures.items()}} for figures in made]


def bench_progmogen(
    generator: Generator,
    prompts: ProgMoGenPrompts | str | Path,
    tasks: Sequence[str] = TASKS,
    counts: Mapping[str, int] | None = None,
    padded: bool = True,
    seed: int = 0,
    solver: SolverSettings | None = None,
    guidance: GuidanceSettings | None = None,
    engine: Engine = ENGINE,
) -> Result:
    """Run the tasks, each prompt once with control and once without, one generation each.

    Args:
        generator: at 20 frames a second, with HumanML3D's 22 joints.
        prompts: the prompt file, or what `load_progmogen` made of it.
        tasks: which of `TASKS`.
        counts: prompts for each task, by default `COUNTS`.
        padded: see `cases`.
        seed: the i-th prompt's is this plus i.
        solver, guidance: as in a task file.
        engine: tells progress, keeps rows and goes on from them.

    Returns:
        ``{"summary": {task: {"controlled": means, "uncontrolled": means, ...}}, "rows": [...]}``, ready for JSON.

    Raises:
        UserError: unreadable prompts, an unknown task, or a generator of another frame rate.
    """
    if generator.spec.fps != FPS:
        raise UserError(
            f"ProgMoGen's tasks are at {FPS:g} fps; generator '{generator.name}' makes {generator.spec.fps:g}"
        )
    given = prompts if isinstance(prompts, ProgMoGenPrompts) else load_progmogen(prompts)
    work = [case for task in tasks for case in cases(given, task, (counts or {}).get(task), padded)]
    setup = _Setup(generator, seed, solver or _SOLVER, guidance or GuidanceSettings())
    settings = {
        "seed": seed,
        "hsi3_frames": "padded to 196" if padded else "cropped to the length",
        "solver": setup.solver.model_dump(),
        "guidance": setup.guidance.model_dump(),
    }

    def summary(rows: Sequence[Row]) -> dict[str, Any]:
        return {
            **{task: _summary([row for row in rows if row["task"] == task]) for task in tasks},
            "generator": {"name": generator.name, "licence": generator.licence},
            "settings": settings,
            "not_computed": ["R-precision", "FID"],
        }

    named = [(f"{case.task}: {case.caption[:50]}", case) for case in work]
    result = engine.run(named, setup.rows, summary, {"bench": "progmogen", "cases": work, **settings})
    engine.progress("done", 1.0)
    return result


def _plain(value: float | bool) -> float | bool | None:
    """JSON knows no nan: a figure that is not a number becomes None."""
    return value if isinstance(value, bool) or math.isfinite(value) else None


def _summary(rows: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    """Means over the prompts, with and without control, of all rows and of HSI-1's hard ones."""
    groups: dict[str, Callable[[Mapping[str, Any]], bool]] = {
        "controlled": lambda row: row["controlled"],
        "uncontrolled": lambda row: not row["controlled"],
    }
    if any(row.get("hard") for row in rows):
        groups["controlled_hard"] = lambda row: row["controlled"] and row["hard"]
        groups["uncontrolled_hard"] = lambda row: not row["controlled"] and row["hard"]
    return {name: _means([row for row in rows if chosen(row)]) for name, chosen in groups.items()}


def _means(rows: Sequence[Mapping[str, Any]]) -> dict[str, float | int | None]:
    means: dict[str, float | int | None] = {"prompts": len(rows)}
    for key in (
        "constraint_error_m",
        "constraint_error_cropped_m",
        "skating_ratio",
        "max_acceleration_m_per_frame2",
        "lowest_foot_m",
    ):
        values = [row[key] for row in rows if key in row]
        if values:
            means[key] = None if None in values else sum(values) / len(values)
    outcomes = [row["success"] for row in rows if "success" in row]
    if outcomes:
        means["unsuccess_rate"] = 1 - sum(outcomes) / len(outcomes)
    means["median_seconds"] = float(torch.tensor([row["seconds"] for row in rows]).median())
    return means


COLUMNS = (
    ("constraint_error_m", "constraint error (m)"),
    ("unsuccess_rate", "unsuccess rate"),
    ("skating_ratio", "skating ratio"),
    ("max_acceleration_m_per_frame2", "max. acceleration (m/frame²)"),
    ("lowest_foot_m", "lowest foot joint (m)"),
    ("median_seconds", "median time (s)"),
)
"""Keys and headings of the table that `table` makes."""


def table(result: Mapping[str, Any]) -> list[list[str]]:
    """The summary as rows of text: task, method, prompts, then `COLUMNS`; the published figures beneath each task."""
    lines = []
    for task in (task for task in TASKS if task in result["summary"]):
        for name, means in result["summary"][task].items():
            lines.append([task, name.replace("_", ", "), str(means["prompts"]), *_cells(means)])
        for name, figures in ((name, each[task]) for name, each in PUBLISHED.items()):
            lines.append([task, f"{name} (published)", "544" if task == "hsi1" else "32", *_cells(figures)])
    return lines


def _cells(means: Mapping[str, float | int | None]) -> list[str]:
    return ["" if means.get(key) is None else f"{means[key]:.3f}" for key, _ in COLUMNS]
