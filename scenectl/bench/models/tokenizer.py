"""Reconstruction by the tokenizer on test clips."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from scenectl.bench.engine import ENGINE, Engine, Result, Row
from scenectl.data.sources import load_clips
from scenectl.evaluation.sets import Tokenised
from scenectl.generators.base import Generator
from scenectl.training.errors import error_by_source
from scenes.errors import UserError
from scenes.sdf.bake import default_cache


def bench_tokenizer(
    generator: Generator, data: str | Path, frames: tuple[int, ...] = (64, 128, 196), engine: Engine = ENGINE
) -> Result:
    """Mean joint error (m) over the first frames of every test clip that is long enough, by source and length.

    Raises UserError for a generator that has no tokenizer.
    """
    tokens = tokenised(generator)
    test = load_clips(Path(data), ["test"], None, default_cache() / "windows", 0)

    def reconstructed(length: int) -> list[Row]:
        found = error_by_source(tokens.round_trip, test, length)
        return [{"frames": length, "set": name, **figures} for name, figures in found.items()]

    cases = [(f"{length} frames", length) for length in frames]
    return engine.run(cases, reconstructed, _summary, {"bench": "tokenizer", "data": data, "frames": frames})


def tokenised(generator: Generator) -> Tokenised:
    """The generator as one of tokens; raises UserError for one that has no tokenizer."""
    if not isinstance(generator, Tokenised):
        raise UserError(f"generator '{generator.name}' has no tokenizer to measure")
    return generator


def _summary(rows: Sequence[Row]) -> dict[str, Any]:
    return {
        "reconstruction_error_m": _pick(rows, "bandai"),
        "reconstruction_error_other_m": _pick(rows, "other"),
        "reconstruction_error_all_m": _pick(rows, "all"),
        "root_drift_m": _pick(rows, "bandai", "root_drift_m"),
        "root_drift_other_m": _pick(rows, "other", "root_drift_m"),
    }


def _pick(rows: Sequence[Row], name: str, figure: str = "global_error_m") -> float | None:
    """A figure at 64 frames, the paper's setting."""
    found = [row[figure] for row in rows if row["frames"] == 64 and row["set"] == name]
    return found[0] if found else None
