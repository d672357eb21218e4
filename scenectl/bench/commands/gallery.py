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
    samples: Annotated[int, typer.Option(min=1, help="Motions of each prompt.")] = 3,
    seed: Seed = 0,
    weights: Weights = "default",
    generator: Generator = GENERATOR,
    threads: Threads = None,
) -> None:
    """A page of prompts with three samples each, good and bad: nothing is picked."""
    from scenectl.bench.models.gallery import draw_gallery
    from scenectl.threads import threads as on_threads

    with on_threads(threads), bars() as tell:
        page = draw_gallery(loaded(generator, weights), output, samples, seed, engine_of(tell))
    wrote(page)
