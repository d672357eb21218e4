"""The verdict both ways: are recorded people believable, and is what nobody does called by its name?"""

from __future__ import annotations

import statistics
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import torch

from scenectl.bench.engine import ENGINE, Engine, Result, Row
from scenectl.bench.studies.absurdities import ABSURDITIES
from scenectl.bench.studies.recordings import FLOOR, drawn_heading, on_floor, recordings
from scenectl.data.corpus import Clip
from scenectl.measures.believability.judge import Judge
from scenectl.measures.believability.verdict import Verdict
from scenectl.measures.metrics import Scorer
from scenes.motion.motion import Motion
from scenes.world.scene import Scene

RECORDED = "recorded"


def bench_verdict(
    data: str | Path, motions: int = 200, seed: int = 0, split: str = "test", engine: Engine = ENGINE
) -> Result:
    """Judge recorded motions, and what `ABSURDITIES` makes of each.

    Two absurdities need a motion that walks (0.5 m/s on average): the pause in a walk, and twice the speed, which
    nobody can tell of a hand that is raised; that one needs two seconds besides. All others are made of every motion.

    Args:
        data: folder of the motion collection.
        motions: how many are drawn, of a second or more, without climbing, sitting, lying and acrobatics.
        seed: of the draw, and of sides, frames and bones.
        split: of the collection that they are drawn from; limits are measured on "train".
        engine: tells progress, keeps rows and goes on from them.

    Returns:
        ``{"summary", "rows"}``: the share that is believable, of all and by source; of each absurdity the share that is
        called, and that is called by the right sentence.
    """
    return engine.run(
        list(_cases(data, motions, seed, split)),
        _measured,
        _summary,
        {"bench": "verdict", "data": data, "motions": motions, "seed": seed, "split": split},
    )


def _cases(data: str | Path, motions: int, seed: int, split: str) -> Iterator[tuple[str, tuple[Clip, int]]]:
    clips = recordings(data, split)
    order = torch.randperm(len(clips), generator=torch.Generator().manual_seed(seed))
    for number, i in enumerate(order[:motions].tolist()):
        yield f"verdict: {clips[i].id}", (clips[i], 1000 * seed + number)


def _measured(case: tuple[Clip, int]) -> list[Row]:
    clip, seed = case
    draw = torch.Generator().manual_seed(seed)
    motion, prompt = on_floor(clip, drawn_heading(draw)), clip.captions[0] if clip.captions else ""
    rows = [_row(clip, RECORDED, _judged(motion, FLOOR, prompt), ())]
    for name, absurdity in ABSURDITIES.items():
        made = absurdity.make(motion, draw)
        if made is not None:
            rows.append(_row(clip, name, _judged(*made, prompt), absurdity.right))
    return rows


def _judged(motion: Motion, scene: Scene, prompt: str) -> Verdict:
    return Judge(Scorer(scene), prompt).verdict(motion)


def _row(clip: Clip, made: str, verdict: Verdict, right: tuple[str, ...]) -> Row:
    first = None if verdict.believable else verdict.findings[0].check
    return {
        "motion": clip.id,
        "source": clip.source,
        "made": made,
        "called": not verdict.believable,
        "right": first in right,
        "check": first,
        "checks": [finding.check for finding in verdict.findings],
        "sentence": verdict.sentence,
    }


def _summary(rows: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    real = [row for row in rows if row["made"] == RECORDED]
    found: dict[str, Any] = {
        "motions": len(real),
        "believable": _share(not row["called"] for row in real),
        "believable_by_source": {
            source: _share(not row["called"] for row in real if row["source"] == source)
            for source in sorted({row["source"] for row in real})
        },
        "found_fault_with": dict(Counter(check for row in real for check in row["checks"])),
    }
    for name in ABSURDITIES:
        mine = [row for row in rows if row["made"] == name]
        if mine:
            found[name] = {
                "motions": len(mine),
                "called": _share(row["called"] for row in mine),
                "right": _share(row["right"] for row in mine),
            }
    return found


def _share(flags: Any) -> float:
    return round(statistics.fmean(bool(flag) for flag in flags), 4)
