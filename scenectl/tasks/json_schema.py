"""JSON Schema of task files: the tables of `schema`, with what only the registries know, and every shorthand."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import MISSING, fields
from typing import Annotated, Any, Literal, Union, get_type_hints

from pydantic import BaseModel, ConfigDict, Field, create_model

from objectives.tables import fields_of, goal_tables
from scenectl.generators import registry
from scenectl.tasks.actions import ActionSpec, actions
from scenectl.tasks.schema import GeneratorSpec, ObjectSpec, SceneSpec, Start, TaskTable
from scenectl.tasks.walk import Spot
from scenes.mesh.primitives import PRIMITIVES
from scenes.motion.waypoints import Number, Vector, Waypoints


class _Motion(BaseModel):
    """Positions (m, world) at times (s): straight lines between them, held before the first and after the last."""

    model_config = ConfigDict(extra="forbid", title="Motion")

    times: tuple[float, ...]
    positions: tuple[tuple[float, float, float], ...]


_PLAIN: dict[Any, Any] = {Number: float, Vector: tuple[float, float, float], Waypoints | None: _Motion | None}
"""What stands in a file for the types of a shape's fields."""


def task_schema() -> dict[str, Any]:
    """JSON Schema (2020-12) of a task file: with the goals and generators that are registered now.

    What needs more than the file to be known, such as whether a place is free, is left to `scenectl check`.
    """
    shape = _any(map(_shape, PRIMITIVES), key="shape")
    thing = _like(ObjectSpec, primitive=(_any((shape, None)), None))
    scene = _like(SceneSpec, primitives=(tuple[shape, ...], ()), objects=(tuple[thing, ...], ()))  # type: ignore[valid-type]
    goal = _any(goal_tables(), key="use")
    action = _any((_action(spec, goal) for spec in actions()), key="do")
    task = _like(
        TaskTable,
        avoid=(_any((bool, _avoided())), True),
        scene=(_any((str, scene)), SceneSpec()),
        start=(_any((Literal["sample"], Start, Spot, None)), None),
        generator=(_any(map(_generator, dict.fromkeys(registry.names()))), GeneratorSpec()),
        goals=(tuple[goal, ...], Field((), alias="goal")),  # type: ignore[valid-type]
        actions=(tuple[action, ...], Field((), alias="action")),  # type: ignore[valid-type]
    )
    schema = task.model_json_schema()
    del schema["properties"]["folder"]  # a name for Python; in a file it is implied
    timed = {"properties": {"prompt": {"type": "array"}}}  # whose last may say when it ends
    told = {"required": ["prompt"], "anyOf": [*({"required": [key]} for key in ("seconds", "walk")), timed]}
    script = {"required": ["action"], "not": {"anyOf": [{"required": [key]} for key in ("prompt", "seconds", "walk")]}}
    return {**schema, "oneOf": [told, script]}


def _action(spec: ActionSpec, goal: Any) -> type[BaseModel]:
    """The [[action]] table of an action, whose goals are of that type."""
    stated = fields_of(spec.parameters) | {"do": (Literal[spec.name], ...), "name": (str, spec.name)}
    stated["goal"] = (tuple[goal, ...], ())
    return create_model(f"action {spec.name}", __config__=ConfigDict(extra="forbid"), __doc__=spec.summary, **stated)


def _like(model: type[BaseModel], **changed: Any) -> type[BaseModel]:
    """The same table with some keys of other types."""
    return create_model(model.__name__, __base__=model, __doc__=model.__doc__, **changed)


def _any(kinds: Iterable[Any], key: str | None = None) -> Any:
    """Any of some types; tables may be told apart by what they say under `key`."""
    union: Any = Union[tuple(kinds)]  # noqa: UP007  (not known before)
    return union if key is None else Annotated[union, Field(discriminator=key)]


def _shape(name: str) -> type[BaseModel]:
    """The table of a primitive."""
    kind, hints = PRIMITIVES[name], get_type_hints(PRIMITIVES[name])
    stated: dict[str, Any] = {
        field.name: (_PLAIN[hints[field.name]], ... if field.default is MISSING else field.default)
        for field in fields(kind)
    }
    stated["shape"] = (Literal[name], ...)
    return create_model(name, __config__=ConfigDict(extra="forbid"), __doc__=kind.__doc__, **stated)


def _avoided() -> type[BaseModel]:
    """The `avoid` table: some of the keys of the goal that it stands for."""
    (stated,) = (table.model_fields for table in goal_tables() if table.__name__ == "sdf_penetration")
    some: dict[str, Any] = {key: (info.annotation, info) for key, info in stated.items() if key != "use"}
    return create_model("avoid", __config__=ConfigDict(extra="forbid"), **some)


def _generator(name: str) -> type[BaseModel]:
    """The [generator] table of a family: its own settings beside what all have."""
    known = {**GeneratorSpec.model_fields, **registry.find(name).settings.model_fields}
    stated: dict[str, Any] = {key: (info.annotation, info) for key, info in known.items()}
    stated["name"] = (Literal[name], name if name == registry.DEFAULT else ...)
    return create_model(f"generator {name}", __config__=ConfigDict(extra="forbid"), **stated)
