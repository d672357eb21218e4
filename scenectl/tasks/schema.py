"""Tasks: a prompt, a scene, a start and goals, from a TOML file or from Python.

A task is data. Loading one reads files that it names and runs no code from any of them.
"""

from __future__ import annotations

import math
import tomllib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass
from functools import cached_property
from itertools import pairwise
from pathlib import Path
from typing import Annotated, Any, Literal, TypeAlias, TypeVar

import numpy as np
import torch
from pydantic import BaseModel, ConfigDict, Field, ValidationError, model_validator

from objectives import Context, Objective, Term
from scenectl.control.settings import GuidanceSettings, SolverSettings
from scenectl.generators.mscot.bundle import bundled_weights
from scenes.body.body import DEFAULT_BODY, ProxyBody
from scenes.body.proxies import load_body
from scenes.errors import UserError, did_you_mean
from scenes.mesh.mesh import Mesh, load_mesh
from scenes.mesh.primitives import PRIMITIVES, Primitive, primitive
from scenes.motion.motion import Motion, Pose2D
from scenes.sdf.bake import Bake
from scenes.sdf.grid import SdfGrid
from scenes.validation import sentence
from scenes.world.floor import FreeArea, free_area, path_length, resample
from scenes.world.moving import MovingObject, Trajectory
from scenes.world.scene import BUNDLED, Scene, bundled, bundled_names, load_scene

FASTEST_WALK = 1.6
"""Metres a second beyond which a path is refused as too long for its task: a brisk walk."""
PACE = 1.4
"""Metres a second at which tasks without `seconds` are timed: a person's usual pace. The shipped generators', standing
included, is a little less (`scenectl bench rooms` prints it); whoever is led more slowly takes lower steps."""
FPS = 20.0
"""Frames a second of the shipped generators; tasks are checked on this clock."""
GROUND = 0.2
"""Metres from the ground point of a start to the nearest surface beyond which it hangs in the air."""
SHORTEST, LONGEST = 1.8, 60.0
"""Seconds of a motion; those beyond `ONE_PASS` are made as windows that are guided to agree."""
ONE_PASS = 9.8
"""Seconds that the generators make at once (196 frames); sampled starts are no further than that from their target."""

Unit: TypeAlias = Literal["m", "cm", "mm", "in", "ft"]
Axis: TypeAlias = Literal["x", "y", "z"]
Resolution: TypeAlias = Annotated[int, Field(ge=8, le=512)]

Given = TypeVar("Given")
Made = TypeVar("Made")


class _Table(BaseModel):
    """A table of a task file: unknown keys are errors that name the nearest known one."""

    model_config = ConfigDict(extra="forbid", arbitrary_types_allowed=True, populate_by_name=True, frozen=True)


class ObjectSpec(_Table):
    """A rigid object that moves: a mesh file or a primitive, in a frame of its own, and where that frame is over time.

    Attributes:
        mesh: file (GLB, glTF, OBJ, PLY, STL, OFF).
        primitive: a table as in `scene.primitives`, instead of a mesh.
        times: seconds, increasing.
        positions: of the frame's origin at those times, [x, y, z] each, world metres; straight lines between them.
        headings: radians about +y at those times, pi/2 turns +z to +x; even turns the shorter way between them.
        quaternions: rotations [w, x, y, z] instead of headings.
        name: for reports; by default the file's.
        unit, up: of the file, as for a scene.
        resolution: nodes along the longest side of the mesh's own distance grid.
    """

    mesh: Path | None = None
    primitive: dict[str, Any] | None = None
    times: tuple[float, ...]
    positions: tuple[tuple[float, float, float], ...]
    headings: tuple[float, ...] | None = None
    quaternions: tuple[tuple[float, float, float, float], ...] | None = None
    name: str = ""
    unit: Unit | None = None
    up: Axis | None = None
    resolution: Resolution = 128

    def build(self) -> MovingObject:
        """Read the mesh; raises UserError for what cannot be right. Nothing is baked yet."""
        if (self.mesh is None) == (self.primitive is None):
            raise UserError("an object needs either 'mesh' or 'primitive'")
        trajectory = Trajectory(self.times, self.positions, self.headings, self.quaternions)
        if self.mesh is not None:
            return MovingObject(load_mesh(self.mesh, self.unit, self.up), trajectory, self.name, self.resolution)
        if given := self.model_fields_set & {"unit", "up", "resolution"}:
            raise UserError(f"'{min(given)}' is for meshes, and this object is a primitive; leave it out")
        assert self.primitive is not None
        return MovingObject(_shape(self.primitive), trajectory, self.name)


class SceneSpec(_Table):
    """Which scene: a bundled one or a mesh file, and primitives; with neither, an empty floor.

    Attributes:
        bundled: name of a scene that comes with the package.
        file: mesh file (GLB, glTF, OBJ, PLY, STL, OFF).
        unit, up: of the file, where it does not say ("m", "cm", "mm", "in", "ft"; "x", "y", "z").
        floor: height (m) on which soles stand; by default found in the mesh.
        free_space: "auto", "outside" or a point [x, y, z] in the air.
        resolution: nodes along the longest side of the distance grid.
        spacing: metres between nodes instead, for large scenes: fine near surfaces, coarse elsewhere.
        thickness: metres that walls of the file without thickness, or with less, are given.
        primitives: tables with `shape` ("box", "sphere", "capsule", "cylinder", "plane") and its parameters.
        objects: what moves (`ObjectSpec`), [[scene.objects]] tables.
    """

    bundled: str | None = None
    file: Path | None = None
    unit: Unit | None = None
    up: Axis | None = None
    floor: float | None = None
    free_space: Literal["auto", "outside"] | tuple[float, float, float] = "auto"
    resolution: Resolution = 256
    spacing: float | None = None
    thickness: float = 0.0
    primitives: tuple[dict[str, Any], ...] = ()
    objects: tuple[ObjectSpec, ...] = ()

    def build(self) -> Scene:
        """Read the files; raises UserError for what cannot be read. Nothing is baked yet."""
        shapes = [_named(f"primitive {k + 1}", _shape, table) for k, table in enumerate(self.primitives)]
        objects = [_named(f"object {k + 1}", ObjectSpec.build, spec) for k, spec in enumerate(self.objects)]
        more: dict[str, Any] = {"objects": objects, "thickness": self.thickness, "spacing": self.spacing}
        if self.bundled is not None and self.file is not None:
            raise UserError("scene states both 'bundled' and 'file'; keep one of them")
        if self.bundled is not None:
            given = self.model_fields_set & {"unit", "up", "floor", "free_space"}
            if given:
                raise UserError(f"scene: '{min(given)}' is known for the bundled scene '{self.bundled}'; leave it out")
            return bundled(self.bundled, self.resolution, shapes, **more)
        if self.file is not None:
            told = (self.unit, self.up, self.floor, self.resolution, self.free_space)
            return load_scene(self.file, *told, primitives=shapes, **more)
        name = "primitives" if shapes else "objects" if objects else "empty"
        return Scene(primitives=shapes, floor=self.floor or 0.0, name=name, objects=objects)


class Start(_Table):
    """Where the person stands at first.

    Attributes:
        position: [x, z] on the floor, or [x, y, z] with the height of the ground there; world metres.
        heading: radians about +y, 0 faces +z and pi/2 faces +x; by default along the walk, else 0.
        free: place and heading are solved for along with the motion, each sample's own, from here on.
    """

    position: tuple[float, float] | tuple[float, float, float]
    heading: float | None = None
    free: bool = False


class Walk(_Table):
    """Walk to a place: the planner's path becomes `follow_path`, its end a `joint_target` of the pelvis.

    Attributes:
        to: where the pelvis shall be in the end, [x, z], world metres.
        via: places to pass on the way, in order, a list of [x, z].
        radius: of the body while planning (m).
        height: that shall be free along the path (m); less where the person shall duck.
        arrive: when (s); by default at the end.
        half_width: of the corridor around the path (m).
        tolerance: how near counts as reached (m).
        weight: of both goals.
    """

    to: tuple[float, float]
    via: tuple[tuple[float, float], ...] = ()
    radius: Annotated[float, Field(gt=0.05, le=1.0)] = 0.3
    height: Annotated[float, Field(gt=0.3, le=3.0)] = 1.8
    arrive: float | None = None
    half_width: Annotated[float, Field(gt=0)] = 0.2
    tolerance: Annotated[float, Field(gt=0)] = 0.1
    weight: Annotated[float, Field(ge=0)] = 1.0

    def path(self, area: FreeArea, start: tuple[float, float]) -> np.ndarray:
        """The planner's way from `start` (x, z) over `via` to `to`, ``[P, 3]``; UserError when there is none."""
        stops = [start, *self.via, self.to]
        legs = [area.path(a, b, self.radius) for a, b in pairwise(stops)]
        return np.concatenate([legs[0], *(leg[1:] for leg in legs[1:])])

    def terms(self, path: np.ndarray, seconds: float) -> list[Term]:
        """The two goals for a path ``[P, 3]``: a corridor with a schedule, and the place at its end."""
        last = seconds - 1 / FPS
        arrive = last if self.arrive is None else min(self.arrive, last)
        end = [float(path[-1, 0]), float(path[-1, 2])]
        target = {"joint": "pelvis", "position": end}
        terms = [Term("joint_target", target, self.weight, self.tolerance, at=arrive, name="walk: arrive")]
        if path_length(path) < 0.05:
            return terms
        corridor = {
            "path": resample(path[:, [0, 2]], 0.2).tolist(),  # the planner's 5 cm would only cost time
            "half_width": self.half_width,
            "begin": 0.0,
            "end": arrive,
        }
        return [Term("follow_path", corridor, self.weight, name="walk: path"), *terms]


class GeneratorSpec(_Table):
    """Which generator makes the motion.

    Attributes:
        name: of a registered generator.
        weights: "default" or "permissive" for those that come with the package, or a folder.
        threads: for its arithmetic; by default what torch chooses, one for each core: a second one makes control a
            sixth faster (`scenectl bench control --threads`).
        cfg: scale of classifier-free guidance.
        temperature, top_p: of the draw.
        clip_nats, clip_coarsest: largest tilt that goals may give a token's logits, and its share at the coarsest
            scale (`scenectl.generators.mscot.sampling.Sampling`).

    What is left out is the generator's own default.
    """

    name: str = "mscot"
    weights: str = "default"
    threads: Annotated[int, Field(ge=1)] | None = None
    cfg: Annotated[float, Field(ge=0)] | None = None
    temperature: Annotated[float, Field(gt=0)] | None = None
    top_p: Annotated[float, Field(gt=0, le=1)] | None = None
    clip_nats: Annotated[float, Field(ge=0)] | None = None
    clip_coarsest: Annotated[float, Field(gt=0, le=1)] | None = None


class Task(_Table):
    """What shall happen: see the attributes for the keys of a task file.

    Attributes:
        prompt: a sentence.
        seconds: length, 1.8 to 60; with `walk` it may be left out and follows from the path.
        scene: a bundled scene's name, a mesh file, a table (`SceneSpec`) or, in Python, a `Scene`.
        start: "sample" (a free place, chosen by the seed) or a table (`Start`); by default sampled in a scene with
            obstacles and the origin without.
        walk: where to walk (`Walk`), planned around the obstacles.
        body: file that `scenectl body CHARACTER --json` wrote, for a character with our 22 joints; by default an adult.
        goals: [[goal]] tables or `Term` objects.
        generator, solver, guidance: settings.
        samples: motions to make; the best by the objective comes first.
        seed: of everything random.
        folder: where relative paths are looked for; the task file's own.
    """

    prompt: Annotated[str, Field(min_length=1)]
    seconds: Annotated[float, Field(ge=SHORTEST, le=LONGEST)] | None = None
    scene: SceneSpec | Scene = SceneSpec()
    start: Literal["sample"] | Start | None = None
    walk: Walk | None = None
    body: Path | None = None
    goals: Annotated[tuple[Any, ...], Field(alias="goal")] = ()
    generator: GeneratorSpec = GeneratorSpec()
    solver: SolverSettings = SolverSettings()
    guidance: GuidanceSettings = GuidanceSettings()
    samples: Annotated[int, Field(ge=1, le=256)] = 1
    seed: Annotated[int, Field(ge=0, lt=2**63)] = 0
    folder: Path | None = None

    def __init__(self, **data: Any) -> None:
        try:
            super().__init__(**data)
        except ValidationError as error:
            raise UserError(sentence(error, data, Task, hidden=("folder",))) from error
        if self.walk is not None and isinstance(self.start, Start) and self.start.free:
            raise UserError("start: 'free' cannot be solved for with a [walk], which is planned from it; keep one")
        if self.seconds is None and self.walk is None:
            raise UserError(f"'seconds' is missing; give {SHORTEST:g} to {LONGEST:g}")
        _ = self.terms  # unknown goals and parameters are errors of the task, not of its run

    @model_validator(mode="before")
    @classmethod
    def _resolved(cls, data: Any) -> Any:
        """Names and paths of the scene as tables, relative to `folder`; world-only tables as they are."""
        if not isinstance(data, Mapping):
            return data
        data = dict(data)
        folder = Path(data.get("folder") or ".")
        if isinstance(data.get("scene"), str | Path):
            data["scene"] = _named_scene(str(data["scene"]), folder)
        if isinstance(data.get("scene"), Mapping):
            data["scene"] = _beside(folder, data["scene"], "file")
            if isinstance(things := data["scene"].get("objects"), list | tuple):
                data["scene"]["objects"] = [_beside(folder, t, "mesh") if isinstance(t, Mapping) else t for t in things]
        weights = data.get("generator", {}).get("weights") if isinstance(data.get("generator"), Mapping) else None
        if isinstance(weights, str) and weights not in ("default", *bundled_weights()):
            data["generator"] = {**data["generator"], "weights": str(folder / weights)}
        if isinstance(data.get("body"), str | Path):
            data["body"] = folder / data["body"]
        if isinstance(data.get("start"), list | tuple):
            data["start"] = {"position": data["start"]}
        return data

    @cached_property
    def terms(self) -> tuple[Term, ...]:
        """The goals as terms, without those of `walk`, which depend on the start."""
        return tuple(g if isinstance(g, Term) else Term.from_table(_mapping(g), self.folder) for g in self.goals)

    def load_scene(self) -> Scene:
        """The scene, read but not yet baked."""
        return self.scene if isinstance(self.scene, Scene) else self.scene.build()

    def load_body(self) -> ProxyBody:
        """The body that touches things: of the file, or an adult's."""
        return DEFAULT_BODY if self.body is None else load_body(self.body)

    def build(self, seed: int | None = None, start: Pose2D | None = None, scene: Scene | None = None) -> Problem:
        """Everything a generator needs, checked; raises UserError for what cannot be right.

        Args:
            seed: of the sampled start, by default the task's.
            start: instead of the task's own, as when a finished motion is scored.
            scene: instead of reading it again.
        """
        scene = self.load_scene() if scene is None else scene
        body = self.load_body()
        context = Context(scene, body)
        rng = np.random.default_rng(self.seed if seed is None else seed)
        area = None if self.walk is None else free_area(scene, self.walk.radius, self.walk.height)
        place = self._place(scene, area, rng) if start is None else start.position
        _check_standing(scene, place, body)
        path = None if self.walk is None or area is None else self._path(area, place)
        seconds = self._seconds(path)
        if start is None:
            start = Pose2D((place[0], place[1] + body.sole_offset, place[2]), self._heading(path))
        walk = [] if self.walk is None or path is None else self.walk.terms(path, seconds)
        objective = Objective((*walk, *self.terms))
        objective.check(context, seconds, FPS)
        return Problem(self, scene, body, context, objective, start, seconds, path)

    def _place(self, scene: Scene, area: FreeArea | None, rng: np.random.Generator) -> tuple[float, float, float]:
        """Ground point of the start: stated, sampled, or the origin."""
        ground = scene.floor.height
        if isinstance(self.start, Start):
            p = self.start.position
            return (p[0], ground, p[1]) if len(p) == 2 else (p[0], p[1], p[2])
        if self.start is None and not (scene.meshes or scene.primitives or scene.objects):
            return 0.0, ground, 0.0
        area = free_area(scene) if area is None else area
        if self.walk is None:
            x, z = area.sample(1, rng, 0.4)[0]
            return float(x), ground, float(z)
        for x, z in area.sample(64, rng, self.walk.radius):
            try:
                length = path_length(self.walk.path(area, (float(x), float(z))))
            except UserError:
                if not area.contains(np.asarray(self.walk.to), self.walk.radius):
                    raise  # the target itself is the trouble, no start will help
                continue
            if 1.0 <= length <= 0.75 * FASTEST_WALK * min(self.seconds or ONE_PASS, ONE_PASS):
                return float(x), ground, float(z)
        raise UserError(f"no free start from which {_at(self.walk.to)} can be walked to was found; state 'start'")

    def _path(self, area: FreeArea, place: tuple[float, float, float]) -> np.ndarray:
        assert self.walk is not None
        try:
            return self.walk.path(area, (place[0], place[2]))
        except UserError as error:
            raise UserError(f"walk: {error}") from error

    def _heading(self, path: np.ndarray | None) -> float:
        if isinstance(self.start, Start) and self.start.heading is not None:
            return self.start.heading
        return 0.0 if path is None else heading_along(path)

    def _seconds(self, path: np.ndarray | None) -> float:
        if path is None:
            assert self.seconds is not None
            return self.seconds
        length = path_length(path)
        if self.seconds is None:
            seconds = max(round(length / PACE, 1), SHORTEST)
            if seconds > LONGEST:
                raise UserError(
                    f"walk: the path is {length:.1f} m long, {seconds:g} s at a walk, and a motion lasts {LONGEST:g} s "
                    "at most; give a nearer target"
                )
            return seconds
        arrive = self.walk.arrive if self.walk is not None and self.walk.arrive is not None else self.seconds
        if not 0 < arrive <= self.seconds:
            raise UserError(f"walk: 'arrive' is {arrive:g} s; give a time within the {self.seconds:g} s of the task")
        if length > FASTEST_WALK * arrive:
            raise UserError(
                f"walk: the path is {length:.1f} m long, too far to walk in {arrive:g} s "
                f"({length / arrive:.1f} m/s); give more seconds or a nearer target"
            )
        return self.seconds

    def dump(self) -> dict[str, Any]:
        """Plain values that `Task(**values)` builds the same task from, as far as its scene comes from files."""
        values = self.model_dump(mode="json", by_alias=False, exclude={"scene", "goals"})
        scene = self.scene
        table = _scene_table(scene) if isinstance(scene, Scene) else scene.model_dump(mode="json", exclude_unset=True)
        values["scene"] = table
        values["goals"] = [_term_table(g) if isinstance(g, Term) else _plain(g) for g in self.goals]
        return values


@dataclass(frozen=True)
class Problem:
    """A task made concrete: read, planned and checked.

    Attributes:
        task: what it was made from.
        scene, body, context, objective: what goals look at, and the goals, those of `walk` first.
        start: rigid transform of the canonical motion, world metres and radians.
        seconds: length.
        path: the planned walk, ``[P, 3]`` world metres at floor height, or None.
    """

    task: Task
    scene: Scene
    body: ProxyBody
    context: Context
    objective: Objective
    start: Pose2D
    seconds: float
    path: np.ndarray | None


def load_task(path: str | Path) -> Task:
    """Read a task file; raises UserError naming the file for anything that is wrong in it."""
    path = Path(path)
    try:
        text = path.read_text(encoding="utf-8")
    except FileNotFoundError as error:
        raise UserError(f"task file '{path}' does not exist") from error
    except (OSError, UnicodeDecodeError) as error:
        raise UserError(f"task file '{path}' cannot be read as text ({error})") from error
    try:
        table = tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        raise UserError(f"task file '{path}' is not valid TOML: {error}") from error
    try:
        for key in ("folder", "goals"):  # names for Python; in a file the one is implied and the other [[goal]]
            if key in table:
                raise UserError(f"unknown key '{key}'{did_you_mean(key, _keys(Task))}")
        return Task(**table, folder=path.resolve().parent)
    except UserError as error:
        raise UserError(f"task file '{path}': {error}") from error


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
    low, high = np.asarray(scene.bounds)
    if not (low[0] - 0.5 <= x <= high[0] + 0.5 and low[2] - 0.5 <= z <= high[2] + 0.5):
        raise UserError(
            f"start {_at((x, z))} lies outside the scene, which spans x {low[0]:.2f} to {high[0]:.2f} and "
            f"z {low[2]:.2f} to {high[2]:.2f} m"
        )
    heights = torch.linspace(0.35, 1.5, 8)
    column = torch.stack([torch.full_like(heights, x), y + heights, torch.full_like(heights, z)], dim=-1)
    clearance = scene.distance(column, torch.zeros(len(heights)))
    ground = float(scene.distance(torch.tensor([[x, y, z]]), torch.zeros(1)))
    if ground > GROUND:
        raise UserError(f"start {_at(place)} has nothing to stand on: the nearest surface is {ground:.2f} m away")
    worst = int(clearance.argmin())
    if float(clearance[worst]) < 0.12:
        raise UserError(
            f"start {_at((x, z))} is inside or against an obstacle (clearance {float(clearance[worst]):.2f} m at "
            f'height {float(heights[worst]):.1f} m); move it, or use start = "sample"'
        )


def _at(place: Sequence[float]) -> str:
    return "[" + ", ".join(f"{float(value):.2f}" for value in place) + "]"


def _named_scene(name: str, folder: Path) -> dict[str, Any]:
    """A scene given by one word: a bundled name, or a file beside the task."""
    if name in bundled_names():
        return {"bundled": name}
    if (folder / name).is_file() or Path(name).suffix:
        return {"file": name}  # a missing file is reported by the loader
    raise UserError(
        f"scene '{name}' is neither a bundled scene nor a file beside the task{did_you_mean(name, bundled_names())}"
    )


def _beside(folder: Path, table: Mapping[str, Any], key: str) -> dict[str, Any]:
    """A table whose file, where it names one, is looked for in `folder`."""
    return {**table, key: folder / table[key]} if isinstance(table.get(key), str | Path) else dict(table)


def _named(what: str, build: Callable[[Given], Made], given: Given) -> Made:
    """Build a part of the scene; what is wrong with it says which part it is."""
    try:
        return build(given)
    except (TypeError, ValueError) as error:
        raise UserError(f"scene: {what}: {error}") from error


def _shape(table: Mapping[str, Any]) -> Primitive:
    if "shape" not in table:
        raise UserError("a primitive needs 'shape', such as shape = \"box\"")
    return primitive(
        str(table["shape"]), **{k: tuple(v) if isinstance(v, list) else v for k, v in table.items() if k != "shape"}
    )


def _scene_table(scene: Scene) -> dict[str, Any] | str:
    """A scene built in Python as the table that would build it; its name where its meshes are in no file."""
    shapes = [_shape_table(shape) for shape in scene.primitives]
    objects = [_object_table(thing) for thing in scene.objects]
    if len(scene.meshes) > 1 or None in objects:
        return scene.name
    facts: dict[str, Any] = {"resolution": scene.resolution, "primitives": shapes, "objects": objects}
    if not scene.meshes:
        return {**facts, "floor": scene.stated_floor}
    mesh = scene.meshes[0]
    if not Path(mesh.source).is_file():
        return scene.name
    voxels: dict[str, Any] = {"thickness": scene.thickness} if scene.thickness else {}
    if scene.spacing is not None:
        voxels["spacing"] = scene.spacing
    if Path(mesh.source).parent == BUNDLED:
        return {**facts, **voxels, "bundled": mesh.name}
    told = {"unit": mesh.unit, "up": mesh.up, "floor": scene.stated_floor, "free_space": scene.free_space}
    return {**facts, "file": str(Path(mesh.source).resolve()), **voxels, **_plain(told)}


def _object_table(thing: MovingObject) -> dict[str, Any] | None:
    """An object built in Python as the [[scene.objects]] table that would build it; None where it is in no file."""
    told = {"name": thing.name, **_plain(asdict(thing.trajectory))}
    shape = thing.shape
    if isinstance(shape, Mesh):
        file = {"mesh": str(Path(shape.source).resolve()), "unit": shape.unit, "up": shape.up}
        return {**told, **file, "resolution": thing.resolution} if Path(shape.source).is_file() else None
    return None if isinstance(shape, Bake | SdfGrid) else {**told, "primitive": _shape_table(shape)}


def _shape_table(shape: Primitive) -> dict[str, Any]:
    name = next(name for name, kind in PRIMITIVES.items() if type(shape) is kind)
    return {"shape": name, **_plain(asdict(shape))}


def _mapping(value: Any) -> Mapping[str, Any]:
    if not isinstance(value, Mapping):
        raise UserError(f"a goal must be a [[goal]] table, not {value!r}")
    return value


def _term_table(term: Term) -> dict[str, Any]:
    """A term built in Python as the [[goal]] table that would build it."""
    keys = ("weight", "tolerance", "at", "weights", "window", "sometime", "kernel", "reduction", "delta", "name")
    options = {key: getattr(term, key) for key in keys if getattr(term, key) is not None}
    return {"use": term.goal, **_plain(options), **_plain(dict(term.parameters))}


def _plain(value: Any) -> Any:
    """JSON values: models as tables, arrays as lists, paths as text."""
    if isinstance(value, BaseModel):
        return _plain({name: getattr(value, name) for name in type(value).model_fields})
    if isinstance(value, Mapping):
        return {str(key): _plain(item) for key, item in value.items() if item is not None}
    if isinstance(value, np.ndarray):
        return value.tolist()
    if isinstance(value, list | tuple):
        return [_plain(item) for item in value]
    return str(value) if isinstance(value, Path) else value


def _keys(model: type[BaseModel]) -> set[str]:
    """Keys as task files write them."""
    return {info.alias or name for name, info in model.model_fields.items()} - {"folder"}
