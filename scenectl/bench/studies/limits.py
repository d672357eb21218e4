"""What people stay within: quantiles of what checks measure on recorded motion."""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import torch

from scenectl.bench.engine import ENGINE, Engine, Result, Row
from scenectl.bench.studies.recordings import FLOOR, floor_known, on_floor, recordings
from scenectl.data.corpus import Clip
from scenectl.measures.believability.checks import CHECKS
from scenectl.measures.believability.checks.tempo import features, rates, windows
from scenectl.measures.believability.evidence import Evidence
from scenectl.measures.metrics import Scorer
from scenes.files import atomic_write
from scenes.motion.motion import Motion

RATES = (0.6, 0.8, 1.0, 1.25, 1.6, 2.0, 2.5)
"""Rates at which recordings are played to learn what a rate looks like."""
RIDGE = 1.0
MEASURED = tuple(check for check in CHECKS if check.limit is None)


def bench_limits(data: str | Path, engine: Engine = ENGINE) -> Result:
    """Fit the check `tempo`, and measure all checks without a stated limit on training clips.

    Beside climbing, sitting, lying and acrobatics clips are left out that are no sound recordings (`_sound`).

    Args:
        data: folder of the motion collection.
        engine: tells progress, keeps rows and goes on from them.

    Returns:
        ``{"summary", "rows", "stored"}``, a row for each check; `stored` is what `limits.json` holds.
    """
    clips = [clip for clip in recordings(data, "train") if _sound(clip)]
    scorer = Scorer(FLOOR)
    weights = _fitted(clips, scorer)

    def measure(clip: Clip) -> list[Row]:
        evidence = Evidence.of(on_floor(clip), scorer, clip.captions[0] if clip.captions else "")
        found = {check.name: check.look(evidence) for check in MEASURED if check.name != "tempo"}
        values = {name: None if one is None else one.value for name, one in found.items()}
        return [{"id": clip.id, **values, "tempo": float(max(rates(evidence, weights), default=np.nan))}]

    result = engine.run(
        [("limits", clip) for clip in clips], measure, lambda rows: {"clips": len(rows)}, {"bench": "limits"}
    )
    if "left" in result:
        return result
    rows = _rows(result["rows"])
    summary = {
        "clips": len(clips),
        "hours": sum(clip.frames for clip in clips) / 20 / 3600,
        "sources": dict(Counter(f"{clip.source} ({clip.licence})" for clip in clips)),
    }
    about = {
        "command": "scenectl bench limits --data DIR --write FILE",
        "source": "training split of the shared motion collection; figures computed from it, none of its motions",
        **summary,
    }
    checks = {row["check"]: {k: row[k] for k in ("limit", "unit", "quantile", "clips")} for row in rows}
    return {"summary": summary, "rows": rows, "stored": {"about": about, "checks": checks, "tempo": list(weights)}}


def _sound(clip: Clip) -> bool:
    """False for what was drawn by hand, has no floor that fits, or plays at another speed than it was captured at.

    The last are CMU's salsa dances: `tempo`, fitted without them, takes them for 2.2 times as fast in the median of 22,
    and their median fastest turn is 850 degrees/s.
    """
    return clip.source != "mesh2motion" and not clip.id.startswith("salsa") and floor_known(clip)


def write(stored: Mapping[str, Any], file: Path) -> None:
    """Write `limits.json`, figures to four digits."""
    stored = {**stored, "tempo": [float(f"{weight:.4g}") for weight in stored["tempo"]]}
    for row in stored["checks"].values():
        row["limit"] = float(f"{row['limit']:.4g}")
    with atomic_write(file, "w") as out:
        json.dump(stored, out, indent=1, ensure_ascii=False)
        out.write("\n")


def _rows(found: Sequence[Mapping[str, Any]]) -> list[Row]:
    rows = []
    for check in MEASURED:
        values = np.array([row[check.name] for row in found if row[check.name] is not None], dtype=np.float64)
        values = values[np.isfinite(values)]
        if not len(values):
            continue  # a collection without gaits has no tempo
        share = 1 - check.share if check.least else check.share
        rows.append({
            "check": check.name,
            "unit": check.unit,
            "limit": float(np.quantile(values, share)),
            "quantile": round(share, 4),
            "clips": len(values),
            **{f"q{q:g}": float(np.quantile(values, q / 100)) for q in (50, 95, 99, 99.5, 99.9)},
        })  # fmt: skip
    return rows


def _fitted(clips: Sequence[Clip], scorer: Scorer) -> np.ndarray:
    """Bias and weights of `tempo`: log2 of the rate by ridge regression on standardised features."""
    seen, wanted = [], []
    for clip in clips:
        motion = on_floor(clip)
        for rate in RATES:
            evidence = Evidence.of(played(motion, rate), scorer)
            of_clip = windows(evidence)[::2]
            seen += [features(evidence, *window) for window in of_clip]
            wanted += [np.log2(rate)] * len(of_clip)
    table, target = np.array(seen), np.array(wanted)
    mean, spread = table.mean(axis=0), np.maximum(table.std(axis=0), 1e-6)
    scaled = (table - mean) / spread
    slopes = np.linalg.solve(scaled.T @ scaled + RIDGE * np.eye(scaled.shape[1]), scaled.T @ (target - target.mean()))
    slopes = slopes / spread
    return np.concatenate([[target.mean() - mean @ slopes], slopes])


def played(motion: Motion, rate: float) -> Motion:
    """The motion at `rate` times its speed, along cubic splines through its frames."""
    if rate == 1.0:
        return motion
    from scipy.interpolate import CubicSpline

    joints = CubicSpline(np.arange(motion.frames), motion.joints.numpy())(np.arange(0, motion.frames - 1 + 1e-9, rate))
    return Motion(torch.from_numpy(joints), fps=motion.fps)
