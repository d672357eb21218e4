"""Any-joint-any-time control on recorded motions: five random keyframes of one joint (protocol of OmniControl)."""

from __future__ import annotations

import math
import statistics
import time
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import torch
from jaxtyping import Float, Int
from torch import Tensor

from objectives import Context, Objective, Term
from objectives.diagnosis import out_of_reach
from scenectl.bench.engine import ENGINE, Engine, Result, Row
from scenectl.control import SolverSettings
from scenectl.data.corpus import Clip, load_motions
from scenectl.data.features import FPS, canonicalise
from scenectl.generators.base import Draft, Generator, Guide
from scenectl.generators.spec import Spec
from scenectl.measures.metrics import max_acceleration, skating_ratio
from scenectl.pipeline.generation import Made, make
from scenes.body.body import DEFAULT_BODY
from scenes.errors import UserError
from scenes.motion.motion import Motion, Pose2D
from scenes.world.scene import Scene

JOINTS = ("pelvis", "left_foot", "right_foot", "head", "left_wrist", "right_wrist")
DENSITIES: dict[str, int | float] = {"1": 1, "2": 2, "5": 5, "25%": 0.25, "100%": 1.0}
"""Keyframes, as a number, or as a share of the frames where it is a float."""
FAILED = 0.5
"""A keyframe missed by more than this (m) counts as a location error."""
SHORTEST = 64
FLOOR = -DEFAULT_BODY.sole_offset
"""Height (m) of the floor in HumanML3D's frame: the lowest foot joint is at 0, and soles are below it."""
ON_FLOOR = Context(Scene.empty(FLOOR), DEFAULT_BODY)
"""The body on that floor, and nothing else."""


@dataclass(frozen=True)
class Keyframes:
    """One joint of a recorded motion at some frames, to be met by a motion of the same caption and length.

    Attributes:
        clip: the recording.
        frames: of it that count, from the first.
        joint: its name.
        at: the frames, in order.
        seed: of the motion.
    """

    clip: Clip
    frames: int
    joint: str
    at: Int[Tensor, " K"]
    seed: int

    @classmethod
    def drawn(
        cls, clip: Clip, spec: Spec, joint: str, density: int | float, draw: torch.Generator, seed: int
    ) -> Keyframes:
        """At random frames of what a generator makes at once: so many, or such a share of them where it is a float."""
        frames = min(clip.frames, longest(spec))
        number = max(1, round(density * frames)) if isinstance(density, float) else density
        return cls(clip, frames, joint, torch.randperm(frames, generator=draw)[:number].sort().values, seed)

    @cached_property
    def real(self) -> Motion:
        """The recording, over the origin at first and facing +z."""
        return Motion(canonicalise(self.clip.joints[: self.frames]))

    @property
    def wanted(self) -> Float[Tensor, "K 3"]:
        """Places, m."""
        return self.real.joint(self.joint)[self.at]

    def goal(self, tolerance: float) -> Term:
        """To be there within a tolerance (m)."""
        target = {"joint": self.joint, "position": self.wanted.tolist()}
        return Term("joint_target", target, tolerance=tolerance, at=[frame / FPS for frame in self.at.tolist()])

    def drafted(self, generator: Generator, guide: Guide | None = None) -> Draft:
        """One motion by the recording's caption, and of its length."""
        return generator.generate(self.clip.captions[0], self.real.seconds, Pose2D(), guide=guide, seed=self.seed)

    def made(self, generator: Generator, solver: SolverSettings | None = None) -> Made:
        """The same, led to the keyframes and refined."""
        return make(
            generator, self.clip.captions[0], self.real.seconds, Pose2D(), Objective((self.goal(0.002),)), ON_FLOOR,
            solver=solver, seed=self.seed,
        )  # fmt: skip

    def out_of_reach(self, motion: Motion) -> int:
        """How many of the keyframes no body with the bones of one motion ``[1, T, J, 3]`` can meet."""
        return out_of_reach(Objective((self.goal(0.002),)), motion[0], ON_FLOOR)

    def errors(self, motion: Motion) -> Float[Tensor, " K"]:
        """Distances (m) of one motion ``[1, T, J, 3]`` from the keyframes."""
        at = (self.at * (motion.fps / FPS)).round().long()
        return (motion[0].joint(self.joint)[at] - self.wanted).norm(dim=-1)


def bench_keyframes(
    generator: Generator,
    data: str | Path,
    clips: int = 36,
    keyframes: int = 5,
    seed: int = 0,
    solver: SolverSettings | None = None,
    engine: Engine = ENGINE,
) -> Result:
    """Targets from test clips of 64 to 196 frames, one joint each in turn, beside the same prompt without control.

    Args:
        generator: what makes the motions.
        data: folder of the motion collection.
        clips: how many test clips.
        keyframes: targets in each, at random frames.
        seed: of clips, frames and motions.
        solver: instead of the default.
        engine: tells progress, keeps rows and goes on from them.

    Returns:
        ``{"summary": ..., "rows": ...}``; metres, seconds, ratios. Motions with targets out of a body's reach are
        counted (`out_of_reach`) and left out of the means.
    """
    settings = {"bench": "keyframes", "data": data, "clips": clips, "keyframes": keyframes, "seed": seed}
    return engine.run(
        _cases(generator.spec, data, clips, keyframes, seed),
        lambda asked: [_row(generator, asked, solver or SolverSettings())],
        lambda rows: {"clips": len(rows), "keyframes": keyframes, **_summary(rows)},
        {**settings, "solver": solver},
    )


def _cases(spec: Spec, data: str | Path, clips: int, keyframes: int, seed: int) -> Iterator[tuple[str, Keyframes]]:
    draw = torch.Generator().manual_seed(seed)
    usable = usable_clips(data, spec)
    for i, number in enumerate(torch.randperm(len(usable), generator=draw)[:clips].tolist()):
        joint = JOINTS[i % len(JOINTS)]
        yield f"keyframes: {joint}", Keyframes.drawn(usable[number], spec, joint, keyframes, draw, seed + i)


def longest(spec: Spec) -> int:
    """Frames of a recording that a generator can make at once."""
    return round(spec.window * FPS)


def usable_clips(data: str | Path, spec: Spec, shortest: int = SHORTEST) -> list[Clip]:
    """Captioned test clips of so many frames or more, and no shorter than what a generator makes.

    Raises UserError where there is none.
    """
    shortest = max(shortest, math.ceil(spec.shortest * FPS))
    usable = [clip for clip in load_motions(data, ("test",)) if clip.frames >= shortest and clip.captions]
    if not usable:
        raise UserError(f"'{data}' has no captioned test clip of {shortest} frames or more")
    return usable


def _row(generator: Generator, asked: Keyframes, solver: SolverSettings) -> Row:
    free = asked.drafted(generator).motion
    began = time.perf_counter()
    made = asked.made(generator, solver)
    seconds = time.perf_counter() - began
    assert made.unrefined is not None
    error = asked.errors(made.motion)
    return {
        "clip": asked.clip.id,
        "source": asked.clip.source,
        "joint": asked.joint,
        "frames": asked.real.frames,
        "out_of_reach": asked.out_of_reach(made.motion),
        "average_error_m": float(error.mean()),
        "location_error": float((error > FAILED).float().mean()),
        "trajectory_error": float((error > FAILED).any()),
        "guided_only_error_m": float(asked.errors(made.unrefined).mean()),
        "uncontrolled_error_m": float(asked.errors(free).mean()),
        "skating_ratio": float(skating_ratio(made.motion[0])),
        "uncontrolled_skating_ratio": float(skating_ratio(free[0])),
        "real_skating_ratio": float(skating_ratio(asked.real)),
        "max_acceleration_m_per_frame2": float(max_acceleration(made.motion[0])),
        "uncontrolled_max_acceleration_m_per_frame2": float(max_acceleration(free[0])),
        "real_max_acceleration_m_per_frame2": float(max_acceleration(asked.real)),
        "seconds": seconds,
    }


def _summary(rows: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    beyond = sum(row["out_of_reach"] > 0 for row in rows)
    rows = [row for row in rows if not row["out_of_reach"]] or rows
    figures = [key for key, value in rows[0].items() if isinstance(value, float) and key != "seconds"]
    means = {key: statistics.fmean(row[key] for row in rows) for key in figures}
    by_joint = {
        joint: statistics.fmean(row["average_error_m"] for row in rows if row["joint"] == joint)
        for joint in JOINTS
        if any(row["joint"] == joint for row in rows)
    }
    return {
        "out_of_reach": beyond,
        **means,
        "median_seconds": statistics.median(row["seconds"] for row in rows),
        "error_by_joint_m": by_joint,
    }
