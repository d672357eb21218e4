"""Fronts at random times of motions: are they met to two degrees by a body that people would have?"""

from __future__ import annotations

import statistics
import time
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import torch
from jaxtyping import Float, Int
from torch import Tensor

from objectives import Context, Objective, Term
from objectives.library.directions import PARTS
from scenectl.bench.control.keyframes import FLOOR, longest, usable_clips
from scenectl.bench.engine import ENGINE, Engine, Result, Row
from scenectl.control import SolverSettings
from scenectl.data.corpus import Clip
from scenectl.data.features import FPS, canonicalise
from scenectl.generators.base import Generator
from scenectl.generators.spec import Spec
from scenectl.measures.believability.judge import Judge
from scenectl.measures.metrics import Scorer
from scenectl.pipeline.generation import make
from scenectl.tasks.schema import AVOID
from scenes.body.body import DEFAULT_BODY
from scenes.motion.headings import heading_of
from scenes.motion.kinematics import orientations
from scenes.motion.motion import Motion, Pose2D
from scenes.world.scene import Scene

FACED = 2.0
"""Degrees within which a heading is met."""


@dataclass(frozen=True)
class Faced:
    """Headings of a recorded body's part at some frames, to be met by a motion of the same caption and length.

    Attributes:
        clip: the recording.
        real: what of it counts, over the origin at first and facing +z.
        part: pelvis, chest or head.
        at: the frames, in order.
        seed: of the motion.
    """

    clip: Clip
    real: Motion
    part: str
    at: Int[Tensor, " K"]
    seed: int

    @property
    def terms(self) -> tuple[Term, ...]:
        """A goal for each frame."""
        front = orientations(self.real, [PARTS[self.part]])[self.at, 0, :, 2]
        stated = zip(self.at.tolist(), heading_of(front).tolist(), strict=True)
        return tuple(
            Term("face", {"part": self.part, "heading": heading}, at=frame / FPS, tolerance=FACED, name=f"face {k}")
            for k, (frame, heading) in enumerate(stated, 1)
        )

    def errors(self, motion: Motion, context: Context) -> Float[Tensor, " K"]:
        """Angles (deg) by which one motion ``[T, J, 3]`` misses them."""
        return torch.tensor([term.report(motion, context)[0].worst for term in self.terms])


def bench_facing(
    generator: Generator,
    data: str | Path,
    motions: int = 30,
    moments: int = 5,
    seed: int = 0,
    solver: SolverSettings | None = None,
    engine: Engine = ENGINE,
) -> Result:
    """The pelvis, chest and head in turn, with the headings of test clips at random times, beside no control.

    Args:
        generator: what makes the motions.
        data: folder of the motion collection.
        motions: how many test clips.
        moments: random times in each.
        seed: of clips, times and motions.
        solver: instead of the default.
        engine: tells progress, keeps rows and goes on from them.

    Returns:
        ``{"summary": ..., "rows": ...}``; degrees, seconds, and whether people move like that.
    """
    return engine.run(
        _cases(generator.spec, data, motions, moments, seed),
        lambda asked: [_row(generator, asked, solver)],
        _summary,
        {"bench": "facing", "data": data, "motions": motions, "moments": moments, "seed": seed, "solver": solver},
    )


def _cases(spec: Spec, data: str | Path, motions: int, moments: int, seed: int) -> Iterator[tuple[str, Faced]]:
    draw = torch.Generator().manual_seed(seed)
    usable, parts = usable_clips(data, spec), list(PARTS)
    for i, number in enumerate(torch.randperm(len(usable), generator=draw)[:motions].tolist()):
        clip, part = usable[number], parts[i % len(parts)]
        real = Motion(canonicalise(clip.joints[: longest(spec)]))
        at = torch.randperm(real.frames, generator=draw)[:moments].sort().values
        yield f"facing: {part}", Faced(clip, real, part, at, seed + i)


def _row(generator: Generator, asked: Faced, solver: SolverSettings | None) -> Row:
    scene, caption = Scene.empty(FLOOR), asked.clip.captions[0]
    context, judge = Context(scene, DEFAULT_BODY), Judge(Scorer(scene))
    free = generator.generate(caption, asked.real.seconds, Pose2D(), seed=asked.seed).motion[0]
    objective = Objective((*asked.terms, Term.from_table({"use": "sdf_penetration", **AVOID})))
    began = time.perf_counter()
    made = make(generator, caption, asked.real.seconds, Pose2D(), objective, context, solver=solver, seed=asked.seed)
    seconds, error = time.perf_counter() - began, asked.errors(made.motion[0], context)
    verdict = judge.verdict(made.motion[0])
    return {
        "clip": asked.clip.id,
        "source": asked.clip.source,
        "part": asked.part,
        "frames": asked.real.frames,
        "mean_error_deg": float(error.mean()),
        "worst_error_deg": float(error.max()),
        "met": bool(error.max() <= FACED),
        "uncontrolled_mean_error_deg": float(asked.errors(free, context).mean()),
        "believable": verdict.believable,
        "verdict": verdict.sentence,
        "uncontrolled_believable": judge.verdict(free).believable,
        "real_believable": judge.verdict(asked.real).believable,
        "seconds": seconds,
    }


def _summary(rows: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    def mean(key: str, some: Sequence[Mapping[str, Any]] = rows) -> float:
        return statistics.fmean(row[key] for row in some)

    shares = ("met", "believable", "uncontrolled_believable", "real_believable")
    return {
        "motions": len(rows),
        **{f"{key}_rate": mean(key) for key in shares},
        "mean_error_deg": mean("mean_error_deg"),
        "worst_error_deg": max(row["worst_error_deg"] for row in rows),
        "uncontrolled_mean_error_deg": mean("uncontrolled_mean_error_deg"),
        "median_seconds": statistics.median(row["seconds"] for row in rows),
        "met_rate_by_part": {
            part: mean("met", [row for row in rows if row["part"] == part])
            for part in PARTS
            if any(row["part"] == part for row in rows)
        },
    }
