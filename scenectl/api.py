"""Runs and scores as `import scenectl` offers them: with a preview that `Result.save` draws."""

from __future__ import annotations

from pathlib import Path

from scenectl.generators.base import Generator, Progress
from scenectl.pipeline import run as pipeline
from scenectl.pipeline.results import Result
from scenectl.tasks.task import Task
from scenes.motion.motion import Motion


def run(
    task: Task,
    samples: int | None = None,
    seed: int | None = None,
    generator: Generator | None = None,
    progress: Progress | None = None,
) -> Result:
    """Make motions for a task, the best first; see `scenectl.pipeline.run.run`."""
    return pipeline.run(task, samples, seed, generator, progress, drawer=draw)


def score(motion: Motion, task: Task, progress: Progress | None = None) -> Result:
    """Report on finished motions; see `scenectl.pipeline.run.score`."""
    return pipeline.score(motion, task, progress, drawer=draw)


def draw(result: Result, png: Path) -> None:
    """The preview of a result."""
    from scenectl.view import draw_result  # VTK takes a second to import

    draw_result(result, png)
