"""`scenectl bench tokenizer`."""

from __future__ import annotations

from scenectl.bench.commands.shared import measured, shown
from scenectl.console.options import DATA, Data, Generators, Json, Threads, Weights


def tokenizer(
    data: Data = DATA,
    weights: Weights = "default",
    generator: Generators = None,
    threads: Threads = None,
    json_file: Json = None,
) -> None:
    """Reconstruction of test motions by the tokenizer."""
    from scenectl.bench.models.tokenizer import bench_tokenizer

    result = measured(
        lambda maker, engine: bench_tokenizer(maker, data, engine=engine), weights, threads, generator, json_file
    )
    shown(result, json_file)
