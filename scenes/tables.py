"""Tables of files and settings as pydantic models, whose numbers are numbers and of a size that can be meant."""

from __future__ import annotations

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


def strict(schema: Any) -> Any:
    """A core schema whose numbers are finite, within `MOST`, and no text or boolean, wherever in it they stand."""
    if isinstance(schema, dict):
        found = {key: strict(inner) for key, inner in schema.items()}
        kind = schema.get("type")
        if kind in _STRICT:
            bounds = _BOUNDS.get(kind, {})
            stated = {"ge": {"ge", "gt"} & found.keys(), "le": {"le", "lt"} & found.keys()}
            found |= _STRICT[kind] | {key: bound for key, bound in bounds.items() if not stated[key]}
        return found
    return [strict(inner) for inner in schema] if isinstance(schema, list) else schema


class Strict:
    """``Annotated[hint, Strict()]``: any type, with its numbers as in a `Table`; models in it state their own."""

    def __get_pydantic_core_schema__(self, source: Any, handler: GetCoreSchemaHandler) -> Any:
        return strict(handler(source))


class Table(BaseModel):
    """A table of a file, or settings: unknown keys are errors, and numbers are strict, finite and bounded."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    @classmethod
    def __get_pydantic_core_schema__(cls, source: Any, handler: GetCoreSchemaHandler) -> Any:
        return strict(handler(source))
