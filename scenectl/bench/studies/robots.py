"""How well a robot follows motions: how far from them it stays, within which limits, and how fast that is."""

from __future__ import annotations

import time
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from scenectl.bench.engine import ENGINE, Engine, Result, Row
from scenectl.data.corpus import load_motions
from scenectl.data.formats.motions import load_motion
from scenectl.retarget.robots.robot import FPS, Robot
from scenes.motion.motion import Motion


def bench_robots(
    robot: Robot,
    data: str | Path | None,
    split: str = "test",
    motions: int = 20,
    files: Sequence[Path] = (),
    fps: float = FPS,
    engine: Engine = ENGINE,
) -> Result:
    """Make a robot follow motions.

    Args:
        robot: that follows.
        data: folder of the motion collection; None for none.
        split: of it.
        motions: of the split at most, evenly over its clips.
        files: results and motions to follow as well, all their samples.
        fps: frames a second of the trajectories.
        engine: tells progress, keeps rows and goes on from them.

    Returns:
        ``{"summary", "rows"}``: a row for each motion. Metres are medians over its frames, but for slides and what is
        beyond ranges, which are the most of it; seconds are of all the work but loading the robot.
    """
    cases = list[tuple[str, Motion]]()
    if data is not None and motions:
        clips = [clip for clip in load_motions(data, (split,)) if clip.frames > 1]
        chosen = np.unique(np.linspace(0, len(clips) - 1, min(motions, len(clips))).round().astype(int))
        cases += [(clips[i].id, Motion(clips[i].joints)) for i in chosen]
    for path in files:
        motion = load_motion(path)
        several = motion.joints.ndim == 4
        cases += [(f"{path} {i}", motion[i]) for i in range(len(motion.joints))] if several else [(str(path), motion)]
    numbered = [(name, (name, motion)) for name, motion in cases]
    settings = {"bench": "robots", "robot": robot.source, "joints": robot.joints, "split": split, "fps": fps}
    return engine.run(numbered, lambda case: [_row(robot, *case, fps)], _summary, settings)


def _row(robot: Robot, name: str, motion: Motion, fps: float) -> Row:
    begin = time.perf_counter()
    trajectory = robot.retarget(motion, fps)
    took = time.perf_counter() - begin
    figures = trajectory.figures()
    off = {part: max(figures.off[f"{side}_{part}"][0] for side in ("left", "right")) for part in _PARTS}
    return {
        "name": name,
        "frames": trajectory.frames,
        **{f"{part}_m": value for part, value in off.items()},
        "slide_m": figures.slide,
        "speed": figures.speed,
        "beyond": figures.beyond,
        "seconds": took,
        "times_real": took * fps / trajectory.frames,
    }


_PARTS = ("ankle", "wrist", "knee", "elbow")


def _summary(rows: Sequence[Row]) -> Row:
    if not rows:
        return {"motions": 0}
    worst = {f"largest_{key}": max(row[key] for row in rows) for key in ("ankle_m", "wrist_m", "slide_m", "speed")}
    return {
        "motions": len(rows),
        **worst,
        "beyond_ranges": sum(row["beyond"] > 0 for row in rows),
        "beyond_speeds": sum(row["speed"] > 1 for row in rows),
        "seconds": sum(row["seconds"] for row in rows),
        "times_real": float(np.median([row["times_real"] for row in rows])),
    }
