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
from scenectl.measures.believability.checks.tempo import features, seeming, windows
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
    scorer, says = Scorer(FLOOR), _says(clips)
    weights = _fitted(clips, scorer, says)

    def measure(clip: Clip) -> list[Row]:
        evidence = Evidence.of(on_floor(clip), scorer, clip.captions[0] if clip.captions else "")
        found = {check.name: check.look(evidence) for check in MEASURED if check.name != "tempo"}
        values = {name: None if one is None else one.value for name, one in found.items()}
        rate = seeming(evidence, weights)
        return [{"id": clip.id, "says": says[clip.source], **values, "tempo": None if rate is None else rate[0]}]

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


def _says(clips: Sequence[Clip]) -> dict[str, float]:
    """What a clip of each source counts: one by the root of their number, so that many that are alike don't outvote all
    others. Of the shared collection Bandai's are five of six, and say half."""
    return {source: count**-0.5 for source, count in Counter(clip.source for clip in clips).items()}


def _sound(clip: Clip) -> bool:
    """False for what was drawn by hand, has no floor that fits, or plays at another speed than it was captured at.

    The last are CMU's salsa dances: `tempo`, fitted without them, takes them for 2.1 times as fast in the median of 22,
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
        measured = [(row[check.name], row["says"]) for row in found if row[check.name] is not None]
        values, says = np.array(measured, dtype=np.float64).reshape(-1, 2).T
        if not len(values):
            continue  # a collection without gaits has no tempo
        share = 1 - check.share if check.least else check.share
        rows.append({
            "check": check.name,
            "unit": check.unit,
            "limit": _quantile(values, says, share),
            "quantile": round(share, 4),
            "clips": len(values),
            **{f"q{q:g}": _quantile(values, says, q / 100) for q in (50, 95, 99, 99.5, 99.9)},
        })  # fmt: skip
    return rows


def _quantile(values: np.ndarray, says: np.ndarray, share: float) -> float:
    """What so much of the weight is at or below."""
    order = values.argsort()
    total = says[order].cumsum()
    return float(values[order[min(int(np.searchsorted(total, share * total[-1])), len(order) - 1)]])


def _fitted(clips: Sequence[Clip], scorer: Scorer, says: Mapping[str, float]) -> np.ndarray:
    """Bias and weights of `tempo`: log2 of the rate by ridge regression on standardised features.

    A clip counts as its source says, however long it is.
    """
    seen, wanted, weights = [], [], []
    for clip in clips:
        motion = on_floor(clip)
        for rate in RATES:
            evidence = Evidence.of(played(motion, rate), scorer)
            of_clip = windows(evidence)[::2]
            seen += [features(evidence, *window) for window in of_clip]
            wanted += [np.log2(rate)] * len(of_clip)
            weights += [says[clip.source] / len(of_clip)] * len(of_clip) if of_clip else []
    table, target, count = np.array(seen), np.array(wanted), np.array(weights) * len(weights) / sum(weights)
    mean, middle = np.average(table, axis=0, weights=count), np.average(target, weights=count)
    spread = np.maximum(table.std(axis=0), 1e-6)
    scaled = (table - mean) / spread
    heavy = scaled * count[:, None]
    slopes = np.linalg.solve(heavy.T @ scaled + RIDGE * np.eye(scaled.shape[1]), heavy.T @ (target - middle))
    slopes = slopes / spread
    return np.concatenate([[middle - mean @ slopes], slopes])


def played(motion: Motion, rate: float) -> Motion:
    """The motion at `rate` times its speed, along cubic splines through its frames."""
    if rate == 1.0:
        return motion
    from scipy.interpolate import CubicSpline

    joints = CubicSpline(np.arange(motion.frames), motion.joints.numpy())(np.arange(0, motion.frames - 1 + 1e-9, rate))
    return Motion(torch.from_numpy(joints), fps=motion.fps)
