"""The tables of a task file: keys, types and what must hold between them.

A task is data. Loading one reads files that it names and runs no code from any of them.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping
from dataclasses import asdict
from functools import cached_property
from pathlib import Path
from typing import Annotated, Any, Literal, TypeAlias, TypeVar

from pydantic import BaseModel, ConfigDict, Field, StrictBool, ValidationError, model_validator

from objectives import Term, read_with
from scenectl.control.settings import GuidanceSettings, SolverSettings
from scenectl.data.characters import CHARACTERS, character_body
from scenectl.data.formats.motions import load_motion
from scenectl.generators.prompts import Prompt, Prompts
from scenectl.generators.registry import DEFAULT, Family, find
from scenectl.generators.weights import bundled_weights
from scenectl.tasks.actions.script import Entry
from scenectl.tasks.dump import plain, scene_table, term_table
from scenectl.tasks.walk import Spot, Walk, moved_spot
from scenectl.threads import MOST
from scenes.body.body import DEFAULT_BODY, SHORTEST, TALLEST, ProxyBody
from scenes.body.proxies import load_body
from scenes.errors import UserError, clipped, did_you_mean, shown
from scenes.mesh.mesh import load_mesh
from scenes.mesh.primitives import Primitive, primitive
from scenes.motion.frames import HOME, Place, back
from scenes.tables import Table
from scenes.validation import sentence
from scenes.world.moving import MovingObject, Trajectory
from scenes.world.scene import Scene, bundled, bundled_names, load_scene

Unit: TypeAlias = Literal["m", "cm", "mm", "in", "ft"]
Axis: TypeAlias = Literal["x", "y", "z"]
Resolution: TypeAlias = Annotated[int, Field(ge=8, le=512)]

AVOID: dict[str, Any] = {"margin": 0.03, "weight": 300.0, "tolerance": 0.01, "kernel": "squared", "reduction": "sum"}
"""`sdf_penetration` of a task that does not state its own; what the verdict calls a touch (`SHALLOW`) is met."""
PASSING = 0.08
"""Metres that a walk keeps from the scene where things move in it: frames at 20 a second are 12 cm apart where
a person and a thing meet at 2.4 m/s, and with 3 cm a hand goes through between two of them."""
GROUND: dict[str, Any] = {"weight": 100.0, "kernel": "squared", "reduction": "sum"}
"""`foot_contact` likewise, of one that walks."""

Given = TypeVar("Given")
Made = TypeVar("Made")
AnyTask = TypeVar("AnyTask", bound="TaskTable")

read_with(load_motion)  # clips that goals name may be anybody's


class _Table(Table):
    """A table of a task file: unknown keys are errors that name the nearest known one."""

    model_config = ConfigDict(arbitrary_types_allowed=True, populate_by_name=True)


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


def moves(thing: ObjectSpec | MovingObject) -> bool:
    """Whether an object is at more than one place."""
    return len((thing if isinstance(thing, ObjectSpec) else thing.trajectory).times) > 1


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
        objects: what moves, or can be taken (`ObjectSpec`), [[scene.objects]] tables.
        soft: by how much (m) parts of the scene give, such as cushions, by their names.
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
    soft: dict[str, Annotated[float, Field(ge=0, le=0.3)]] = Field(default_factory=dict)

    def build(self) -> Scene:
        """Read the files; raises UserError for what cannot be read. Nothing is baked yet."""
        shapes = [_named(f"primitive {k + 1}", _shape, table) for k, table in enumerate(self.primitives)]
        objects = [_named(f"object {k + 1}", ObjectSpec.build, spec) for k, spec in enumerate(self.objects)]
        more: dict[str, Any] = {"objects": objects, "thickness": self.thickness, "spacing": self.spacing}
        more["soft"] = self.soft
        if self.bundled is not None and self.file is not None:
            raise UserError("scene states both 'bundled' and 'file'; keep one of them")
        if self.bundled is not None:
            given = self.model_fields_set & {"unit", "up", "floor", "free_space"}
            if given:
                raise UserError(f"scene: '{min(given)}' is known for the bundled scene '{self.bundled}'; leave it out")
            return bundled(self.bundled, shapes, resolution=self.resolution, **more)
        if self.file is not None:
            more |= {"resolution": self.resolution, "free_space": self.free_space}
            return load_scene(self.file, self.unit, self.up, self.floor, shapes, **more)
        name = "primitives" if shapes else "objects" if objects else "empty"
        return Scene(primitives=shapes, floor=self.floor or 0.0, name=name, objects=objects, soft=self.soft)


class Start(_Table):
    """Where the person stands at first.

    Attributes:
        position: [x, z] on the floor, or [x, y, z] with the height of the ground there; world metres.
        heading: radians about +y, 0 faces +z and pi/2 faces +x; by default along the walk, else 0.
        free: place and heading are solved for along with the motion, each sample's own, from here on.
    """

    position: Spot
    heading: float | None = None
    free: bool = False

    def moved(self, by: Place) -> Start:
        """The same start so much (m) further."""
        return self.model_copy(update={"position": moved_spot(self.position, by)})


class BodySpec(_Table):
    """A person of another size, in an adult's proportions; what walks, speeds and distances follow.

    Attributes:
        height: stature (m).
    """

    height: Annotated[float, Field(ge=SHORTEST, le=TALLEST)]


class GeneratorSpec(_Table):
    """Which generator makes the motion; the other keys are its own settings (for MSCoT `mscot.settings.Sampling`).

    Attributes:
        name: of a registered family (`scenectl.generators.registry`).
        weights: "default" or "permissive" for those that come with the package, or a folder.
        threads: for its arithmetic; one by default (`scenectl.threads`).

    What is left out is the generator's own default.
    """

    model_config = ConfigDict(extra="allow")

    name: str = DEFAULT
    weights: Annotated[str, Field(min_length=1)] = "default"
    threads: Annotated[int, Field(ge=1, le=MOST)] | None = None

    @model_validator(mode="after")
    def _known(self) -> GeneratorSpec:
        _ = self.settings
        return self

    @cached_property
    def family(self) -> Family:
        """The family of that name, whose weights are not read."""
        return find(self.name)

    @cached_property
    def settings(self) -> BaseModel:
        """The family's settings; raises UserError for a key or value that it does not have."""
        model, given = self.family.settings, dict(self.model_extra or {})
        for key in given:
            if key not in model.model_fields:
                known = {*type(self).model_fields, *model.model_fields}
                raise UserError(f"[generator]: unknown key '{key}'{did_you_mean(key, known)}")
        try:
            return model.model_validate({key: value for key, value in given.items() if value is not None})
        except ValidationError as error:
            raise UserError(f"[generator]: {sentence(error, given, model)}") from error


class PromptSpec(_Table):
    """One of several sentences along a motion; each is about a time of its own.

    Attributes:
        text: the sentence.
        begin: from when on it counts (s); by default from where the one before it ends, and from 0 for the first.
        end: until when it counts (s); by default until the next one begins, or to the end.
    """

    text: Annotated[str, Field(min_length=1)]
    begin: Annotated[float | None, Field(ge=0)] = None
    end: Annotated[float | None, Field(gt=0)] = None


class TaskTable(_Table):
    """What shall happen: see the attributes for the keys of a task file.

    Attributes:
        prompt: a sentence, or several along the motion, [[prompt]] tables (`PromptSpec`); required without `action`.
        actions: a script instead, [[action]] tables: each names by `do` what is done (`scenectl actions`), and has that
            action's parameters; all follow one another. Goals of [[action.goal]] tables count their times from where
            the action begins.
        seconds: length (for MSCoT 1.8 to 120); it may be left out where the last prompt says when it ends, and with
            `walk`, where it follows from the path.
        scene: a bundled scene's name, a mesh file, a table (`SceneSpec`) or, in Python, a `Scene`.
        start: "sample" (a free place, chosen by the seed) or a table (`Start`); by default sampled in a scene with
            obstacles and the origin without.
        walk: where to walk (`Walk`), planned around the obstacles.
        body: { height = 1.6 } for a person so tall (m), 1.2 to 2.1; the file of a character with our 22 joints (.glb,
            .gltf, .vrm), or what `scenectl body CHARACTER --json` wrote; by default an adult of 1.7.
        avoid: whether the scene is avoided: where it has a mesh, primitives or objects, or the task has goals, which
            may push a body into a bare floor, there is the goal `sdf_penetration` with options that work (`AVOID`)
            and, where it walks ([walk], or `follow_path` of the pelvis), `foot_contact` (`GROUND`). A table states
            some of the keys of `sdf_penetration` otherwise, such as `exempt`. A goal of the same name replaces either,
            and has what it does not state from its paper.
        goals: [[goal]] tables or `Term` objects.
        generator, solver, guidance: settings.
        samples: motions to make; those that are met and believable come first, then those that are met, then the rest.
        seed: of everything random.
        folder: where relative paths are looked for; the task file's own.
    """

    prompt: Annotated[str, Field(min_length=1)] | Annotated[tuple[PromptSpec, ...], Field(min_length=1)] | None = None
    actions: Annotated[tuple[Any, ...], Field(alias="action")] = ()
    seconds: float | None = None
    scene: SceneSpec | Scene = SceneSpec()
    start: Literal["sample"] | Start | None = None
    walk: Walk | None = None
    body: BodySpec | Path | None = None
    avoid: StrictBool | dict[str, Any] = True
    goals: Annotated[tuple[Any, ...], Field(alias="goal")] = ()
    generator: GeneratorSpec = GeneratorSpec()
    solver: SolverSettings = SolverSettings()
    guidance: GuidanceSettings = GuidanceSettings()
    samples: Annotated[int, Field(ge=1, le=256)] = 1
    seed: Annotated[int, Field(ge=0, lt=2**63)] = 0
    folder: Path | None = None

    def __init__(self, /, **data: Any) -> None:
        try:
            super().__init__(**data)
        except ValidationError as error:
            raise UserError(sentence(error, data, TaskTable, hidden=("folder",))) from error
        if self.walk is not None and isinstance(self.start, Start) and self.start.free:
            raise UserError("start: 'free' cannot be solved for with a [walk], which is planned from it; keep one")
        spec = self.generator.family.spec
        if self.actions:
            self._check_script()
        elif self.prompt is None:
            raise UserError("'prompt' is missing; say in a sentence what happens, or give [[action]] tables")
        elif self.seconds is None and self.walk is None:
            raise UserError(f"'seconds' is missing; give {spec.shortest:g} to {spec.longest:g}")
        if self.seconds is not None and not spec.shortest <= self.seconds <= spec.longest:
            raise UserError(
                f"'seconds' is {self.seconds:g}; generator '{self.generator.name}' makes motions of {spec.shortest:g} "
                f"to {spec.longest:g} s"
            )
        if "sentences" not in spec.abilities and not self.actions:
            self.prompts.single(self.generator.name)
        # Unknown goals and parameters, and times that cannot be, are errors of the task, not of its run.
        _ = self.actions or self.prompts, self.terms, self.script, self.avoided

    def _check_script(self) -> None:
        """Raise UserError for keys that a script leaves no room for."""
        for key in ("prompt", "walk", "seconds"):
            if getattr(self, key) is not None:
                told = {"prompt": "sentences", "walk": "ways", "seconds": "length"}[key]
                raise UserError(f"'{key}' and [[action]] tables exclude each other: a script has {told} of its own")
        if isinstance(self.start, Start) and self.start.free:
            raise UserError("start: 'free' cannot be solved for with [[action]] tables, which are planned from it")
        spec = self.generator.family.spec
        if "sentences" not in spec.abilities and len(self.actions) > 1:
            raise UserError(
                f"generator '{self.generator.name}' takes one sentence for the whole motion; give it one action"
            )

    @model_validator(mode="before")
    @classmethod
    def _resolved(cls, data: Any) -> Any:
        """Names and paths of the scene as tables, relative to `folder`; world-only tables as they are."""
        if not isinstance(data, Mapping):
            return data
        data = dict(data)
        if isinstance(data.get("prompt"), Prompts):
            data["prompt"] = _prompt_tables(data["prompt"])
        if data.get("seconds") is None and (end := _last_end(data.get("prompt"))) is not None:
            data["seconds"] = end
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

    @property
    def prompts(self) -> Prompts:
        """The sentences with their times, but for those of a script, which are its own (`Setup.prompts`).

        Raises:
            UserError: times that cannot be, or a script.
        """
        if self.prompt is None:
            raise UserError("a script says what happens action by action; build the task to have its sentences")
        if isinstance(self.prompt, str):
            return Prompts.of(self.prompt)
        told, ends = list[Prompt](), [0.0, *(spec.end for spec in self.prompt)]
        for spec, before in zip(self.prompt, ends, strict=False):
            begin = before if spec.begin is None else spec.begin
            if begin is None:
                raise UserError(
                    f"prompt '{clipped(spec.text)}' has no 'begin', and the one before it no 'end'; state one of them"
                )
            told.append(Prompt(spec.text, begin, spec.end))
        return Prompts(tuple(told))

    def told(self: AnyTask, prompts: Prompts | str) -> AnyTask:
        """The same task with other sentences."""
        tables = _prompt_tables(Prompts.of(prompts))
        told = tables if isinstance(tables, str) else tuple(map(PromptSpec.model_validate, tables))
        return self.model_copy(update={"prompt": told})

    @cached_property
    def script(self) -> tuple[Entry, ...]:
        """The actions, read and checked; planned by `build`."""
        return tuple(Entry.of(k + 1, table, self.folder) for k, table in enumerate(self.actions))

    @cached_property
    def terms(self) -> tuple[Term, ...]:
        """The goals as terms, without those of `walk`, which depend on the start."""
        return tuple(g if isinstance(g, Term) else Term.from_table(_mapping(g), self.folder) for g in self.goals)

    @property
    def avoided(self) -> tuple[Term, ...]:
        """The goals by which the scene is avoided, as far as the task does not state its own."""
        return self.avoiding()

    def avoiding(
        self, walks: bool = False, touches: Mapping[str, Sequence[tuple[float, float]]] | None = None
    ) -> tuple[Term, ...]:
        """The same for somebody who walks besides, and whose joints may touch things in some windows (s)."""
        own, walks = self.avoid if isinstance(self.avoid, dict) else {}, walks or self._walks
        passing = {"margin": PASSING} if walks and any(map(moves, self.scene.objects)) else {}
        touching = {"touches": {joint: list(when) for joint, when in touches.items()}} if touches else {}
        wanted = {"sdf_penetration": {**AVOID, **passing, **touching, **own}} | (
            {"foot_contact": GROUND} if walks else {}
        )
        stated = {term.goal for term in self.terms}
        if own and "sdf_penetration" in stated:
            raise UserError("'avoid' has keys of sdf_penetration, and a goal replaces that; keep one of them")
        scene = self.scene
        meshes = bool(scene.meshes if isinstance(scene, Scene) else scene.bundled or scene.file)
        things = meshes or scene.primitives or scene.objects
        asked = self.walk is not None or self.actions or any(term.weight > 0 for term in self.terms)
        terms = (Term.from_table({**table, "use": use}) for use, table in wanted.items() if use not in stated)
        return tuple(terms) if self.avoid is not False and (things or asked) else ()

    @property
    def _walks(self) -> bool:
        led = (term for term in self.terms if term.goal == "follow_path" and term.weight > 0)
        return self.walk is not None or any("pelvis" in term.joints for term in led)

    def seen_from(self: AnyTask, origin: Place) -> AnyTask:
        """The same start, walk and goals in the frame that begins at `origin` (m, world); the scene stays as it is."""
        if origin == HOME:
            return self
        by = back(origin)
        start = self.start.moved(by) if isinstance(self.start, Start) else self.start
        goals = tuple(term.moved(by) for term in self.terms)
        walk = None if self.walk is None else self.walk.moved(by)
        seen = self.model_copy(update={"start": start, "walk": walk, "goals": goals})
        seen.__dict__.pop("terms", None)  # the copy would keep those of the goals before
        seen.__dict__["script"] = tuple(entry.moved(by) for entry in self.script)
        return seen

    def load_scene(self) -> Scene:
        """The scene, read but not yet baked."""
        return self.scene if isinstance(self.scene, Scene) else self.scene.build()

    def load_body(self) -> ProxyBody:
        """The body that moves and touches things: so tall, of the file, or an adult's."""
        if self.body is None:
            return DEFAULT_BODY
        if isinstance(self.body, BodySpec):
            return ProxyBody.human(self.body.height)
        return character_body(self.body) if self.body.suffix.lower() in CHARACTERS else load_body(self.body)

    def dump(self) -> dict[str, Any]:
        """Plain values that `Task(**values)` builds the same task from, as far as its scene comes from files."""
        values = self.model_dump(mode="json", by_alias=False, exclude={"scene", "goals", "actions"})
        scene = self.scene
        table = scene_table(scene) if isinstance(scene, Scene) else scene.model_dump(mode="json", exclude_unset=True)
        values["scene"] = table
        if self.actions:
            values["actions"] = [plain(table) for table in self.actions]
        values["goals"] = [term_table(g) if isinstance(g, Term) else plain(g) for g in self.goals]
        return values


def _prompt_tables(prompts: Prompts) -> str | list[dict[str, Any]]:
    """Sentences as task files state them."""
    if str(prompts) == prompts.sentences[0].text:
        return str(prompts)
    return [asdict(sentence) for sentence in prompts.sentences]


def _last_end(prompt: Any) -> float | None:
    """When the last of several sentences ends, where it says so in a number."""
    last = prompt[-1] if isinstance(prompt, list | tuple) and prompt else None
    end = last.get("end") if isinstance(last, Mapping) else getattr(last, "end", None)
    return float(end) if isinstance(end, int | float) else None


def _mapping(value: Any) -> Mapping[str, Any]:
    if not isinstance(value, Mapping):
        raise UserError(f"a goal must be a [[goal]] table, not {shown(value)}")
    return value


def _named_scene(name: str, folder: Path) -> dict[str, Any]:
    """A scene given by one word: a bundled name, or a file beside the task."""
    if name in bundled_names():
        return {"bundled": name}
    if os.path.exists(folder / name) or Path(name).suffix:  # of a name that is too long there is none
        return {"file": name}  # what is missing, or no file, is reported by the loader
    near = did_you_mean(name, bundled_names())
    raise UserError(f"scene '{clipped(name)}' is neither a bundled scene nor a file beside the task{near}")


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


def known_keys(model: type[BaseModel]) -> set[str]:
    """Keys as task files write them."""
    return {info.alias or name for name, info in model.model_fields.items()} - {"folder"}
