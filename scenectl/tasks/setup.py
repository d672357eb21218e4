"""From a task's tables to what a generator needs: scene read, start chosen, way planned, goals checked."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
import torch

from objectives import Context, Objective, Term
from scenectl.generators.prompts import Prompts
from scenectl.generators.spec import Spec
from scenectl.tasks.actions.script import Script, scripted
from scenectl.tasks.actions.state import State, World
from scenectl.tasks.conditions import Target, targets_of
from scenectl.tasks.held import holds, with_held, without_held
from scenectl.tasks.schema import Start, TaskTable, moves
from scenectl.tasks.walk import FASTEST_WALK, WAIT, Schedule, Walk, room_of, seconds_for, walk_terms
from scenes.body.body import DEFAULT_BODY, STATURE, ProxyBody
from scenes.errors import UserError, in_doubt
from scenes.motion.frames import Place
from scenes.motion.motion import Motion, Pose2D
from scenes.world.floor.levels import STEP
from scenes.world.floor.planning import FreeArea, coarse, free_area
from scenes.world.floor.polyline import climbs, walked
from scenes.world.reach import CROUCH, HEAD
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
        prompts: the sentences, with their times.
        script: the planned script, where the task has one.
        unreached: on targets that nobody gets to from the start, and on starts from which that is not known.
    """

    task: TaskTable
    scene: Scene
    body: ProxyBody
    context: Context
    objective: Objective
    start: Pose2D
    seconds: float
    path: np.ndarray | None
    prompts: Prompts
    script: Script | None = None
    unreached: tuple[str, ...] = ()

    def scene_of(self, motion: Motion) -> Scene:
        """The scene with the things that a motion ``[T, J, 3]`` of its frame holds in its hands."""
        return with_held(self.scene, self.objective.counted, motion)

    @property
    def origin(self) -> Place:
        """Where in the world (m) the frame begins."""
        return self.scene.origin

    @property
    def doubts(self) -> tuple[str, ...]:
        """The scene's, and what is unusual about prompts, targets and the walk, one sentence each."""
        doubts = (*self.scene.doubts, *self.prompts.doubts(self.seconds), *self.unreached)
        if self.path is None:
            return doubts
        doubts = (*doubts, *filter(None, [coarse(self.scene)]))
        taken = climbs(self.path, STEP)
        if not len(taken):
            return doubts
        ways = ((taken[taken > 0], "up"), (taken[taken < 0], "down"))
        told = (
            f"{len(some)} step{'s' if len(some) > 1 else ''} {way} of up to {np.abs(some).max():.2f} m"
            for some, way in ways
            if len(some)
        )
        return (*doubts, f"the walk takes {' and '.join(told)}, as no level way exists")


def plan(
    task: TaskTable,
    seed: int | None = None,
    start: Pose2D | None = None,
    scene: Scene | None = None,
    spec: Spec | None = None,
) -> Setup:
    """Everything a generator needs, checked; raises UserError for what cannot be right.

    Args:
        task: its tables.
        seed: of the sampled start, by default the task's.
        start: of a finished motion, which is to be judged, wherever it begins; by default the task's own.
        scene: instead of reading it again.
        spec: of the generator, where it is not the one that the task names.
    """
    scene = task.load_scene() if scene is None else scene
    with in_doubt(lambda: scene.doubts_so_far):
        return _planned(task, seed, start, scene, spec)


def _planned(task: TaskTable, seed: int | None, start: Pose2D | None, scene: Scene, spec: Spec | None) -> Setup:
    spec = task.generator.family.spec if spec is None else spec
    body = task.load_body()
    rng = np.random.default_rng(task.seed if seed is None else seed)
    area = None if task.walk is None else free_area(scene, *task.walk.room(body))
    if start is None:
        place = _place(task, scene, area, rng, spec.window, body)
        _check_standing(scene, place, body)
    else:
        place = _below(scene, start.position)
    free = isinstance(task.start, Start) and task.start.free  # who may start elsewhere may be anywhere
    script = _script(task, World(scene, body, spec), place, start) if task.actions else None
    if script is not None:
        path, seconds, prompts = script.path, script.seconds, script.prompts
    else:
        path = None if task.walk is None or area is None else _path(task.walk, area, place)
        seconds, prompts = _seconds(task, path, spec, body), task.prompts
    prompts.check(seconds)
    if start is None:
        heading = _heading(task, path) if script is None else script.stretches[0].before.heading
        start = Pose2D((place[0], place[1] + body.sole_offset, place[2]), heading)
    objective = Objective((*_led(task, script, path, seconds, spec, body), *task.terms, *_avoided(task, script)))
    scene = without_held(scene, holds(objective.counted, seconds), Context(scene, body))
    reached = scene if free else scene.reached_from(place)
    context = Context(reached, body)
    objective.check(context, seconds, spec.fps)
    unreached = _unreached(reached, targets_of(objective, context, start, seconds, spec), place[1])
    unreached += () if free else _astray(reached, place)
    return Setup(task, scene, body, context, objective, start, seconds, path, prompts, script, unreached)


def _led(
    task: TaskTable, script: Script | None, path: np.ndarray | None, seconds: float, spec: Spec, body: ProxyBody
) -> Iterable[Term]:
    """The goals of the actions, or of the walk."""
    if script is not None:
        return script.terms
    return () if task.walk is None or path is None else walk_terms(task.walk, path, seconds, spec.fps, task.terms, body)


def _avoided(task: TaskTable, script: Script | None) -> tuple[Term, ...]:
    return task.avoided if script is None else task.avoiding(script.path is not None, script.touches)


def _script(task: TaskTable, world: World, place: Place, start: Pose2D | None) -> Script:
    """The script planned from the start; who is not told which way to face at first faces the first way to go.

    Of a finished motion only what the task does not state counts, so that its script has the times it was made for.
    """
    stated = task.start.heading if isinstance(task.start, Start) else None
    if isinstance(task.start, Start):
        place = _stated(world.scene, task.start)
    heading = stated if stated is not None else 0.0 if start is None else start.heading
    if stated is None and (way := task.script[0].act(world, State(place, heading)).path) is not None:
        heading = heading_along(way)
    return scripted(task.script, world, State(place, heading))


def _unreached(scene: Scene, targets: Iterable[Target], ground: float) -> tuple[str, ...]:
    """On targets beyond the free space that the start is connected to: which goal's, where, and how far beyond.

    A height that is free is looked at a metre over the start's ground (m).
    """
    if scene.reach is None:
        return ()
    told = []
    for term, joint, _, where in targets:
        places = where.double().numpy()
        depths = scene.reach.depth(np.where(np.isnan(places), [np.nan, ground + 1.0, np.nan], places))
        if len(depths) and np.nanmax(depths, initial=0.0) > 0:
            worst = int(np.nanargmax(depths))
            at = places[worst] if np.isfinite(places[worst]).all() else places[worst, ::2]
            whose = "" if joint is None else f" of {joint}"
            told.append(
                f"{term.label}: the target {_at(scene, at)}{whose} lies {depths[worst]:.2f} m outside of the free "
                "space that the start is connected to"
            )
    return tuple(dict.fromkeys(told))


def _astray(scene: Scene, place: tuple[float, float, float]) -> tuple[str, ...]:
    """On starts of finished motions, which may lie anywhere: which free space they are taken to be connected to."""
    if scene.parts is None:
        return ()
    if scene.reach is None:
        return (f"there is no ground under the start {_at(scene, place)}, so all free space counts as connected to it",)
    x, y, z = place
    heights = torch.linspace(CROUCH, HEAD, 8)
    column = torch.stack([torch.full_like(heights, x), y + heights, torch.full_like(heights, z)], dim=-1)
    if bool((scene.distance(column, torch.zeros(len(heights))) > 0).any()):
        return ()
    return (f"the start {_at(scene, place)} lies in a solid, so the free space nearest to it counts as its own",)


def _place(
    task: TaskTable, scene: Scene, area: FreeArea | None, rng: np.random.Generator, window: float, body: ProxyBody
) -> tuple[float, float, float]:
    """Ground point of the start: stated, sampled, or the origin."""
    if isinstance(task.start, Start):
        return _stated(scene, task.start)
    if task.start is None and not (scene.meshes or scene.primitives or scene.objects):
        return 0.0, scene.floor.height, 0.0
    area = free_area(scene, *room_of(body)) if area is None else area
    if task.walk is None:
        x, z = (float(value) for value in area.sample(1, rng, area.radius + 0.1)[0])
        return x, _ground(scene, x, z), z
    storeys = sorted({0, area.storey(task.walk.to)}, reverse=True)
    tries = [(k, *place) for k in storeys for place in area.sample(64, rng, storey=k).tolist()]
    for storey, x, z in tries:
        ground = float(area.sheets[storey].ground(np.array([[x, z]]))[0]) if storey else _ground(scene, x, z)
        place = (x, ground, z)
        try:
            length = walked(task.walk.path(area, place))
        except UserError:
            continue
        if 1.0 <= length <= 0.75 * FASTEST_WALK * body.size * min(task.seconds or window, window):
            return place
    raise UserError(f"no free start from which {_at(scene, task.walk.to)} can be walked to was found; state 'start'")


def _stated(scene: Scene, start: Start) -> Place:
    """Ground point of a stated start."""
    p = start.position
    return (p[0], _ground(scene, p[0], p[1]), p[1]) if len(p) == 2 else (p[0], p[1], p[2])


def _ground(scene: Scene, x: float, z: float) -> float:
    """Height (m) of the ground at a place, nearest to the floor's; the floor's where there is none."""
    height = float(scene.ground_at(x, z))
    return scene.floor.height if math.isnan(height) else height


def _below(scene: Scene, place: tuple[float, float, float]) -> tuple[float, float, float]:
    """The ground under a place that may hang in the air or lie a little in the ground; itself where there is none."""
    x, y, z = place
    height = float(scene.ground_at(x, z, y + GROUND))
    return x, y if math.isnan(height) else height, z


def _path(walk: Walk, area: FreeArea, place: tuple[float, float, float]) -> np.ndarray:
    try:
        return walk.path(area, place)
    except UserError as error:
        raise UserError(f"walk: {error}") from error


def _heading(task: TaskTable, path: np.ndarray | None) -> float:
    if isinstance(task.start, Start) and task.start.heading is not None:
        return task.start.heading
    return 0.0 if path is None else heading_along(path)


def _seconds(task: TaskTable, path: np.ndarray | None, spec: Spec, body: ProxyBody) -> float:
    if path is None or task.walk is None:
        assert task.seconds is not None
        return task.seconds
    walk, length = task.walk, walked(path)
    seconds = task.seconds
    if seconds is None:
        waiting = WAIT if any(map(moves, task.scene.objects)) else 0.0
        seconds = max(round(seconds_for(walk, length, body) + waiting, 1), spec.shortest)
        if seconds > spec.longest:
            raise UserError(
                f"walk: the path is {length:.1f} m long, {seconds:g} s at a walk, and a motion lasts {spec.longest:g} "
                "s at most; give a nearer target"
            )
    if walk.arrive is not None and not 0 < walk.arrive <= seconds:
        more = ", or state more 'seconds'" if task.seconds is None else ""
        raise UserError(f"walk: 'arrive' is {walk.arrive:g} s; give a time within the {seconds:g} s of the task{more}")
    arrive = seconds if walk.arrive is None else walk.arrive
    walking = Schedule.of(walk, seconds, spec.fps).walking if walk.stop else arrive
    fastest = FASTEST_WALK * body.size
    if length > fastest * walking:
        unstopped = " and stop (stop = false walks on)" if length <= fastest * arrive else ""
        raise UserError(
            f"walk: the path is {length:.1f} m long, too far to walk in {arrive:g} s{unstopped} "
            f"({length / walking:.1f} m/s); give more seconds or a nearer target"
        )
    return seconds


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
    heights = torch.linspace(0.35, 1.5, 8) * body.height / STATURE
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
