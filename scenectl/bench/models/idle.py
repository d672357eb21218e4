"""Does a person who is asked to stand do so: arms hanging, knees straight, swaying as people do and never frozen?"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import torch
from jaxtyping import Float
from torch import Tensor

from scenectl.bench.engine import ENGINE, Engine, Result, Row
from scenectl.bench.models.criteria import at_least
from scenectl.data.features import FPS, features_to_joints, on_body
from scenectl.evaluation.acts import held_out_pieces, is_edit
from scenectl.generators.base import Generator
from scenectl.view.strips import draw_strips
from scenes.errors import UserError
from scenes.motion.motion import Motion, Pose2D
from scenes.sdf.bake import default_cache

WORDINGS = (
    "a person stands relaxed.",
    "a person stands still with the arms hanging down.",
    "someone stands idle.",
    "the person stands upright and waits.",
    "a person stands there quietly, doing nothing.",
)
SECONDS = 10.0
STRAIGHT = 20.0
"""Degrees that a knee may be bent, from issue 24."""
WINDOW, HOP = 2.0, 1.0
"""Seconds: sway depends on how long one looks, so recordings and samples are looked at for the same time."""
FEWEST = 20
"""Windows of recorded people that tell the range, at least."""
_BOUNDED = ("wrists_m", "sway_m", "stir_m_per_s")


def stances(joints: Float[Tensor, "T 22 3"]) -> dict[str, Float[Tensor, " W"]]:
    """Figures of every window of `WINDOW` seconds of one motion (m, at 20 fps); none where it is shorter.

    Returns:
        "wrists_m": height of the higher wrist over its hip, mean; "knees_deg": the larger bend, 0 for a straight leg,
        in the worst frame; "sway_m": root mean square of the pelvis's way over the floor about its mean;
        "stir_m_per_s": mean speed of all joints.
    """
    size, hop = round(WINDOW * FPS), round(HOP * FPS)
    motion = Motion(joints)
    wrists = torch.stack(
        [motion.joint(f"{side}_wrist")[:, 1] - motion.joint(f"{side}_hip")[:, 1] for side in ("left", "right")]
    )
    bends = torch.stack([_bend(motion, side) for side in ("left", "right")])
    speed = joints.diff(dim=0).norm(dim=-1).mean(-1) * FPS
    floor = joints[:, 0, ::2]
    firsts = range(0, len(joints) - size + 1, hop)
    windows = [slice(first, first + size) for first in firsts]
    named = {
        "wrists_m": [wrists[:, w].amax(0).mean() for w in windows],
        "knees_deg": [bends[:, w].max() for w in windows],
        "sway_m": [(floor[w] - floor[w].mean(0)).square().sum(-1).mean().sqrt() for w in windows],
        "stir_m_per_s": [speed[w.start : w.stop - 1].mean() for w in windows],
    }
    return {name: torch.stack(found) if found else joints.new_zeros(0) for name, found in named.items()}


def _bend(motion: Motion, side: str) -> Float[Tensor, " T"]:
    """Degrees by which a knee is bent."""
    hip, knee, ankle = (motion.joint(f"{side}_{name}") for name in ("hip", "knee", "ankle"))
    cosine = torch.nn.functional.cosine_similarity(knee - hip, ankle - knee, dim=-1)
    return torch.rad2deg(cosine.clamp(-1.0, 1.0).acos())


def bench_idle(
    generator: Generator,
    data: Path,
    samples: int = 20,
    seed: int = 0,
    png: Path | None = None,
    engine: Engine = ENGINE,
) -> Result:
    """Ask for somebody who stands, in five wordings, and compare with held-out people who were recorded standing.

    Args:
        generator: the model.
        data: motion collection.
        samples: motions of 10 s, all wordings together.
        seed: of the motions.
        png: draws every motion there.
        engine: tells progress, keeps rows and goes on from them.

    Raises:
        UserError: the collection holds too few people who stand.

    Returns:
        ``{"summary", "rows", "criteria"}``: a row for each motion with its figures and what holds of it; the summary
        has the shares, those of recorded people by the same rules, and the range of these.
    """
    recorded = _recorded(data)
    bounds = _bounds(recorded)
    counts = [len(range(i, samples, len(WORDINGS))) for i in range(len(WORDINGS))]

    def measured(case: tuple[int, str, int]) -> list[Row]:
        i, wording, count = case
        motion = generator.generate(wording, SECONDS, Pose2D(), samples=count, seed=seed + i).motion
        if png is not None:
            drawn.extend((f"{wording} {s + 1}", motion.joints[s].numpy()) for s in range(count))
        return [{"prompt": wording, **_judged(stances(joints), bounds)} for joints in motion.joints]

    drawn: list[tuple[str, Any]] = []
    cases = [(w, (i, w, n)) for i, (w, n) in enumerate(zip(WORDINGS, counts, strict=True)) if n]
    settings = {
        "bench": "idle",
        "data": data,
        "samples": samples,
        "seed": seed,
        "drawn": None if png is None else str(png),
    }
    result = engine.run(cases, measured, _shares, settings)
    if "left" in result:
        return result
    if drawn and png is not None:
        draw_strips(drawn, png)
    people = [_judged(stances(joints), bounds) for joints in recorded]
    result["summary"] |= {"recorded": {"pieces": len(people), **_shares(people)}, "range": bounds}
    return {**result, "criteria": [at_least("idle samples that stand as people do", 0.9, result["summary"]["stands"])]}


def _recorded(data: Path) -> list[Float[Tensor, "_T 22 3"]]:
    """Held-out people who stand, long enough for a window."""
    pieces = held_out_pieces(data, default_cache() / "windows")
    spans = zip(pieces.starts[:-1].tolist(), pieces.starts[1:].tolist(), pieces.groups, pieces.ids, strict=True)
    rows = [
        pieces.features[a:b]
        for a, b, kind, name in spans
        if kind == "idle" and not is_edit(name) and b - a >= round(WINDOW * FPS)
    ]
    return [features_to_joints(on_body(row)) for row in rows]


def _bounds(recorded: Sequence[Float[Tensor, "_T 22 3"]]) -> dict[str, list[float]]:
    """Smallest and largest of each figure over all windows of recorded people."""
    found = [stances(joints) for joints in recorded]
    windows = sum(len(one["sway_m"]) for one in found)
    if windows < FEWEST:
        raise UserError(
            f"the data holds {windows} windows of {WINDOW:g} s of people who stand in held-out takes; {FEWEST} are "
            "needed to tell the range of what people do"
        )
    every = {name: torch.cat([one[name] for one in found]) for name in _BOUNDED}
    return {name: [float(figures.min()), float(figures.max())] for name, figures in every.items()}


def _judged(figures: Mapping[str, Float[Tensor, " W"]], bounds: Mapping[str, Sequence[float]]) -> Row:
    """Figures of one motion at their worst, and what holds of it."""
    low, high = (
        {name: float(f.min()) for name, f in figures.items()},
        {name: float(f.max()) for name, f in figures.items()},
    )
    holds = {
        "arms_hang": high["wrists_m"] <= bounds["wrists_m"][1],
        "knees_straight": high["knees_deg"] <= STRAIGHT,
        "sways_as_people": bounds["sway_m"][0] <= low["sway_m"] and high["sway_m"] <= bounds["sway_m"][1],
        "never_frozen": low["stir_m_per_s"] >= bounds["stir_m_per_s"][0],
    }
    return {
        **holds,
        "stands": all(holds.values()),
        "wrists_m": high["wrists_m"],
        "knees_deg": high["knees_deg"],
        "least_sway_m": low["sway_m"],
        "most_sway_m": high["sway_m"],
        "least_stir_m_per_s": low["stir_m_per_s"],
    }


def _shares(rows: Sequence[Row]) -> dict[str, Any]:
    keys = ("stands", "arms_hang", "knees_straight", "sways_as_people", "never_frozen")
    return {key: sum(row[key] for row in rows) / len(rows) for key in keys}
