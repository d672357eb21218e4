"""How fast feet of recorded people move while they walk: where standing ends and swinging begins."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from scenectl.bench.engine import ENGINE, Engine, Result, Row
from scenectl.data.corpus import load_motions
from scenectl.retarget.plants import POINTS, STILL
from scenes.motion.motion import Motion
from scenes.motion.rigid import rigid

WALKING = 0.6
"""Metres a second of the pelvis over the ground, half the speed at which adults walk: frames that count."""
_KINDS = ("ankle", "foot")
EDGES = np.geomspace(0.01, 6.0, 25)
"""Metres a second between the classes of speeds, each 1.3 times as wide as the one before."""


def bench_plants(data: str | Path, split: str = "test", engine: Engine = ENGINE) -> Result:
    """Count speeds of ankles and balls in the frames of a split's recorded clips in which people walk.

    Returns:
        ``{"summary", "rows"}``: a row for each class of speeds with its share (%) of ankles and of balls; the summary
        has the valley of balls between standing and swinging, and the shares that are slower than `STILL`.
    """
    clips = [clip for clip in load_motions(data, (split,)) if clip.frames > 1]
    cases = [(clip.id, rigid(Motion(clip.joints))) for clip in clips]
    settings = {"bench": "plants", "split": split}
    result = engine.run(cases, _counts, _summary, settings)
    return result if "left" in result else {"summary": result["summary"], "rows": _table(result["rows"])}


def _counts(motion: Motion) -> list[Row]:
    ways = {name: motion.joint(name).double().numpy() for name in ("pelvis", *POINTS)}
    speeds = {name: np.gradient(way, axis=0) * motion.fps for name, way in ways.items()}
    walks = np.linalg.norm(speeds["pelvis"][:, [0, 2]], axis=-1) > WALKING
    row: Row = {}
    for kind in _KINDS:
        found = np.concatenate([np.linalg.norm(speeds[n][walks], axis=-1) for n in POINTS if n.endswith(kind)])
        row[kind] = np.histogram(found.clip(EDGES[0], EDGES[-1]), EDGES)[0].tolist()
        row[f"{kind}_still"] = int((found < STILL).sum())
    return [row]


def _table(rows: Sequence[Row]) -> list[Row]:
    shares = {}
    for kind in _KINDS:
        counts = np.sum([row[kind] for row in rows], axis=0)
        shares[kind] = 100 * counts / max(counts.sum(), 1)
    return [
        {"from_m_s": float(a), "to_m_s": float(b), "ankles_percent": float(x), "balls_percent": float(y)}
        for a, b, x, y in zip(EDGES, EDGES[1:], shares["ankle"], shares["foot"], strict=False)
    ]


def _summary(rows: Sequence[Row]) -> dict[str, Any]:
    table = _table(rows)
    balls = np.array([row["balls_percent"] for row in table])
    stand, swing = int(balls[: len(balls) // 2].argmax()), len(balls) // 2 + int(balls[len(balls) // 2 :].argmax())
    valley = table[stand + int(balls[stand:swing].argmin())] if swing > stand else table[0]
    still = {f"{k}_still": sum(r[f"{k}_still"] for r in rows) / max(np.sum([r[k] for r in rows]), 1) for k in _KINDS}
    return {"frames": int(np.sum([r["foot"] for r in rows]) / 2), "valley_from_m_s": valley["from_m_s"],
            "valley_to_m_s": valley["to_m_s"], **{k: float(v) for k, v in still.items()}}  # fmt: skip
