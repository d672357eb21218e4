"""What may stand in a task file, told from the models that read it: keys, types, defaults, units, meanings."""

from __future__ import annotations

import inspect
import json
import re
import types
from collections.abc import Iterator, Sequence
from dataclasses import MISSING, dataclass, fields
from typing import Annotated, Any, Union, get_args, get_origin, get_type_hints

from pydantic import BaseModel
from pydantic.fields import FieldInfo

from objectives import Term
from objectives.docstrings import meanings
from objectives.parameters import describe
from objectives.registry import TERM_KEYS
from scenectl.generators.registry import DEFAULT, find
from scenectl.tasks.actions.script import Entry
from scenectl.tasks.schema import TaskTable, known_keys
from scenes.errors import UserError, did_you_mean
from scenes.mesh.primitives import PRIMITIVES
from scenes.motion.waypoints import Waypoints
from scenes.validation import models_of

GOAL, SHAPES, ACTION = "goal", "scene.primitives", "action"
"""Tables of which no pydantic model is."""
_UNITS = {
    r"\(m/s\)|metres a second": "m/s", r"\(rad\)|[Rr]adians": "rad", r"\(nats\)": "nats", r"\(m\)|metres": "m",
    r"\(s\)|\(s,|[Ss]econds": "s",
}  # fmt: skip
"""Units, by the ways in which docstrings state them; the first that fits counts."""
_BOUNDS = (("gt", "over {}"), ("ge", "from {}"), ("lt", "under {}"), ("le", "to {}"))


@dataclass(frozen=True)
class Key:
    """A key of a table.

    Attributes:
        name: as files write it.
        type: what it may be, in words, bounds included.
        default: as files write it; "required" where there is none, "" where it is nothing.
        unit: of its numbers, or "".
        meaning: a sentence.
    """

    name: str
    type: str
    default: str
    unit: str
    meaning: str


_ENTRY = (
    Key("do", "a text", "required", "", "the action"),
    Key("name", "a text", "", "", "for reports; by default the action's"),
    Key("goal", "[[action.goal]] tables", "", "", "further goals; their times count from where the action begins"),
)
"""Keys of every [[action]] table."""


@dataclass(frozen=True)
class Table:
    """A table of a task file.

    Attributes:
        name: as files write it between brackets; "" is the file itself.
        summary: a sentence.
        keys: that it may hold.
        more: where other keys are told, or "".
    """

    name: str
    summary: str
    keys: tuple[Key, ...]
    more: str = ""


def tables() -> dict[str, Table]:
    """Every table of a task file by its name, that of the file itself, "", first."""
    found = {table.name: table for table in _of_model("", TaskTable)}
    own, shared = _keys(find(DEFAULT).settings), found["generator"]
    more = f"the last {len(own)} are those of '{DEFAULT}'"
    found["generator"] = Table(shared.name, shared.summary, (*shared.keys, *own), more)
    found[GOAL] = Table(GOAL, _summary(Term), tuple(_term_keys()), "scenectl goals NAME shows those of each goal")
    found[ACTION] = Table(ACTION, _summary(Entry), _ENTRY, "scenectl actions NAME shows those of each action")
    found[SHAPES] = Table(SHAPES, "Shapes that stand in the scene.", tuple(_shape_keys()))
    return found


def table(name: str) -> Table:
    """The table of that name, with or without brackets; raises UserError naming the nearest."""
    known, bare = tables(), name.strip("[]")
    if bare not in known or not bare:
        raise UserError(f"a task has no table '{name}'{did_you_mean(bare, [key for key in known if key])}")
    return known[bare]


def _of_model(name: str, model: type[BaseModel]) -> Iterator[Table]:
    """The table that a model reads, and those in it."""
    yield Table(name, _summary(model), _keys(model, name))
    for key, info in _fields(model):
        for inner in models_of(_hint(info)):
            yield from _of_model(f"{name}.{key}".removeprefix("."), inner)


def _keys(model: type[BaseModel], table: str = "") -> tuple[Key, ...]:
    told, keys = meanings(inspect.getdoc(model) or "", "Attributes:"), []
    for key, info in _fields(model):
        default = "required" if info.is_required() else _default(info.get_default(call_default_factory=True))
        name = next(name for name, field in model.model_fields.items() if field is info)
        keys.append(_key(key, _words(_hint(info), f"{table}.{key}".removeprefix(".")), default, told.get(name, "")))
    return tuple(keys)


def _fields(model: type[BaseModel]) -> list[tuple[str, FieldInfo]]:
    """Fields by the keys that files write."""
    known = known_keys(model)
    named = ((info.alias or name, info) for name, info in model.model_fields.items())
    return [(key, info) for key, info in named if key in known]


def _hint(info: FieldInfo) -> Any:
    """A field's type with the bounds that stand beside it."""
    hint: Any = info.annotation
    return Annotated[(hint, *info.metadata)] if info.metadata else hint


def _term_keys() -> Iterator[Key]:
    told, hints = meanings(inspect.getdoc(Term) or "", "Attributes:"), get_type_hints(Term)
    defaults = {field.name: field.default for field in fields(Term)}
    for name in TERM_KEYS:
        own = "goal" if name == "use" else name
        hint = str if name == "use" else hints[own]
        default = "required" if defaults[own] is MISSING else _default(defaults[own])
        yield _key(name, _words(hint, GOAL), default, told.get(own, ""))


def _shape_keys() -> Iterator[Key]:
    names = ", ".join(f"'{name}'" for name in PRIMITIVES)
    yield Key("shape", names, "required", "", "which; the others are for those named")
    for shape, kind in PRIMITIVES.items():
        told, hints = meanings(inspect.getdoc(kind) or "", "Attributes:"), get_type_hints(kind)
        for entry in fields(kind):
            default = "required" if entry.default is MISSING else _default(entry.default)
            yield _key(f"{shape}: {entry.name}", _words(hints[entry.name], SHAPES), default, told.get(entry.name, ""))


def _key(name: str, kind: str, default: str, meaning: str) -> Key:
    meaning = re.sub(r"`+", "", meaning)
    unit = next((unit for pattern, unit in _UNITS.items() if re.search(pattern, meaning)), "")
    return Key(name, kind, default, unit, meaning)


def _words(hint: Any, table: str) -> str:
    """A type in words, "" for one that only Python can state; a table is named."""
    origin, inner = get_origin(hint), get_args(hint)
    if origin in (Union, types.UnionType):
        options = [option for option in inner if option is not type(None) and (option is not int or float not in inner)]
        return " or ".join(dict.fromkeys(words for option in options if (words := _words(option, table))))
    if origin is Annotated:
        bounds = (
            form.format(f"{value:g}")
            for note in inner[1:]
            for name, form in _BOUNDS
            if (value := getattr(note, name, None)) is not None
        )
        return " ".join([_words(inner[0], table), *bounds])
    if inner and (origin is Sequence or inner[-1] is Ellipsis):
        tables = inner[0] is Any or get_origin(inner[0]) is dict or any(models_of(inner[0]))
        return f"[[{table}]] tables" if tables else f"a list of {_words(inner[0], table).removeprefix('a ')}s"
    if isinstance(hint, type) and issubclass(hint, BaseModel):
        return f"a [{table}] table"
    if origin is dict or hint is Any or hint is Waypoints:
        return "a table"
    return "" if getattr(hint, "__module__", "").startswith("scenes.") else describe(hint)


def _default(value: Any) -> str:
    """A default as files write it; "" for nothing, an empty list and a table."""
    if value is None or value == () or isinstance(value, BaseModel):
        return ""
    return json.dumps(value)


def _summary(model: type) -> str:
    return " ".join((inspect.getdoc(model) or "").split("\n\n")[0].split())
