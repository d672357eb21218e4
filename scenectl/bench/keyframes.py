"""Any-joint-any-time control on recorded motions: five random keyframes of one joint (protocol of OmniControl)."""

from __future__ import annotations

import statistics
import time
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import torch
from jaxtyping import Float
from torch import Tensor

from objectives import Context, Objective, Term
from scenectl.control import ObjectiveGuide, SolverSettings
from scenectl.data.corpus import Clip, load_motions
from scenectl.data.features import FPS, canonicalise
from scenectl.generators.base import Generator, Progress
from scenectl.metrics import max_acceleration, skating_ratio
from scenectl.models.schedule import MAX_FRAMES
from scenes.body import DEFAULT_BODY
from scenes.errors import UserError
from scenes.motion import Motion, Pose2D
from scenes.scene import Scene

JOINTS = ("pelvis", "left_foot", "right_foot", "head", "left_wrist", "right_wrist")
FAILED = 0.5
"""A keyframe missed by more than this (m) counts as a location error."""
SHORTEST = 64


def bench_keyframes(
    generator: Generator,
    data: str | Path,
    clips: int = 36,
    keyframes: int = 5,
    seed: int = 0,
    solver: SolverSettings | None = None,
    progress: Progress | None = None,
) -> dict[str, Any]:
    """Targets from test clips of 64 to 196 frames, one joint each in turn, beside the same prompt without control.

    Args:
        generator: what makes the motions.
        data: folder of the motion collection.
        clips: how many test clips.
        keyframes: targets in each, at random frames.
        seed: of clips, frames and motions.
        solver: instead of the default.
        progress: called with what is being done and the fraction done.

    Returns:
        ``{"summary": ..., "rows": ...}``; metres, seconds, ratios.
    """
    tell = progress or (lambda what, done: None)
    draw = torch.Generator().manual_seed(seed)
    chosen = _clips(data, clips, draw)
    rows = []
    for i, clip in enumerate(chosen):
        joint = JOINTS[i % len(JOINTS)]
        tell(f"keyframes: {joint}", i / len(chosen))
        rows.append(_row(generator, clip, joint, keyframes, draw, seed + i, solver or SolverSettings()))
    return {"summary": {"clips": len(rows), "keyframes": keyframes, **_summary(rows)}, "rows": rows}


def usable_clips(data: str | Path) -> list[Clip]:
    """Captioned test clips of `SHORTEST` frames or more; raises UserError where there is none."""
    usable = [clip for clip in load_motions(data, ("test",)) if clip.frames >= SHORTEST and clip.captions]
    if not usable:
        raise UserError(f"'{data}' has no captioned test clip of {SHORTEST} frames or more")
    return usable


def _clips(data: str | Path, count: int, draw: torch.Generator) -> list[Clip]:
    usable = usable_clips(data)
    order = torch.randperm(len(usable), generator=draw).tolist()
    return [usable[i] for i in order[:count]]


def _row(
    generator: Generator,
    clip: Clip,
    joint: str,
    keyframes: int,
    draw: torch.Generator,
    seed: int,
    solver: SolverSettings,
) -> dict[str, Any]:
    frames = min(clip.frames, MAX_FRAMES)
    real = Motion(canonicalise(clip.joints[:frames]))
    at = torch.randperm(frames, generator=draw)[:keyframes].sort().values
    wanted = real.joint(joint)[at]
    times = [frame / FPS for frame in at.tolist()]
    target = {"joint": joint, "position": wanted.tolist()}
    objective = Objective((Term("joint_target", target, tolerance=0.002, at=times),))
    guide = ObjectiveGuide(objective, Context(Scene.empty(), DEFAULT_BODY), solver)
    free = generator.generate(clip.captions[0], frames / FPS, Pose2D(), None, 1, seed).motion[0]
    began = time.perf_counter()
    made = generator.generate(clip.captions[0], frames / FPS, Pose2D(), guide, 1, seed)
    seconds = time.perf_counter() - began
    assert made.unrefined is not None
    error = _errors(made.motion[0], joint, at, wanted)
    return {
        "clip": clip.id,
        "source": clip.source,
        "joint": joint,
        "frames": frames,
        "average_error_m": float(error.mean()),
        "location_error": float((error > FAILED).float().mean()),
        "guided_only_error_m": float(_errors(made.unrefined[0], joint, at, wanted).mean()),
        "uncontrolled_error_m": float(_errors(free, joint, at, wanted).mean()),
        "skating_ratio": float(skating_ratio(made.motion[0])),
        "uncontrolled_skating_ratio": float(skating_ratio(free)),
        "real_skating_ratio": float(skating_ratio(real)),
        "max_acceleration_m_per_frame2": float(max_acceleration(made.motion[0])),
        "uncontrolled_max_acceleration_m_per_frame2": float(max_acceleration(free)),
        "real_max_acceleration_m_per_frame2": float(max_acceleration(real)),
        "seconds": seconds,
    }


def _errors(motion: Motion, joint: str, at: Tensor, wanted: Float[Tensor, "K 3"]) -> Float[Tensor, " K"]:
    return (motion.joint(joint)[at] - wanted).norm(dim=-1)


def _summary(rows: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    figures = [key for key, value in rows[0].items() if isinstance(value, float) and key != "seconds"]
    means = {key: statistics.fmean(row[key] for row in rows) for key in figures}
    by_joint = {
        joint: statistics.fmean(row["average_error_m"] for row in rows if row["joint"] == joint)
        for joint in JOINTS
        if any(row["joint"] == joint for row in rows)
    }
    return {**means, "median_seconds": statistics.median(row["seconds"] for row in rows), "error_by_joint_m": by_joint}
