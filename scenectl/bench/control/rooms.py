"""Random walks through scanned rooms: how often the target is reached and nothing is touched."""

from __future__ import annotations

import statistics
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
import torch

from scenectl.bench.engine import ENGINE, Engine, Result, Row
from scenectl.bench.scenes.meshes import FACINGS, faced
from scenectl.control import SolverSettings
from scenectl.generators.base import Generator
from scenectl.measures import metrics
from scenectl.measures.metrics import Scorer, max_acceleration, skating_ratio
from scenectl.pipeline.run import run
from scenectl.tasks.schema import BodySpec, Start
from scenectl.tasks.setup import STANDING
from scenectl.tasks.task import Task
from scenectl.tasks.walk import Spot, Walk
from scenes.body.body import DEFAULT_BODY
from scenes.errors import UserError
from scenes.motion.motion import Motion
from scenes.motion.skeleton import FEET
from scenes.world.floor.planning import FreeArea, free_area
from scenes.world.floor.polyline import walked
from scenes.world.scene import Scene, bundled, load_scene

PROMPT = "a person walks forward"
REACHED = 0.10
"""Distance (m, on the floor) from the pelvis at the last frame to the target that counts as reached."""
DEEP = 0.02
"""A frame is clean when nothing is deeper than this (m), in obstacles or the floor."""
SHORTEST_PATH, LONGEST_PATH = 1.0, 4.0
RADIUS = 0.35
"""Clearance (m) of starts, targets and paths."""
FALLBACK = ("living_room", "pillars", "corridor")
"""Bundled scenes to walk in where no mesh is named."""
LOW = {"corridor": (1.4, "a person walks forward and ducks")}
"""Scenes in which one ducks: the height (m) that is free along the path, and the prompt."""
UPRIGHT = 1.8
CLOSE, SHALLOW, QUICK = 0.05, 0.01, 1.0
"""Stricter bounds, each with a rate of its own: metres from the target, metres deep at worst, seconds to make it."""
TRIES = 200
"""Draws a task after which a room counts as too small to walk in."""

RESTING, STILL, DOWN = 0.25, 0.2, 0.05
"""A walk has stopped where for the last so many seconds the pelvis is slower than this (m/s over the floor) and both
feet are lower than this (m over where they rest)."""


@dataclass(frozen=True)
class Room:
    """A scene to walk in, prepared once.

    Attributes:
        upright: where a person stands upright, as at the start of a walk.
        height: free along paths (m); less than a person's where there is something to duck under.
        prompt: of its walks.
        rejected: how many random tasks were thrown away, by reason.
    """

    name: str
    scene: Scene
    area: FreeArea
    upright: FreeArea
    scorer: Scorer
    height: float
    prompt: str
    rejected: Counter[str]


def bench_rooms(
    generator: Generator,
    meshes: Sequence[str | Path] = (),
    tasks: int = 50,
    seed: int = 0,
    samples: int = 4,
    radius: float = RADIUS,
    solver: SolverSettings | None = None,
    facings: Sequence[str] = (),
    stop: bool = True,
    engine: Engine = ENGINE,
) -> Result:
    """Walk through each mesh `tasks` times, with the goals that tasks have by default.

    Args:
        generator: what makes the motions.
        meshes: scans or models in metres, y up; the bundled scenes `FALLBACK` where none is given.
        tasks: walks in each room.
        seed: of starts, targets and motions.
        samples: motions made for each task, of which the first-ranked is scored.
        radius: clearance (m) of starts, targets and paths.
        solver: instead of the default.
        facings: of `meshes.FACINGS`, in each of which every mesh file is walked through; as it is by default.
        stop: whether walks end standing.
        engine: tells progress, keeps rows and goes on from them.

    Returns:
        ``{"summary": ..., "rows": ...}``; metres, seconds, ratios.

    Raises:
        UserError: an unreadable mesh, or a room with no space to walk.
    """
    solver = solver or SolverSettings()
    rooms: list[Room] = []

    def cases() -> Iterator[tuple[str, tuple[Room, int, Task]]]:
        for mesh, facing in product(meshes or FALLBACK, facings or FACINGS[:1]):
            room = room_of(mesh, radius, facing)
            rooms.append(room)
            for i, task in enumerate(walks_in(room, tasks, seed, radius, solver, stop)):
                yield room.name, (room, i, task)

    def walked(case: tuple[Room, int, Task]) -> list[Row]:
        room, i, task = case
        return [{"mesh": room.name, "task": i, **_walk(room, task, generator, samples, seed + i)}]

    def summary(rows: Sequence[Row]) -> dict[str, Any]:
        rejected = {room.name: dict(room.rejected) for room in rooms}
        areas = {room.name: room.area.square_metres for room in rooms}
        return {**_summary(rows), "free_area_m2": areas, "rejected": rejected, "body": DEFAULT_BODY.source}

    settings = {"bench": "rooms", "meshes": meshes, "tasks": tasks, "seed": seed, "samples": samples, "radius": radius}
    total = tasks * len(meshes or FALLBACK) * len(facings or FACINGS[:1])
    return engine.run(cases(), walked, summary, {**settings, "solver": solver, "facings": facings, "stop": stop}, total)


def room_of(mesh: str | Path, radius: float = RADIUS, facing: str = FACINGS[0]) -> Room:
    """A mesh's room in one of `FACINGS`, or a bundled scene of `FALLBACK`."""
    scene = bundled(mesh) if mesh in FALLBACK else load_scene(mesh)
    if facing != FACINGS[0]:
        turned = faced(scene.meshes[0], facing)
        scene = Scene([turned], floor=scene.stated_floor, name=turned.name)
    height, prompt = LOW.get(scene.name, (UPRIGHT, PROMPT))
    area, upright = free_area(scene, radius, height), free_area(scene, radius, UPRIGHT)
    return Room(scene.name, scene, area, upright, Scorer(scene), height, prompt, Counter())


def walks_in(
    room: Room,
    count: int,
    seed: int,
    radius: float = RADIUS,
    solver: SolverSettings | None = None,
    stop: bool = True,
    body: BodySpec | None = None,
) -> Iterator[Task]:
    """Random starts and targets in the free area whose shortest clear path is of walking length."""
    rng = np.random.default_rng(seed)
    for _ in range(count):
        start, target = _places(room, rng, radius)
        yield Task(
            prompt=room.prompt,
            scene=room.scene,
            start=Start(position=(start[0], start[1])),
            walk=Walk(to=(target[0], target[1]), radius=radius, height=room.height, tolerance=CLOSE, stop=stop),
            solver=solver or SolverSettings(),
            body=body,
        )


def _places(room: Room, rng: np.random.Generator, radius: float) -> tuple[list[float], list[float]]:
    for _ in range(TRIES):
        start, target = room.area.sample(2, rng, radius).tolist()
        if not SHORTEST_PATH <= float(np.hypot(start[0] - target[0], start[1] - target[1])) <= LONGEST_PATH:
            room.rejected["too near or too far as the crow flies"] += 1
            continue
        if not room.upright.contains(np.asarray(start), STANDING):
            room.rejected["no room to stand at the start"] += 1
            continue
        try:
            length = walked(room.area.path(start, target, radius))
        except UserError:
            room.rejected["no clear path"] += 1
            continue
        if length <= LONGEST_PATH:
            return start, target
        room.rejected["path too long"] += 1
    raise UserError(_too_small(room, radius))


def _too_small(room: Room, radius: float) -> str:
    """That a room is too small to walk in, how far one gets in it, and what radius would do."""
    longest, smaller = _farthest(room, radius), radius
    while smaller > 0.05 and _farthest(room, smaller) < SHORTEST_PATH:
        smaller = round(smaller - 0.01, 2)
    hint = f"a radius of {smaller:.2f} m would do" if smaller > 0.05 else "it is too small for any"
    return (
        f"room '{room.name}' has no two free places a walk apart for a body of {radius:g} m radius: the longest way "
        f"found is {longest:.2f} m as the crow flies, and a walk is {SHORTEST_PATH:g} to {LONGEST_PATH:g} m; {hint}"
    )


def _farthest(room: Room, radius: float) -> float:
    """How far apart (m) two joined places are, found by going from any to the farthest and from there again."""
    from scipy.ndimage import label

    parts, count = label(room.area.clearance >= radius, structure=np.ones((3, 3)))
    found = 0.0
    for part in range(1, count + 1):
        places = np.argwhere(parts == part) * room.area.cell
        for _ in range(2):
            away = np.linalg.norm(places - places[0], axis=1)
            places = np.roll(places, -int(away.argmax()), axis=0)
        found = max(found, float(np.linalg.norm(places - places[0], axis=1).max()))
    return found


def _walk(room: Room, task: Task, generator: Generator, samples: int, seed: int) -> dict[str, Any]:
    assert task.walk is not None
    setup = task.build(seed, scene=room.scene, spec=generator.spec)
    free = generator.generate(setup.prompts, setup.seconds, setup.start, seed=seed).motion[0]
    result = run(task, samples, seed, generator, setup=setup, scorer=room.scorer)
    motion, path = result.motion[0], setup.path
    assert path is not None
    best = result.samples[0]
    figures, missed = best.metrics, _missed(motion, task.walk.to)
    depth = max(float(figures[key] or 0.0) for key in ("deepest_penetration_m", "deepest_floor_penetration_m"))
    seconds = result.report["timing"]["generate_s"]
    return {
        "start": [float(path[0, 0]), float(path[0, 2])],
        "target": list(task.walk.to),
        "planned_path_m": walked(path),
        "seconds_of_motion": setup.seconds,
        "missed_m": missed,
        "reached": missed <= REACHED,
        "clean": depth <= DEEP,
        "success": missed <= REACHED and depth <= DEEP,
        "close": missed <= CLOSE,
        "shallow": depth <= SHALLOW,
        "quick": seconds <= QUICK,
        "stopped": _stopped(motion, room.scorer),
        "believable": best.believable,
        "sound": depth <= SHALLOW and best.believable,
        "verdict": best.verdict.sentence,
        "sole_on_floor": abs(float(figures["lowest_sole_m"] or 0.0)) <= 0.03,
        **figures,
        "uncontrolled_skating_ratio": float(skating_ratio(free, room.scorer.ground(free) + DEFAULT_BODY.sole_offset)),
        "uncontrolled_max_acceleration_m_per_frame2": float(max_acceleration(free)),
        "uncontrolled_pace_m_per_s": float(metrics.travelled(free)) * free.fps / (free.frames - 1),
        "seconds": seconds,
    }


def _missed(motion: Motion, target: Spot) -> float:
    end = motion.joint("pelvis")[-1, [0, 2]]
    return float((end - torch.tensor([target[0], target[-1]])).norm())


def _stopped(motion: Motion, scorer: Scorer) -> bool:
    """Whether a motion ends standing: the pelvis at rest, both feet down."""
    steps = round(RESTING * motion.fps)
    speed = motion.joint("pelvis")[-steps - 1 :, [0, 2]].diff(dim=0).norm(dim=-1) * motion.fps
    feet = (motion.select(FEET)[..., 1] - scorer.ground(motion) - scorer.body.sole_offset)[-steps - 1 :]
    return bool((speed < STILL).all() and (feet < DOWN).all())


_JUDGED = ("skating_ratio", "max_acceleration_m_per_frame2")
_NATURAL = tuple(f"{way}{key}" for key in _JUDGED for way in ("", "uncontrolled_"))


def _summary(rows: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    def share(key: str) -> float:
        return sum(bool(row[key]) for row in rows) / max(len(rows), 1)

    return {
        "tasks": len(rows),
        "reached_rate": share("reached"),
        "clean_rate": share("clean"),
        "success_rate": share("success"),
        "within_5_cm_rate": share("close"),
        "within_1_cm_deep_rate": share("shallow"),
        "within_1_s_rate": share("quick"),
        "stopped_rate": share("stopped"),
        "believable_rate": share("believable"),
        "within_1_cm_deep_and_believable_rate": share("sound"),
        "sole_on_floor_rate": share("sole_on_floor"),
        "deepest_penetration_m": max(row["deepest_penetration_m"] for row in rows),
        "deepest_floor_penetration_m": max(row["deepest_floor_penetration_m"] for row in rows),
        "mean_share_of_frames_touching": statistics.fmean(row["share_of_frames_touching"] for row in rows),
        **{key: statistics.fmean(row[key] for row in rows) for key in _NATURAL},
        "bone_length_drift_m": max(row["bone_length_drift_m"] for row in rows),
        "median_uncontrolled_pace_m_per_s": statistics.median(row["uncontrolled_pace_m_per_s"] for row in rows),
        "median_seconds": statistics.median(row["seconds"] for row in rows),
        "by_mesh": {
            mesh: sum(row["success"] for row in rows if row["mesh"] == mesh) / sum(row["mesh"] == mesh for row in rows)
            for mesh in dict.fromkeys(row["mesh"] for row in rows)
        },
    }
