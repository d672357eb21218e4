"""From a task to files: generate under guidance, rank, measure, report.

`run` makes motions for a task, `score` looks at a finished one with the same eyes, and `Result.save` writes
`motion.npz`, `report.json` and `preview.png`.
"""

from __future__ import annotations

import importlib.util
import json
import time
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

import scenectl
from objectives import TermReport, diagnosis
from scenectl.control import FreeStart, ObjectiveGuide
from scenectl.generators.base import Generation, Generator, Progress
from scenectl.measures.metrics import Scorer, measure, pose_change
from scenectl.tasks.schema import FPS, Problem, Start, Task, start_of
from scenes.errors import UserError
from scenes.files import atomic_write
from scenes.motion.motion import Motion, Pose2D
from scenes.world.floor.polyline import path_length

FORMAT = 1
"""Version of report.json."""


@dataclass(frozen=True)
class Sample:
    """One motion of a result.

    Attributes:
        index: which of the generator's samples it was.
        cost: of the objective.
        terms: how well each goal is met.
        metrics: see `scenectl.measures.metrics.measure`.
        unrefined_cost: of the objective before refinement, or None.
        diagnosis: why goals aren't met, in a sentence (`objectives.diagnosis`); None where they are.
        start: where it begins, which differs from the problem's where that was solved for.
        pose_change: metres by which refinement moved joints as seen from the pelvis, in the mean; None without one.
    """

    index: int
    cost: float
    terms: list[TermReport]
    metrics: dict[str, float | str | None]
    unrefined_cost: float | None = None
    diagnosis: str | None = None
    start: Pose2D | None = None
    pose_change: float | None = None

    @property
    def met(self) -> bool:
        """Every goal is met within its tolerance."""
        return all(term.met for term in self.terms)


@dataclass(frozen=True)
class Result:
    """What a run made, the best sample first.

    Attributes:
        problem: the task as it was planned.
        motion: world coordinates, ``[S, T, J, 3]`` metres.
        samples: a row for each motion, in the same order.
        report: everything that report.json holds.
    """

    problem: Problem
    motion: Motion
    samples: list[Sample]
    report: dict[str, Any] = field(repr=False)

    def save(self, folder: str | Path, preview: bool = True) -> Path:
        """Write `motion.npz`, `report.json` and, where pictures can be drawn, `preview.png`.

        Each file is whole or absent. Returns the folder; raises UserError when it cannot be written.
        """
        folder = Path(folder)
        facts: dict[str, int | str] = {"seed": int(self.report["seed"]), "unit": "m"}
        maker = self.report["generator"]
        if maker is not None:  # the weights' terms follow what they make wherever the file goes
            facts["licence"] = str(maker["licence"])
        self.motion.save(folder / "motion.npz", **facts)
        with atomic_write(folder / "report.json", "w") as file:
            json.dump(self.report, file, indent=1, allow_nan=False)
        if preview:
            from scenectl.view import draw_result  # VTK takes a second to import

            draw_result(self, folder / "preview.png")
        return folder


def run(
    task: Task,
    samples: int | None = None,
    seed: int | None = None,
    generator: Generator | None = None,
    progress: Progress | None = None,
    problem: Problem | None = None,
    scorer: Scorer | None = None,
) -> Result:
    """Make motions for a task, ranked by the objective's cost.

    Args:
        task: from `load_task` or built in Python.
        samples, seed: instead of the task's own.
        generator: instead of loading the one that the task names; benches reuse one.
        progress: called with what is being done and the fraction done.
        problem: the task already built (with the same seed), so that a scene is read once.
        scorer: of the same scene, so that its triangles are prepared once.
    """
    seed = task.seed if seed is None else seed
    samples = task.samples if samples is None else samples
    if not 0 <= seed < 2**63:
        raise UserError(f"the seed is {seed}; give a whole number from 0 to {2**63 - 1}")
    if not 1 <= samples <= 256:
        raise UserError(f"{samples} samples cannot be made at once; give 1 to 256")
    tell = progress or _silent
    clock = _Clock()
    tell("reading the scene and planning", 0.0)
    problem = task.build(seed) if problem is None else problem
    clock.lap("plan_s")
    tell("loading the generator", 0.0)
    weights = task.generator.weights if generator is None else None
    generator = load_task_generator(task) if generator is None else generator
    clock.lap("load_s")
    free = isinstance(task.start, Start) and task.start.free
    unknown = FreeStart(problem.start.position) if free else None
    guide = ObjectiveGuide(problem.objective, problem.context, task.solver, task.guidance, progress, unknown)
    made = generator.generate(
        task.prompt,
        problem.seconds,
        problem.start,
        guide if problem.objective.counted else None,
        samples,
        seed,
        progress,
    )
    clock.lap("generate_s")
    tell("measuring", 0.0)
    motion, rows = _ranked(made, problem, scorer or Scorer(problem.scene, problem.body), tell)
    clock.lap("measure_s")
    facts = {
        "seed": seed,
        "generator": {
            "name": generator.name,
            "weights": None if weights is None else str(weights),
            "licence": generator.licence,
            "trace": _json(made.trace),
        },
        "refinement": _refinement(guide),
        "timing": clock.laps,
    }
    return Result(problem, motion, rows, {**_report(problem, rows), **facts})


def _refinement(guide: ObjectiveGuide) -> dict[str, Any] | None:
    """Which solver refined, at what price, and why it ended for each of the generator's samples."""
    found = guide.solution
    return None if found is None else {"solver": found.solver, "passes": found.evaluations, "ended": found.reasons}


def score(motion: Motion, task: Task, progress: Progress | None = None) -> Result:
    """Report on finished motions, ``[T, J, 3]`` or ``[S, T, J, 3]``, ranked as `run` ranks them.

    The start is taken from the first motion's first frame, so that a walk is planned from where it began. Raises
    UserError when the task asks for something at a time that the motion does not reach.
    """
    tell = progress or _silent
    tell("reading the scene and planning", 0.0)
    batch = motion if motion.joints.ndim == 4 else replace(motion, joints=motion.joints[None], valid=motion.valid[None])
    if task.seconds is None:  # it followed from the path; now it is known
        task = task.model_copy(update={"seconds": batch.seconds})
    problem = task.build(start=start_of(batch[0], task.load_body()))
    problem.objective.check(problem.context, batch.seconds, batch.fps, batch.t0)
    made, rows = _ranked(Generation(batch), problem, Scorer(problem.scene, problem.body), tell)
    return Result(
        problem,
        made,
        rows,
        {**_report(problem, rows), "seed": task.seed, "generator": None, "refinement": None, "timing": {}},
    )


def load_task_generator(task: Task) -> Generator:
    """The generator that a task names, with its weights."""
    from scenectl.generators import load_generator

    spec = task.generator
    sampling = spec.model_dump(exclude={"name", "weights", "threads"}, exclude_none=True)
    return load_generator(spec.name, spec.weights, spec.threads, **sampling)


def allow_code(path: str | Path) -> list[str]:
    """Run a Python file whose `@goal` functions shall be known to tasks; returns the names it added.

    The only way in which scenectl runs a user's code: task files are data.
    """
    from objectives import goals

    path = Path(path)
    if not path.is_file():
        raise UserError(f"code file '{path}' does not exist")
    before = {spec.name for spec in goals()}
    spec = importlib.util.spec_from_file_location(f"scenectl_allowed_{path.stem}", path)
    if spec is None or spec.loader is None:
        raise UserError(f"code file '{path}' is not a Python file")
    try:
        spec.loader.exec_module(importlib.util.module_from_spec(spec))
    except UserError as error:
        raise UserError(f"code file '{path}': {error}") from error
    except Exception as error:
        raise UserError(f"code file '{path}' failed: {type(error).__name__}: {error}") from error
    return sorted({spec.name for spec in goals()} - before)


def load_result(folder: str | Path) -> tuple[Motion, dict[str, Any]]:
    """Motions ``[S, T, J, 3]`` and report of a folder that `run` wrote; raises UserError for anything else."""
    folder = Path(folder)
    motion = Motion.load(folder / "motion.npz")
    try:
        report = json.loads((folder / "report.json").read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise UserError(f"'{folder / 'report.json'}' cannot be read ({error}); run the task again") from error
    if not isinstance(report, dict) or report.get("format") != FORMAT or not isinstance(report.get("task"), dict):
        raise UserError(f"'{folder / 'report.json'}' is not a report of this version of scenectl; run the task again")
    return motion, report


def _ranked(made: Generation, problem: Problem, scorer: Scorer, tell: Progress) -> tuple[Motion, list[Sample]]:
    """Motions and their rows: those that meet all goals first, by how little refinement changed poses; then by cost.

    A cost that is not a number comes last.
    """
    objective, context = problem.objective, problem.context
    with torch.no_grad():
        costs = objective.cost(made.motion, context)
        before = None if made.unrefined is None else objective.cost(made.unrefined, context)
        changes = None if made.unrefined is None else pose_change(made.unrefined, made.motion)
    met = objective.met(made.motion, context).tolist()

    def badness(i: int) -> tuple[bool, float, float]:
        change = 0.0 if changes is None or not met[i] else round(float(changes[i]), 3)
        return not met[i], change, float(costs[i].nan_to_num(nan=torch.inf))

    order = sorted(range(len(met)), key=badness)
    terms = objective.report(made.motion, context)
    rows = []
    for done, index in enumerate(order):
        figures = measure(made.motion[index], scorer)
        why = diagnosis(objective, made.motion[index], context)
        start = start_of(made.motion[index], problem.body)
        change, cost = _of(changes, index), _number(costs[index])
        rows.append(Sample(index, cost, terms[index], figures, _of(before, index), why, start, change))
        tell("measuring", (done + 1) / len(order))
    return replace(made.motion, joints=made.motion.joints[order], valid=made.motion.valid[order]), rows


def _of(figures: Float[Tensor, " S"] | None, index: int) -> float | None:
    return None if figures is None else _number(figures[index])


def _report(problem: Problem, rows: list[Sample]) -> dict[str, Any]:
    """What happened, for JSON: metres, seconds and radians throughout."""
    scene, body, path = problem.scene, problem.body, problem.path
    return {
        "format": FORMAT,
        "scenectl": scenectl.__version__,
        "prompt": problem.task.prompt,
        "seconds": problem.seconds,
        "fps": FPS,
        "start": {"position": list(problem.start.position), "heading": problem.start.heading},
        "walk": None if path is None else {"path": _json(path.round(4)), "length_m": path_length(path)},
        "scene": {
            "name": scene.name,
            "digest": scene.digest,
            "floor_m": scene.floor.height,
            "floor_found": scene.floor.found,
            "bake": scene.report(),
        },
        "body": {"source": body.source, "sole_offset_m": body.sole_offset, "radii": body.table()},
        "samples": [_row(rank, row) for rank, row in enumerate(rows)],
        "task": _json(problem.task.dump()),
    }


def _row(rank: int, row: Sample) -> dict[str, Any]:
    return {
        "rank": rank,
        "sample": row.index,
        "cost": row.cost,
        "unrefined_cost": row.unrefined_cost,
        "pose_change_m": row.pose_change,
        "met": row.met,
        "diagnosis": row.diagnosis,
        "start": row.start and {"position": list(row.start.position), "heading": row.start.heading},
        "terms": [term.as_dict() for term in row.terms],
        "metrics": _json(row.metrics),
    }


def _number(value: Tensor) -> float:
    return float(value.nan_to_num(nan=1e30, posinf=1e30))


def _json(value: Any) -> Any:
    """Plain JSON values; what is not finite becomes None, what JSON does not know becomes text."""
    if isinstance(value, Tensor):
        value = value.detach().cpu().numpy()
    if isinstance(value, np.ndarray | np.generic):
        value = value.tolist()
    if isinstance(value, dict):
        return {str(key): _json(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_json(item) for item in value]
    if isinstance(value, float):
        return value if np.isfinite(value) else None
    return value if value is None or isinstance(value, bool | int | str) else str(value)


class _Clock:
    """Wall time between laps, seconds."""

    def __init__(self) -> None:
        self.laps: dict[str, float] = {}
        self._last = time.perf_counter()

    def lap(self, name: str) -> None:
        now = time.perf_counter()
        self.laps[name] = round(now - self._last, 3)
        self._last = now


def _silent(what: str, fraction: float) -> None:
    """Progress for nobody."""
