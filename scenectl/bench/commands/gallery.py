"""`scenectl bench gallery`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from scenectl.bench.commands.shared import engine_of, loaded, wrote
from scenectl.console.console import bars
from scenectl.console.options import GENERATOR, Generator, Seed, Threads, Weights


def gallery(
    output: Annotated[Path, typer.Option("--output", "-o", help="Folder of the page and its pictures.")],
    task: Annotated[
        list[Path] | None, typer.Option("--task", help="A task file; repeatable. A page of tasks instead of prompts.")
    ] = None,
    samples: Annotated[int | None, typer.Option(min=1, help="Motions of each: 3 of prompts, 4 of tasks.")] = None,
    seed: Seed = 0,
    weights: Weights = "default",
    generator: Generator = GENERATOR,
    threads: Threads = None,
) -> None:
    """A page of prompts with three samples each, good and bad: nothing is picked; or of tasks, each with its best."""
    from scenectl.bench.models.gallery import draw_gallery, draw_tasks
    from scenectl.threads import threads as on_threads

    with on_threads(threads), bars() as tell:
        maker = loaded(generator, weights)
        if task:
            page = draw_tasks(maker, task, output, samples or 4, seed, engine_of(tell))
        else:
            page = draw_gallery(maker, output, samples or 3, seed, engine_of(tell))
    wrote(page)
