"""From a task to a result: generate under guidance, refine, rank, measure, report.

`run` makes motions for a task, `score` looks at finished ones with the same eyes; `Result.save` writes the files.
"""

from __future__ import annotations

import time
from dataclasses import replace
from typing import Any

from scenectl.control.solvers.problem import Solution
from scenectl.generators import load_generator
from scenectl.generators.base import Editor, Generator, Progress, silent
from scenectl.measures.metrics import Scorer
from scenectl.pipeline.generation import Made, make
from scenectl.pipeline.rank import ranked
from scenectl.pipeline.report import report_of
from scenectl.pipeline.results import Drawer, Result, plain_json
from scenectl.pipeline.search import Search
from scenectl.tasks.schema import Start
from scenectl.tasks.setup import Setup, start_of
from scenectl.tasks.task import Task
from scenectl.threads import threads
from scenes.errors import UserError
from scenes.motion.motion import Motion


def run(
    task: Task,
    samples: int | None = None,
    seed: int | None = None,
    generator: Generator | None = None,
    progress: Progress | None = None,
    setup: Setup | None = None,
    scorer: Scorer | None = None,
    drawer: Drawer | None = None,
) -> Result:
    """Make motions for a task: those that are met and believable come first, then those that are met, then the rest.

    Each of the three by how little refinement changed poses, and then by cost.

    Args:
        task: from `load_task` or built in Python.
        samples, seed: instead of the task's own.
        generator: instead of loading the one that the task names; benches reuse one.
        progress: called with what is being done and the fraction done.
        setup: the task already built (with the same seed), so that a scene is read once.
        scorer: of the same scene, so that its triangles are prepared once.
        drawer: of the preview that `Result.save` writes.
    """
    seed = task.seed if seed is None else seed
    samples = task.samples if samples is None else samples
    if not 0 <= seed < 2**63:
        raise UserError(f"the seed is {seed}; give a whole number from 0 to {2**63 - 1}")
    if not 1 <= samples <= 256:
        raise UserError(f"{samples} samples cannot be made at once; give 1 to 256")
    tell, clock = progress or silent, _Clock()
    tell("reading the scene and planning", 0.0)
    setup = task.build(seed, spec=None if generator is None else generator.spec) if setup is None else setup
    clock.lap("plan_s")
    tell("loading the generator", 0.0)
    weights = task.generator.weights if generator is None else None
    generator = load_task_generator(task) if generator is None else generator
    clock.lap("load_s")
    with threads(task.generator.threads) as number:  # scenes are baked on all cores, by threads that don't spin
        made = _generated(task, setup, generator, samples, seed, tell)
        clock.lap("generate_s")
        tell("measuring", 0.0)
        motion, rows = ranked(made.motion, made.unrefined, setup, scorer or Scorer(setup.scene, setup.body), tell)
        clock.lap("measure_s")
    facts = {
        "seed": seed,
        "generator": {
            "name": generator.name,
            "weights": None if weights is None else str(weights),
            "licence": generator.licence,
            "trace": plain_json(made.trace),
        },
        "refinement": _refinement(made.solution),
        "timing": clock.laps,
    }
    return Result(setup, motion, rows, {**report_of(setup, rows, motion.fps, number), **facts}, drawer)


def _generated(task: Task, setup: Setup, generator: Generator, samples: int, seed: int, tell: Progress) -> Made:
    free = isinstance(task.start, Start) and task.start.free
    if setup.script is not None and isinstance(generator, Editor):
        return Search(generator, setup, task.solver, task.guidance, free, samples, seed, tell).run()
    settings: dict[str, Any] = {"solver": task.solver, "guidance": task.guidance, "free_start": free}
    place = setup.seconds, setup.start, setup.objective, setup.context
    return make(generator, setup.prompts, *place, **settings, samples=samples, seed=seed, progress=tell)


def _refinement(found: Solution | None) -> dict[str, Any] | None:
    """Which solver refined, at what price, and why it ended for each of the generator's samples."""
    return None if found is None else {"solver": found.solver, "passes": found.evaluations, "ended": found.reasons}


def score(
    motion: Motion,
    task: Task,
    progress: Progress | None = None,
    drawer: Drawer | None = None,
    setup: Setup | None = None,
) -> Result:
    """Report on finished motions, ``[T, J, 3]`` or ``[S, T, J, 3]``, ranked as `run` ranks them.

    The start is taken from the first motion's first frame, so that a walk is planned from where it began. Raises
    UserError when the task asks for something at a time that the motion does not reach, and for a motion without a
    valid frame. `setup` is the task already built and checked for such motions, so that a scene is read once.
    """
    tell = progress or silent
    tell("reading the scene and planning", 0.0)
    batch = motion if motion.joints.ndim == 4 else replace(motion, joints=motion.joints[None], valid=motion.valid[None])
    if not batch.valid.any(-1).all():
        raise UserError("the motion has a sample of which no frame is valid; 'valid' is true where a frame is real")
    if task.seconds is None:  # it followed from the path; now it is known
        task = task.model_copy(update={"seconds": batch.seconds})
    if setup is None:
        with task.named():
            setup = task.build(start=start_of(batch[0], task.load_body()))
            setup.objective.check(setup.context, batch.seconds, batch.fps, batch.t0)
    seen = batch.seen_from(setup.origin)
    with threads(task.generator.threads) as number:
        made, rows = ranked(seen, None, setup, Scorer(setup.scene, setup.body), tell)
    facts: dict[str, Any] = {"seed": task.seed, "generator": None, "refinement": None, "timing": {}}
    return Result(setup, made, rows, {**report_of(setup, rows, batch.fps, number), **facts}, drawer)


def load_task_generator(task: Task) -> Generator:
    """The generator that a task names, with its weights."""
    spec = task.generator
    return load_generator(spec.name, spec.weights, **spec.settings.model_dump(exclude_unset=True))


class _Clock:
    """Wall time between laps, seconds."""

    def __init__(self) -> None:
        self.laps: dict[str, float] = {}
        self._last = time.perf_counter()

    def lap(self, name: str) -> None:
        now = time.perf_counter()
        self.laps[name] = round(now - self._last, 3)
        self._last = now
