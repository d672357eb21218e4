"""What pydantic finds wrong in a table, as one sentence: where, what, and the nearest known key."""

from __future__ import annotations

import types
from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass
from typing import Annotated, Any, Union, get_args, get_origin

from pydantic import BaseModel, ValidationError
from pydantic_core import ErrorDetails

from scenes.errors import clipped, did_you_mean, shown


def sentence(error: ValidationError, data: Any, root: Any, hidden: Collection[str] = ()) -> str:
    """The worst thing wrong with `data`, in words.

    Tables are named as a file writes them, ``[scene.objects 1]``: keys by their aliases, tables in lists counted from
    1. What a validator of ours says is passed on as it is.

    Args:
        error: what pydantic raised.
        data: what it was given.
        root: the model, or the annotated type, that it was read as.
        hidden: keys of `root` that no file writes, never to be suggested.
    """
    worst = deepest(error)
    where, kind = worst["loc"], worst["type"]
    message = _message(worst)
    if kind == "value_error":
        return worst["msg"].removeprefix("Value error, ")
    if kind in ("extra_forbidden", "missing") and where and isinstance(where[-1], str):
        key, table = where[-1], _locate(where[:-1], data, root)
        if kind == "missing":
            return f"'{key}' is missing" + (f" in [{table.name}]" if table.name else "")
        known = {name for model in models_of(table.hint) for name in _fields(model)} - {*hidden}
        return _inside(table.name) + f"unknown key '{clipped(key)}'{did_you_mean(key, known)}"
    place = _locate(where, data, root)
    if kind.startswith("union_tag"):
        return _inside(place.name) + _tag(worst, place.hint)
    if not place.name:
        return f"{message}, not {shown(worst['input'])}"
    message = "a number is missing" if kind == "missing" else message
    given = worst["input"] if place.given is None else place.given  # a short form, which was read as a table
    return f"'{place.name}' is {shown(given)}: {message}"


def deepest(error: ValidationError) -> ErrorDetails:
    """The error that a person meant: a union reports each alternative that it tried.

    Messages of our own validators come first, then unknown keys (which also make others missing), then what failed
    deepest inside a table.
    """
    found = error.errors(include_url=False)
    return max(found, key=lambda e: (e["type"] == "value_error", e["type"] == "extra_forbidden", len(e["loc"])))


_WANTED = {
    "model_type": "a table", "model_attributes_type": "a table", "dict_type": "a table", "is_instance_of": "a table",
    "tuple_type": "a list", "list_type": "a list", "set_type": "a list", "path_type": "a path, as text",
    "string_type": "text", "bool_type": "true or false", "bool_parsing": "true or false", "int_type": "a whole number",
    "int_parsing": "a whole number", "int_from_float": "a whole number", "float_type": "a number",
    "float_parsing": "a number", "named_tuple_type": "a list of numbers", "missing_argument": "a list of more numbers",
    "unexpected_positional_argument": "a list of fewer numbers",
}  # fmt: skip
"""What a file may say instead, by the kind of pydantic's error, whose own words are those of Python."""


def _message(error: ErrorDetails) -> str:
    """What is wrong with a value, in the words of files."""
    kind, facts = error["type"], error.get("ctx", {})
    if kind in _WANTED:
        return f"input should be {_WANTED[kind]}"
    if kind == "too_long":
        return f"it should have at most {facts['max_length']} entries, not {facts['actual_length']}"
    if kind == "too_short":
        return f"it should have at least {facts['min_length']} entries, not {facts['actual_length']}"
    return error["msg"][:1].lower() + error["msg"][1:]


def _inside(table: str) -> str:
    return f"[{table}]: " if table else ""


@dataclass(frozen=True)
class _Place:
    """The last key on the way to an error: its name, its annotated type, and what stands there."""

    name: str
    hint: Any
    given: Any


def _locate(where: tuple[int | str, ...], data: Any, root: Any) -> _Place:
    """Follow an error's location through models, lists and unions; a value that holds no table is not entered."""
    name, hint, given = "", root, data
    for part in where:
        models = list(models_of(hint))
        if not models:
            break
        if isinstance(part, int):
            name, hint, given = f"{name} {part + 1}", _item(hint), _entry(given, part)
        elif any(part in _fields(model) for model in models):
            hint = next(_fields(model)[part] for model in models if part in _fields(model))
            name, given = f"{name}.{part}".removeprefix("."), _entry(given, part)
        else:  # a word by which pydantic tells the alternatives of a union apart
            hint = next((model for model in models if part in (model.__name__, _kind(model))), hint)
    return _Place(name, hint, given)


def models_of(hint: Any) -> Iterator[type[BaseModel]]:
    """Every model in a type: alternatives of a union, and what lists hold."""
    if isinstance(hint, type) and issubclass(hint, BaseModel):
        yield hint
        return
    for inner in get_args(hint)[:1] if get_origin(hint) is Annotated else get_args(hint):
        yield from models_of(inner)


def _fields(model: type[BaseModel]) -> dict[str, Any]:
    """Types of a model's keys as files write them."""
    return {info.alias or name: info.annotation for name, info in model.model_fields.items()}


def _item(hint: Any) -> Any:
    """What a list of this type holds."""
    if get_origin(hint) in (Annotated, Union, types.UnionType):
        return next((_item(inner) for inner in get_args(hint) if any(models_of(inner))), hint)
    return next((inner for inner in get_args(hint) if any(models_of(inner))), hint)


def _entry(given: Any, part: int | str) -> Any:
    if isinstance(part, str):
        return given.get(part) if isinstance(given, Mapping) else None
    return given[part] if isinstance(given, list | tuple) and part < len(given) else None


def _kind(model: type[BaseModel]) -> Any:
    """What a table of this kind says under `kind`, by which unions are told apart."""
    return model.model_fields["kind"].default if "kind" in model.model_fields else None


def _tag(error: ErrorDetails, hint: Any) -> str:
    """A table that doesn't say of which kind it is, or says one that does not exist."""
    facts, kinds = error.get("ctx", {}), [str(_kind(model)) for model in models_of(hint)]
    said = f"is '{clipped(facts['tag'])}'" if "tag" in facts else "is missing"
    return f"{facts['discriminator']} {said}{did_you_mean(facts.get('tag', ''), kinds)}"
