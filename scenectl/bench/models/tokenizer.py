"""Reconstruction by the tokenizer on test clips."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from scenectl.data.sources import load_clips
from scenectl.generators.base import Generator
from scenectl.generators.mscot.sampling import MSCoT
from scenectl.generators.mscot.training.measures import round_trip
from scenectl.training.errors import error_by_source
from scenes.errors import UserError
from scenes.sdf.bake import default_cache


def bench_tokenizer(generator: Generator, data: str | Path, frames: tuple[int, ...] = (64, 128, 196)) -> dict[str, Any]:
    """Mean joint error (m) over the first frames of every test clip that is long enough, by source and length.

    Raises UserError for a generator that has no tokenizer.
    """
    if not isinstance(generator, MSCoT):
        raise UserError(f"generator '{generator.name}' has no tokenizer to measure")
    tokenizer = generator.bundle.tokenizer
    test = load_clips(Path(data), ["test"], None, default_cache() / "windows", 0)
    rows = [
        {"frames": length, "set": name, **figures}
        for length in frames
        for name, figures in error_by_source(round_trip(tokenizer), test, length).items()
    ]
    summary = {
        "reconstruction_error_m": _pick(rows, "bandai"),
        "reconstruction_error_other_m": _pick(rows, "other"),
        "reconstruction_error_all_m": _pick(rows, "all"),
        "root_drift_m": _pick(rows, "bandai", "root_drift_m"),
        "root_drift_other_m": _pick(rows, "other", "root_drift_m"),
    }
    return {"summary": summary, "rows": rows}


def _pick(rows: list[dict[str, Any]], name: str, figure: str = "global_error_m") -> float | None:
    """A figure at 64 frames, the paper's setting."""
    found = [row[figure] for row in rows if row["frames"] == 64 and row["set"] == name]
    return found[0] if found else None
