"""From a task's tables to what a generator needs: scene read, start chosen, way planned, goals checked."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch

from objectives import Context, Objective
from scenectl.generators.spec import Spec
from scenectl.tasks.schema import Start, TaskTable, Walk
from scenectl.tasks.walk import FASTEST_WALK, Schedule, joined, seconds_for, walk_terms
from scenes.body.body import DEFAULT_BODY, ProxyBody
from scenes.errors import UserError, in_doubt
from scenes.motion.frames import Place
from scenes.motion.motion import Motion, Pose2D
from scenes.world.floor.levels import STEP
from scenes.world.floor.planning import FreeArea, free_area
from scenes.world.floor.polyline import climbs, walked
from scenes.world.scene import Scene

STANDING = 0.12
"""Metres from the vertical through a start within which an obstacle leaves no room to stand."""
GROUND = 0.2
"""Metres from the ground point of a start to the nearest surface beyond which it hangs in the air."""


@dataclass(frozen=True)
class Setup:
    """A task made concrete: read, planned and checked.

    All but the task is stated in the frame that begins at `origin`: the world's, or one near a scene that is far from
    the world's origin.

    Attributes:
        task: what it was made from.
        scene, body, context, objective: what goals look at, and the goals, those of `walk` first.
        start: rigid transform of the canonical motion, metres and radians.
        seconds: length.
        path: the planned walk, ``[P, 3]`` metres on the ground, or None.
    """

    task: TaskTable
    scene: Scene
    body: ProxyBody
    context: Context
    objective: Objective
    start: Pose2D
    seconds: float
    path: np.ndarray | None

    @property
    def origin(self) -> Place:
        """Where in the world (m) the frame begins."""
        return self.scene.origin

    @property
    def doubts(self) -> tuple[str, ...]:
        """The scene's, and what is unusual about the walk, one sentence each."""
        taken = np.zeros(0) if self.path is None else climbs(self.path, STEP)
        if not len(taken):
            return self.scene.doubts
        ways = ((taken[taken > 0], "up"), (taken[taken < 0], "down"))
        unstopped = " and stop (stop = false walks on)" if length <= FASTEST_WALK * arrive else ""
        raise UserError(
            f"walk: the path is {length:.1f} m long, too far to walk in {arrive:g} s{unstopped} "
            f"({length / walking:.1f} m/s); give more seconds or a nearer target"
        )

    return task.seconds


def heading_along(path: np.ndarray) -> float:
    """Direction (rad about +y) of the first 0.3 m of a polyline ``[P, 3]``; 0 when it has no length."""
    here = path[0]
    ahead = next((p for p in path if math.hypot(p[0] - here[0], p[2] - here[2]) >= 0.3), path[-1])
    dx, dz = float(ahead[0] - here[0]), float(ahead[2] - here[2])
    return math.atan2(dx, dz) if (dx, dz) != (0.0, 0.0) else 0.0


def start_of(motion: Motion, body: ProxyBody = DEFAULT_BODY) -> Pose2D:
    """Where one finished motion stood at its first frame, ``[T, J, 3]``: for scoring it."""
    joints = motion.joints[0]
    names = motion.skeleton
    across = sum(
        (joints[names.index(f"left_{part}")] - joints[names.index(f"right_{part}")] for part in ("hip", "shoulder")),
        start=torch.zeros(3),
    )
    x, _, z = motion.joint("pelvis")[0].tolist()
    y = float(motion.select(("left_foot", "right_foot"))[0, :, 1].min()) - body.sole_offset
    return Pose2D((x, y, z), math.atan2(-float(across[2]), float(across[0])))


def _check_standing(scene: Scene, place: tuple[float, float, float], body: ProxyBody) -> None:
    """A person upright at the start must not be inside anything."""
    x, y, z = place
    (low, high), (ox, _, oz) = np.asarray(scene.bounds), scene.origin
    if not (low[0] - 0.5 <= x <= high[0] + 0.5 and low[2] - 0.5 <= z <= high[2] + 0.5):
        raise UserError(
            f"start {_at(scene, (x, z))} lies outside the scene, which spans x {low[0] + ox:.2f} to {high[0] + ox:.2f} "
            f"and z {low[2] + oz:.2f} to {high[2] + oz:.2f} m"
        )
    heights = torch.linspace(0.35, 1.5, 8)
    column = torch.stack([torch.full_like(heights, x), y + heights, torch.full_like(heights, z)], dim=-1)
    clearance = scene.distance(column, torch.zeros(len(heights)))
    ground = float(scene.distance(torch.tensor([[x, y, z]]), torch.zeros(1)))
    if ground > GROUND:
        raise UserError(
            f"start {_at(scene, place)} has nothing to stand on: the nearest surface is {ground:.2f} m away"
        )
    worst = int(clearance.argmin())
    if float(clearance[worst]) < STANDING:
        raise UserError(
            f"start {_at(scene, (x, z))} is inside or against an obstacle (clearance {float(clearance[worst]):.2f} m "
            f'at height {float(heights[worst]):.1f} m); move it, or use start = "sample"'
        )


def _at(scene: Scene, place: Sequence[float] | np.ndarray) -> str:
    """A place of the scene's frame, [x, z] or [x, y, z], as the world states it."""
    origin = scene.origin if len(place) == 3 else scene.origin[::2]
    return "[" + ", ".join(f"{float(value) + begin:.2f}" for value, begin in zip(place, origin, strict=True)) + "]"
