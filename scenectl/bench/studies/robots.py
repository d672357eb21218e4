"""How well a robot follows motions: how far from them it stays, within which limits, and how fast that is."""

from __future__ import annotations

import re
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np

from scenectl.bench.control.rooms import Room, room_of, walks_in
from scenectl.bench.engine import ENGINE, Engine, Result, Row
from scenectl.data.corpus import load_motions
from scenectl.data.formats.motions import load_motion
from scenectl.generators.base import Generator
from scenectl.pipeline.run import run
from scenectl.retarget.robots.feasibility import feasibility
from scenectl.retarget.robots.robot import FPS, Robot
from scenectl.retarget.robots.trajectory import Trajectory
from scenectl.tasks.schema import BodySpec
from scenectl.tasks.task import Task
from scenes.motion.motion import Motion
from scenes.world.scene import Scene

RECORDED, WALK = "recorded", "walk"
"""Kinds of rows: motions that were there, and walks that were made for the robot."""


@dataclass(frozen=True, eq=False)
class Walks:
    """Random walks through scans, as `bench rooms` draws them, of a person with the robot's legs.

    Attributes:
        generator: what makes them.
        scans: files in metres, y up.
        count: of walks, shared by the scans.
        seed: of starts, targets and motions.
        samples: motions made for each walk, of which the robot follows the first-ranked.
    """

    generator: Generator
    scans: Sequence[Path]
    count: int = 10
    seed: int = 0
    samples: int = 1

    def cases(self, robot: Robot) -> Iterator[tuple[str, tuple[Room, int, Task]]]:
        """The walks: name, room, number and task."""
        for share, scan in zip(np.array_split(np.arange(self.count), len(self.scans)), self.scans, strict=True):
            room = room_of(scan)
            tasks = walks_in(room, len(share), self.seed, body=BodySpec(height=robot.stature))
            for number, task in enumerate(tasks):
                yield f"{room.name} {number}", (room, number, task)


def bench_robots(
    robot: Robot,
    data: str | Path | None,
    split: str = "test",
    motions: int = 20,
    files: Sequence[Path] = (),
    fps: float = FPS,
    engine: Engine = ENGINE,
    walks: Walks | None = None,
    pictures: Path | None = None,
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
        walks: to make and to follow as well, out of the way of their scans.
        pictures: a folder for a picture of each motion; None for none.

    Returns:
        ``{"summary", "rows"}``: a row for each motion. Metres are medians over its frames, but for slides, depths and
        what is beyond ranges, which are the most of it; seconds are of all the work but loading the robot: `seconds`
        of following, `generate_s` of planning and making the walk, `cpu_s` of both without what other processes take.
        `slide_m` is of our joint that stands, `sole_m` of
        the point of its sole that stays best of those that touch.
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
    made = [(name, partial(_followed, robot, name, motion, fps, pictures)) for name, motion in cases]
    settings: dict[str, object] = {
        "bench": "robots",
        "robot": robot.source,
        "joints": robot.joints,
        "split": split,
        "fps": fps,
    }
    if walks is not None:
        settings |= {"scans": walks.scans, "walks": walks.count, "seed": walks.seed, "samples": walks.samples}
        made += [(name, partial(_walked, robot, walks, *walk, fps, pictures)) for name, walk in walks.cases(robot)]
    return engine.run(made, lambda case: [case()], _summary, settings)


def _followed(robot: Robot, name: str, motion: Motion, fps: float, pictures: Path | None) -> Row:
    begin = time.perf_counter()
    trajectory = robot.retarget(motion, fps)
    row = _row(RECORDED, name, trajectory, time.perf_counter() - begin)
    _draw(trajectory, None, name, pictures)
    return row


def _walked(robot: Robot, walks: Walks, room: Room, number: int, task: Task, fps: float, pictures: Path | None) -> Row:
    begin, busy = time.perf_counter(), time.process_time()
    setup = task.build(walks.seed + number, scene=room.scene, spec=walks.generator.spec)
    made = run(task, walks.samples, walks.seed + number, walks.generator, setup=setup, scorer=room.scorer)
    between = time.perf_counter()
    trajectory = robot.retarget(made.motion[0], fps, room.scene)
    took = time.perf_counter() - between
    spent = {"generate_s": between - begin, "cpu_s": time.process_time() - busy}
    name = f"{room.name} {number}"
    row = _row(WALK, name, trajectory, took, room.scene) | spent
    _draw(trajectory, room.scene, name, pictures)
    return row


def _draw(trajectory: Trajectory, scene: Scene | None, name: str, pictures: Path | None) -> None:
    """The picture of a motion, as `scenectl retarget --png` draws it, if there is a folder for it."""
    if pictures is None:
        return
    from scenectl.view.robots import Replay

    Replay.of(trajectory, scene).draw(pictures / f"{re.sub('[^A-Za-z0-9._-]+', '_', name)}.png")


def _row(kind: str, name: str, trajectory: Trajectory, took: float, scene: Scene | None = None) -> Row:
    figures, told = trajectory.figures(), feasibility(trajectory, scene)
    off = {part: max(figures.off[f"{side}_{part}"][0] for side in ("left", "right")) for part in _PARTS}
    return {
        "kind": kind,
        "name": name,
        "frames": trajectory.frames,
        **{f"{part}_m": value for part, value in off.items()},
        "slide_m": figures.slide,
        "sole_m": told.slide.metres,
        "speed": figures.speed,
        "beyond": figures.beyond,
        "within": told.within,
        "itself_m": told.itself.metres,
        "scene_m": None if told.scene is None else told.scene.metres,
        "seconds": took,
        "times_real": took * trajectory.fps / trajectory.frames,
    }


_PARTS = ("ankle", "wrist", "knee", "elbow")
_LARGEST = ("ankle_m", "wrist_m", "slide_m", "sole_m", "speed", "itself_m")


def _summary(rows: Sequence[Row]) -> Row:
    kinds = {kind: [row for row in rows if row["kind"] == kind] for kind in (RECORDED, WALK)}
    return {kind: _figures(some) for kind, some in kinds.items() if some}


def _figures(rows: Sequence[Row]) -> Row:
    found: Row = {
        "motions": len(rows),
        **{f"largest_{key}": max(row[key] for row in rows) for key in _LARGEST},
        "beyond_limits": sum(not row["within"] for row in rows),
        "seconds": sum(row["seconds"] for row in rows),
        "median_seconds": float(np.median([row["seconds"] for row in rows])),
        "times_real": float(np.median([row["times_real"] for row in rows])),
    }
    if rows[0]["kind"] == WALK:
        whole = [row["generate_s"] + row["seconds"] for row in rows]
        found |= {
            "largest_scene_m": max(row["scene_m"] for row in rows),
            "median_scene_m": float(np.median([row["scene_m"] for row in rows])),
            "median_generate_s": float(np.median([row["generate_s"] for row in rows])),
            "median_cpu_s": float(np.median([row["cpu_s"] for row in rows])),
            "targets_per_minute": 60 / float(np.median(whole)),  # the first of each scan bakes it
        }
    return found
