"""`scenectl bench progmogen`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from scenectl.cli.bench.shared import measured
from scenectl.cli.console import keep, out, table
from scenectl.cli.options import Generator, Json, Seed, Threads, Weights
from scenes.errors import UserError, did_you_mean

PROMPTS = Path("../shared/data/progmogen.json")


def progmogen(
    prompts: Annotated[Path, typer.Option("--data", help="ProgMoGen's prompts (JSON).")] = PROMPTS,
    task: Annotated[list[str] | None, typer.Option(help="hsi1, hsi2, hsi3; repeat for more. Default: all.")] = None,
    count: Annotated[int | None, typer.Option(min=1, help="Prompts of each task.")] = None,
    seed: Seed = 0,
    weights: Weights = "default",
    generator: Generator = "mscot",
    threads: Threads = None,
    json_file: Json = None,
) -> None:
    """ProgMoGen's HSI-1, HSI-2 and HSI-3, beside the same prompts without control."""
    from scenectl.bench.control.progmogen import COLUMNS, TASKS, bench_progmogen
    from scenectl.bench.control.progmogen import table as lines_of

    chosen = task or list(TASKS)
    for name in chosen:
        if name not in TASKS:
            raise UserError(f"unknown task '{name}'{did_you_mean(name, TASKS)}")
    counts = None if count is None else dict.fromkeys(chosen, count)
    result = measured(
        lambda maker, tell: bench_progmogen(maker, prompts, chosen, counts, seed=seed, progress=tell),
        weights, threads, generator,
    )  # fmt: skip
    lines = table("task", "method", "prompts", *(heading for _, heading in COLUMNS))
    for line in lines_of(result):
        lines.add_row(*line)
    out.print(lines)
    keep(result, json_file)
