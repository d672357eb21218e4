"""`scenectl bench sentences`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from scenectl.bench.commands.shared import criteria_shown, measured, shown
from scenectl.console.options import DATA, Data, Generators, Json, Seed, Shard, Threads, Weights


def sentences(
    file: Annotated[
        Path | None, typer.Option(help="Sentences and timelines (TOML). Default: the 50 and 12 that ship.")
    ] = None,
    data: Data = DATA,
    samples: Annotated[int, typer.Option(min=1, help="Motions of each.")] = 2,
    acts: Annotated[Path | None, typer.Option(help="Folder of the second classifier, instead of ours.")] = None,
    seed: Seed = 0,
    weights: Weights = "default",
    generator: Generators = None,
    threads: Threads = None,
    json_file: Json = None,
    shard: Shard = None,
) -> None:
    """Sentences of several acts, and sentences with their own times: is each act there, beside recorded motions?"""
    from scenectl.bench.models.sentences import bench_sentences
    from scenectl.evaluation import SHIPPED
    from scenectl.evaluation.kinds import ACTS, load_classifier

    classifier = load_classifier(acts or SHIPPED, ACTS)
    result = measured(
        lambda maker, engine: bench_sentences(maker, classifier, data, file, samples, seed, engine),
        weights, threads, generator, json_file, shard,
    )  # fmt: skip
    shown(result, json_file, ("set", "text", "recognised", "by_chance", "seam_ratio"))
    criteria_shown(result)
