"""`scenectl bench tokenizer`."""

from __future__ import annotations

from scenectl.cli.console import show
from scenectl.cli.options import DATA, Data, Json, Weights


def tokenizer(data: Data = DATA, weights: Weights = "default", json_file: Json = None) -> None:
    """Reconstruction of test motions by the tokenizer."""
    from scenectl.bench.models.tokenizer import bench_tokenizer

    show(bench_tokenizer(weights, data), json_file)
