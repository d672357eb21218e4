"""From a task to a result: generate under guidance, refine, rank, measure, report.

`run` makes motions for a task, `score` looks at finished ones with the same eyes; `Result.save` writes the files.
"""

from __future__ import annotations

import math
import time
from dataclasses import replace
from typing import Any

from scenectl.control.solvers.problem import Solution
from scenectl.generators import load_generator, registry
from scenectl.generators.base import EditingGenerator, Generator, Progress, silent
from scenectl.measures.metrics import Scorer
from scenectl.pipeline.generation import Made, make
from scenectl.pipeline.going_on import ending, unpadded
from scenectl.pipeline.parts import CONTEXT
from scenectl.pipeline.rank import ranked
from scenectl.pipeline.report import report_of
from scenectl.pipeline.results import Drawer, Result, plain_json
from scenectl.pipeline.search import Search
from scenectl.tasks.schema import Start
from scenectl.tasks.setup import GROUND, Setup, start_of
from scenectl.tasks.task import Task
from scenectl.threads import threads
from scenes.errors import UserError
from scenes.motion.frames import Place
from scenes.motion.motion import Motion, Pose2D
from scenes.motion.rigid import rigid

SAME = 0.01
"""Share by which legs may be longer or shorter than a body's that are still its own: what files round off."""
STANDS = 0.7
"""Metres over an adult's feet from which on a pelvis is that of somebody who stands; straight legs have it at 0.93."""
LEFT_OUT = "the task's start is left out, as the motion goes on from where another ends"


def run(
    task: Task,
    samples: int | None = None,
    seed: int | None = None,
    generator: Generator | None = None,
    progress: Progress | None = None,
    setup: Setup | None = None,
    scorer: Scorer | None = None,
    drawer: Drawer | None = None,
    after: Motion | None = None,
) -> Result:
    """Make motions for a task: those that are met and believable come first, then those that are met, then the rest.

    Each of the three by how little refinement changed poses, and then by cost.

    Args:
        task: from `load_task` or built in Python.
        samples, seed: instead of the task's own.
        generator: instead of loading the one that the task names; benches reuse one.
        progress: called with what is being done and the fraction done.
        setup: the task already built (with the same seed), so that a scene is read once.
        scorer: of the same scene, whatever stands or moves in it, so that its triangles are prepared once.
        drawer: of the preview that `Result.save` writes.
        after: a motion ``[T, J, 3]`` of the task's body, world m, which what is made goes on from; where it ends is the
            task's start.
    """
    if after is not None:
        after = _whole(after, setup)
    left_out = () if after is None or task.start is None else (LEFT_OUT,)
    task = task if after is None else begun_at_end(task, after)
    seed = task.seed if seed is None else seed
    samples = task.samples if samples is None else samples
    if not 0 <= seed < 2**63:
        raise UserError(f"the seed is {seed}; give a whole number from 0 to {2**63 - 1}")
    if not 1 <= samples <= 256:
        raise UserError(f"{samples} samples cannot be made at once; give 1 to 256")
    tell, clock = progress or silent, _Clock()
    tell("reading the scene and planning", 0.0)
    setup = task.build(seed, spec=None if generator is None else generator.spec) if setup is None else setup
    setup = replace(setup, unreached=(*setup.unreached, *left_out)) if left_out else setup
    clock.lap("plan_s")
    tell("loading the generator", 0.0)
    weights = task.generator.weights if generator is None else None
    generator = load_task_generator(task) if generator is None else generator
    clock.lap("load_s")
    with threads(task.generator.threads) as number:  # scenes are baked on all cores, by threads that don't spin
        made = _generated(task, setup, generator, samples, seed, tell, after)
        clock.lap("generate_s")
        tell("measuring", 0.0)
        judge = Scorer(setup.scene, setup.body) if scorer is None else scorer.within(setup.scene)
        motion, rows = ranked(made.motion, made.unrefined, setup, judge, tell)
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
    return Result(setup, motion, rows, {**report_of(setup, rows, motion.fps, number), **facts}, drawer, run)


def begun_at_end(task: Task, motion: Motion) -> Task:
    """A task that starts where a motion ``[T, J, 3]`` ends: on the ground there, as the pelvis faces.

    Raises:
        UserError: a start that is solved for, or a motion of other joints, or of another size than the task's body.
    """
    if isinstance(task.start, Start) and task.start.free:
        raise UserError("a task whose start is free cannot go on from a motion; leave out 'free' of its start")
    body = task.load_body()
    if motion.skeleton.names != body.skeleton.names:
        raise UserError("the motion to go on from has other joints than the task's body; make it with that body")
    size = motion.skeleton.legs / body.skeleton.legs
    if abs(size - 1) > SAME:
        raise UserError(
            f"the motion to go on from has legs {size:.2f} times as long as the task's body; give the task that body"
        )
    end = start_of(motion[-1:], body)
    high = float(motion.joint("pelvis")[-1, 1]) - end.position[1]
    if high < STANDS * body.size:
        raise UserError(
            f"the motion to go on from does not end standing: its pelvis is {high:.2f} m over the feet; let it stand up"
        )
    with task.named():
        return task.model_copy(update={"start": Start(position=_on_ground(task, end), heading=end.heading)})


def _whole(after: Motion, setup: Setup | None) -> Motion:
    """A motion to go on from without its padding; raises UserError for what none can go on from."""
    if setup is not None:
        raise UserError("a task that goes on from a motion is planned from where that ends; leave out 'setup'")
    if after.joints.ndim != 3:
        raise UserError("give one motion to go on from, [T, J, 3], such as result.motion[0]")
    if not bool(after.valid.any()):
        raise UserError("the motion to go on from has no valid frame; 'valid' is true where a frame is real")
    return replace(after, joints=after.joints[after.valid], valid=after.valid[after.valid])


def _on_ground(task: Task, end: Pose2D) -> Place:
    """A place (world, m) on the ground that is nearest under it; itself where there is none."""
    scene = task.load_scene()
    scene = scene.seen_from(task.origin(scene, end))
    (x, y, z), by = end.position, scene.origin
    ground = float(scene.ground_at(x - by[0], z - by[2], y + GROUND - by[1])) + by[1]
    return x, y if math.isnan(ground) else ground, z


def _generated(
    task: Task, setup: Setup, generator: Generator, samples: int, seed: int, tell: Progress, after: Motion | None
) -> Made:
    free = isinstance(task.start, Start) and task.start.free
    if after is not None or (setup.script is not None and isinstance(generator, EditingGenerator)):
        lead = None if after is None else _before(after, setup, generator)
        editor = registry.editing(generator)
        return Search(editor, setup, task.solver, task.guidance, free, samples, seed, tell, lead).run()
    settings: dict[str, Any] = {"solver": task.solver, "guidance": task.guidance, "free_start": free}
    place = setup.seconds, setup.start, setup.objective, setup.context
    return make(generator, setup.prompts, *place, **settings, samples=samples, seed=seed, progress=tell)


def _before(after: Motion, setup: Setup, generator: Generator) -> Motion:
    """The last frames of a motion as a setup sees them, on its body's bones and the generator's clock, up to 0 s."""
    seen = ending(after, generator.spec.fps).seen_from(setup.origin)
    last = unpadded(seen, seen.joints[-CONTEXT:], t0=-min(CONTEXT, seen.frames) / seen.fps)
    return rigid(last, setup.body.skeleton)


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
    return Result(setup, made, rows, {**report_of(setup, rows, batch.fps, number), **facts}, drawer, run)


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
