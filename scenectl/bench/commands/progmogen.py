"""`scenectl bench progmogen`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from scenectl.bench.commands.shared import measured, shown, wrote
from scenectl.console.console import out, table
from scenectl.console.options import Generators, Json, Seed, Shard, Threads, Weights
from scenes.errors import UserError, did_you_mean

PROMPTS = Path("../shared/data/progmogen.json")


def progmogen(
    prompts: Annotated[Path, typer.Option("--data", help="ProgMoGen's prompts (JSON).")] = PROMPTS,
    task: Annotated[list[str] | None, typer.Option(help="hsi1, hsi2, hsi3; repeat for more. Default: all.")] = None,
    count: Annotated[int | None, typer.Option(min=1, help="Prompts of each task.")] = None,
    seed: Seed = 0,
    weights: Weights = "default",
    generator: Generators = None,
    threads: Threads = None,
    json_file: Json = None,
    shard: Shard = None,
) -> None:
    """ProgMoGen's HSI-1, HSI-2 and HSI-3, beside the same prompts without control."""
    from scenectl.bench.control.progmogen import COLUMNS, TASKS, bench_progmogen, table as lines_of

    chosen = task or list(TASKS)
    for name in chosen:
        if name not in TASKS:
            raise UserError(f"unknown task '{name}'{did_you_mean(name, TASKS)}")
    counts = None if count is None else dict.fromkeys(chosen, count)
    result = measured(
        lambda maker, engine: bench_progmogen(maker, prompts, chosen, counts, seed=seed, engine=engine),
        weights, threads, generator, json_file, shard,
    )  # fmt: skip
    if "settings" not in result["summary"]:  # several generators, or cases that other shards measure
        shown(result, json_file, ("task", "index", "controlled", "constraint_error_m", "success", "seconds"))
        return
    lines = table("task", "method", "prompts", *(heading for _, heading in COLUMNS))
    for line in lines_of(result):
        lines.add_row(*line)
    out.print(lines)
    wrote(json_file)
