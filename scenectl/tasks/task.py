"""Tasks: a prompt, a scene, a start and goals, from a TOML file or from Python."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

from pydantic import PrivateAttr, ValidationError

from scenectl.generators.spec import Spec
from scenectl.tasks.held import GOAL
from scenectl.tasks.schema import GeneratorSpec, Start, TaskTable, known_keys
from scenectl.tasks.setup import Setup, plan, start_of
from scenes.errors import UserError, did_you_mean
from scenes.files import read_toml
from scenes.motion.frames import HOME, Place, back, origin_near
from scenes.motion.motion import Motion, Pose2D
from scenes.validation import sentence
from scenes.world.scene import Scene


class Task(TaskTable):
    """What shall happen; see `TaskTable` for the keys of a task file."""

    _file: Path | None = PrivateAttr(None)

    @contextmanager
    def named(self) -> Iterator[None]:
        """UserErrors inside name the task's file, where it was read from one."""
        try:
            yield
        except UserError as error:
            if self._file is None:
                raise
            raise UserError(f"task file '{self._file}': {error}") from error

    def build(
        self,
        seed: int | None = None,
        start: Pose2D | None = None,
        scene: Scene | None = None,
        spec: Spec | None = None,
    ) -> Setup:
        """Everything a generator needs, checked; arguments as `plan` takes them, in world coordinates.

        A scene far from the origin is planned, and its motions made, in a frame near it: see `Setup.origin`.
        """
        with self.named():
            scene = self.load_scene() if scene is None else scene
            origin = self.origin(scene, start)
            if origin == HOME:
                return plan(self, seed, start, scene, spec)
            start = None if start is None else start.moved(back(origin))
            return replace(plan(self.seen_from(origin), seed, start, scene.seen_from(origin), spec), task=self)

    def scene_of(self, motion: Motion) -> Scene:
        """Its scene with the things that a finished motion ``[T, J, 3]``, world m, holds in its hands; in the world."""
        scene = self.load_scene()
        if not (self.actions or any(term.goal == GOAL for term in self.terms)):
            return scene
        setup = self.build(start=start_of(motion, self.load_body()), scene=scene)
        return setup.scene_of(motion.seen_from(setup.origin)).seen_from(HOME)

    def origin(self, scene: Scene, start: Pose2D | None = None) -> Place:
        """Where the frame begins (m, world) that a scene is computed in: near it, or on bare floor near the start."""
        if scene.origin != HOME:
            return scene.origin
        # Without a mesh the floor reaches 20 m around the origin of its frame, so that must be nearer.
        step = 100.0 if scene.meshes else 20.0
        if (middle := scene.middle) is not None:
            return origin_near(middle, step)
        x, z = 0.0, 0.0
        if start is not None:
            x, _, z = start.position
        elif isinstance(self.start, Start):
            x, *_, z = self.start.position
        return origin_near((x, scene.floor.height, z), step)

    def with_generator(self, name: str | None = None, weights: str | None = None) -> Task:
        """The same task for another family or other weights; raises UserError where its settings are not that one's."""
        given = {key: value for key, value in (("name", name), ("weights", weights)) if value is not None}
        table = self.generator.model_dump(exclude_unset=True) | given
        try:
            return self.model_copy(update={"generator": GeneratorSpec.model_validate(table)})
        except ValidationError as error:
            raise UserError(sentence(error, table, GeneratorSpec)) from error


def load_task(path: str | Path) -> Task:
    """Read a task file; raises UserError naming the file for anything that is wrong in it."""
    path = Path(path)
    table = read_toml(path, "task file")
    try:
        for key in ("folder", "goals"):  # names for Python; in a file the one is implied and the other [[goal]]
            if key in table:
                raise UserError(f"unknown key '{key}'{did_you_mean(key, known_keys(Task))}")
        task = Task(**table, folder=path.resolve().parent)
        task._file = path
        return task
    except UserError as error:
        raise UserError(f"task file '{path}': {error}") from error
