"""Where a tokenizer loses movement: by band of frequency, through each part of what codes a motion."""

from __future__ import annotations

import statistics
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import torch

from scenectl.bench.engine import ENGINE, Engine, Row
from scenectl.bench.models.tokenizer import tokenised
from scenectl.data.clips import beginnings
from scenectl.data.features import on_body
from scenectl.data.sources import load_clips
from scenectl.evaluation.kinds import Confusion, KindClassifier
from scenectl.evaluation.sets import HeldOut, reconstructed
from scenectl.generators.base import Generator
from scenectl.measures.metrics import max_acceleration
from scenectl.measures.plausibility import acceleration
from scenectl.training.errors import QUICK, RoundTrip, error_by_source, joints_after, kept_by_band, power_above
from scenes.sdf.bake import default_cache

FRAMES = 64
"""Over which errors and bands are taken, as the paper and the cards do."""
SEEN = 2048
"""Windows of training whose principal components are taken, as many as a shortcut starts at."""
OVER_REAL = ("acceleration", "max_acceleration", "power")
"""Figures that are compared with those of real motions."""


def bench_lost(
    generator: Generator, classifier: KindClassifier, data: str | Path, engine: Engine = ENGINE
) -> list[Row]:
    """A row for real motions, then one for each of the generator's partial round trips (`Tokenised.round_trips`).

    Errors (m) and bands are those of the first `FRAMES` frames of each test clip; accelerations, power and recall those
    of all test clips as the generator's evaluation takes them.

    Args:
        generator: of tokens.
        classifier: of kinds of motion, frozen.
        data: folder of motions, of which the training split is read, too.
        engine: tells progress, keeps rows and goes on from them.

    Raises:
        UserError: the generator has no tokenizer.
    """
    tokens = tokenised(generator)
    test, train = (load_clips(Path(data), [split], None, default_cache() / "windows", 0) for split in ("test", "train"))
    seen = train.draw(FRAMES, SEEN, torch.Generator().manual_seed(0)).features
    clips, short = HeldOut.of(test, generator.spec, 0), beginnings(test, FRAMES)

    def measured(case: tuple[str, RoundTrip]) -> list[Row]:
        name, round_trip = case
        errors = error_by_source(round_trip, test, FRAMES)
        motions = reconstructed(clips, round_trip)
        kinds = Confusion.of(clips.kinds, classifier.predict(motions.features))
        return [
            {
                "through": name,
                **{
                    f"{figure.removesuffix('_m')}_{source}_m": errors.get(source, {}).get(figure)
                    for source in ("bandai", "other")
                    for figure in ("global_error_m", "local_error_m")
                },
                "kept": kept_by_band(*joints_after(round_trip, short)),
                "acceleration": float(acceleration(motions.padded).mean()),
                "max_acceleration": float(max_acceleration(motions.padded).mean()),
                "power": statistics.fmean(power_above(joints[None], QUICK) for joints in motions.joints),
                "recall": kinds.macro_recall if kinds.recall() else None,  # too few clips of any kind
                "recall_of_waves": kinds.recall_of(kind for kind in kinds.kinds if "wave" in kind),
            }
        ]

    trips: dict[str, RoundTrip] = {"real": on_body, **tokens.round_trips(seen)}
    cases = [(f"through: {name}", (name, round_trip)) for name, round_trip in trips.items()]
    rows: Sequence[Row] = engine.run(cases, measured, lambda rows: {}, {"bench": "lost", "data": data})["rows"]
    return [_beside(rows[0], row) for row in rows]


def _beside(real: Mapping[str, Any], row: Row) -> Row:
    """A row with its figures over the real ones."""
    ratios = {f"{name}_over_real": row[name] / real[name] if real[name] else None for name in OVER_REAL}
    return {key: value for key, value in row.items() if key not in OVER_REAL} | ratios
