"""What pydantic finds wrong in a table, as one sentence: where, what, and the nearest known key."""

from __future__ import annotations

import types
from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass
from typing import Annotated, Any, Union, get_args, get_origin

from pydantic import BaseModel, ValidationError
from pydantic_core import ErrorDetails

from scenes.errors import did_you_mean


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
    message = worst["msg"][:1].lower() + worst["msg"][1:]
    if kind == "value_error":
        return worst["msg"].removeprefix("Value error, ")
    if kind in ("extra_forbidden", "missing") and where and isinstance(where[-1], str):
        key, table = where[-1], _locate(where[:-1], data, root)
        if kind == "missing":
            return f"'{key}' is missing" + (f" in [{table.name}]" if table.name else "")
        known = {name for model in _models(table.hint) for name in _fields(model)} - {*hidden}
        return _inside(table.name) + f"unknown key '{key}'{did_you_mean(key, known)}"
    place = _locate(where, data, root)
    if kind.startswith("union_tag"):
        return _inside(place.name) + _tag(worst, place.hint)
    if not place.name:
        return f"{message}, not {shown(worst['input'])}"
    message = "a number is missing" if kind == "missing" else message
    return f"'{place.name}' is {shown(place.given)}: {message}"


def deepest(error: ValidationError) -> ErrorDetails:
    """The error that a person meant: a union reports each alternative that it tried.

    Messages of our own validators come first, then unknown keys (which also make others missing), then what failed
    deepest inside a table.
    """
    found = error.errors(include_url=False)
    return max(found, key=lambda e: (e["type"] == "value_error", e["type"] == "extra_forbidden", len(e["loc"])))


def shown(value: Any) -> str:
    """A value as Python writes it, cut short."""
    text = repr(value)
    return text if len(text) <= 60 else text[:57] + "..."


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
        models = list(_models(hint))
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


def _models(hint: Any) -> Iterator[type[BaseModel]]:
    """Every model in a type: alternatives of a union, and what lists hold."""
    if isinstance(hint, type) and issubclass(hint, BaseModel):
        yield hint
        return
    for inner in get_args(hint)[:1] if get_origin(hint) is Annotated else get_args(hint):
        yield from _models(inner)


def _fields(model: type[BaseModel]) -> dict[str, Any]:
    """Types of a model's keys as files write them."""
    return {info.alias or name: info.annotation for name, info in model.model_fields.items()}


def _item(hint: Any) -> Any:
    """What a list of this type holds."""
    if get_origin(hint) in (Annotated, Union, types.UnionType):
        return next((_item(inner) for inner in get_args(hint) if any(_models(inner))), hint)
    return next((inner for inner in get_args(hint) if any(_models(inner))), hint)


def _entry(given: Any, part: int | str) -> Any:
    if isinstance(part, str):
        return given.get(part) if isinstance(given, Mapping) else None
    return given[part] if isinstance(given, list | tuple) and part < len(given) else None


def _kind(model: type[BaseModel]) -> Any:
    """What a table of this kind says under `kind`, by which unions are told apart."""
    return model.model_fields["kind"].default if "kind" in model.model_fields else None


def _tag(error: ErrorDetails, hint: Any) -> str:
    """A table that doesn't say of which kind it is, or says one that does not exist."""
    facts, kinds = error.get("ctx", {}), [str(_kind(model)) for model in _models(hint)]
    said = f"is '{facts['tag']}'" if "tag" in facts else "is missing"
    return f"{facts['discriminator']} {said}{did_you_mean(facts.get('tag', ''), kinds)}"
