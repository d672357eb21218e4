"""Tables of files and settings as pydantic models, whose numbers are numbers and of a size that can be meant."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from typing import Any

from pydantic import BaseModel, ConfigDict, GetCoreSchemaHandler

from scenes.numbers import LONGEST_WHOLE, MOST

_BOUNDS: dict[str, dict[str, Any]] = {
    "float": {"ge": -MOST, "le": MOST},
    "int": {"ge": -LONGEST_WHOLE, "le": LONGEST_WHOLE},
}
_STRICT: dict[str, dict[str, Any]] = {
    "float": {"strict": True, "allow_inf_nan": False},
    "int": {"strict": True},
    "bool": {"strict": True},
}


def strict(schema: Any, resolve: Callable[[Any], Any], seen: set[str] | None = None) -> Any:
    """A core schema whose numbers are finite, within `MOST`, and no text or boolean, wherever in it they stand.

    Args:
        schema: of any type.
        resolve: finds the schema of a class that another refers to, which is changed in place.
        seen: references that were followed.
    """
    seen = set() if seen is None else seen
    if isinstance(schema, list):
        return [strict(inner, resolve, seen) for inner in schema]
    if not isinstance(schema, dict):
        return schema
    kind = schema.get("type")
    if kind == "definition-ref" and schema["schema_ref"] not in seen:
        seen.add(schema["schema_ref"])
        with suppress(LookupError):  # a class that refers to itself
            meant = resolve(schema)
            meant.update(strict(dict(meant), resolve, seen))
        return schema
    found = {key: strict(inner, resolve, seen) for key, inner in schema.items()}
    if kind in _STRICT:
        stated = {"ge": {"ge", "gt"} & found.keys(), "le": {"le", "lt"} & found.keys()}
        found |= _STRICT[kind] | {key: bound for key, bound in _BOUNDS.get(kind, {}).items() if not stated[key]}
    return found


class Strict:
    """``Annotated[hint, Strict()]``: any type, with its numbers as in a `Table`."""

    def __get_pydantic_core_schema__(self, source: Any, handler: GetCoreSchemaHandler) -> Any:
        return strict(handler(source), handler.resolve_ref_schema)


class Table(BaseModel):
    """A table of a file, or settings: unknown keys are errors, and numbers are strict, finite and bounded."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    @classmethod
    def __get_pydantic_core_schema__(cls, source: Any, handler: GetCoreSchemaHandler) -> Any:
        return strict(handler(source), handler.resolve_ref_schema)
