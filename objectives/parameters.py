"""Parameters of goals: their types in task files, and one-sentence errors when a value does not fit."""

from __future__ import annotations

import math
import types
from collections.abc import Iterable, Mapping, Sequence
from functools import cache
from pathlib import Path
from typing import Annotated, Any, Literal, NamedTuple, TypeVar, Union, get_args, get_origin, get_type_hints

import numpy as np
from pydantic import AfterValidator, BaseModel, Field, TypeAdapter, ValidationError, model_validator
from torch import Tensor

from scenes.errors import UserError, shown
from scenes.motion.frames import FAR, Place
from scenes.tables import Strict, Table
from scenes.validation import deepest, sentence

WorldX = Annotated[float, "m, world x"]
"""A coordinate: where a scene is computed in a frame near it, parameters with this annotation are stated in that."""
WorldY = Annotated[float, "m, world y"]
"""Likewise; the height over another thing is none."""
WorldZ = Annotated[float, "m, world z"]
"""Likewise."""
_WORLD = (WorldX, WorldY, WorldZ)


class Point(NamedTuple):
    """A point in the world, metres, y up. `Objective.check` compares every parameter of this type with the scene."""

    x: WorldX
    y: WorldY
    z: WorldZ


class FloorPoint(NamedTuple):
    """A point on the floor, metres, world x and z."""

    x: WorldX
    z: WorldZ


class Region(Table):
    """A rectangle on the floor, metres: ``{x = [-1, 1], z = [0.5, 1.5]}``; an axis left out is unbounded.

    Attributes:
        x: lowest and highest world x.
        z: lowest and highest world z.
    """

    x: tuple[WorldX, WorldX] = (-math.inf, math.inf)
    z: tuple[WorldZ, WorldZ] = (-math.inf, math.inf)

    @model_validator(mode="after")
    def _ordered(self) -> Region:
        for name, (low, high) in (("x", self.x), ("z", self.z)):
            if not low <= high:
                raise UserError(f"{name} must be [lowest, highest], not {[low, high]}")
        return self


def _beside(path: Path, info: Any) -> Path:  # pydantic's ValidationInfo
    folder = (info.context or {}).get("folder")
    return path if folder is None else Path(folder) / path


File = Annotated[Path, AfterValidator(_beside)]
"""A file; relative names are looked for beside the task file."""

Time = Annotated[float, "s, task clock"]
"""A moment, which `Objective.check` compares with the motion's own."""
Window = Annotated[tuple[float, float], "s, task clock"]
"""From when to when; `Objective.check` refuses one that the motion does not touch."""
Positive = Annotated[float, Field(gt=0)]
NotNegative = Annotated[float, Field(ge=0)]


def check_heading(heading: float) -> None:
    """Raise UserError for a heading that is more than a turn, as one in degrees mostly is."""
    if abs(heading) > 2 * math.pi:
        raise UserError(
            f"'heading' is in radians, and {heading:g} is more than a turn; {heading:g} degrees are "
            f"{math.radians(heading):.4g}"
        )


_WORDS: dict[Any, str] = {
    float: "a number",
    int: "a whole number",
    str: "a text",
    bool: "true or false",
    Path: "a file",
    Point: "[x, y, z]",
    FloorPoint: "[x, z]",
}


def describe(hint: Any) -> str:
    """A parameter's type in words: ``a number or a list of [x, y, z]``."""
    origin, inner = get_origin(hint), get_args(hint)
    if hint in _WORDS:
        return _WORDS[hint]
    if origin is Annotated:
        return describe(inner[0])
    if origin in (Union, types.UnionType):
        kinds = [kind for option in _options(hint) if (kind := _kind(option))]
        words = [describe(option) for option in _options(hint) if not _kind(option)]
        words += [f"a table with kind = {_either(kinds)}"] if kinds else []
        return " or ".join(dict.fromkeys(words))
    if origin is Literal:
        return _either(inner)
    if origin is tuple and Ellipsis not in inner:
        return "[" + ", ".join(describe(i).removeprefix("a ") for i in inner) + "]"
    if origin in (list, tuple, Sequence):
        item = describe(inner[0])
        return f"a list of {item.removeprefix('a ')}s" if item.startswith("a ") else f"a list of {item}"
    if origin is dict:
        return f"a table of {describe(inner[1]).removeprefix('a ')}s by name"
    if isinstance(hint, type) and hasattr(hint, "IN_WORDS"):
        return str(hint.IN_WORDS)
    if isinstance(hint, type) and issubclass(hint, BaseModel):
        return f"a table with kind = '{_kind(hint)}'" if _kind(hint) else f"a table with {_either(hint.model_fields)}"
    return getattr(hint, "__name__", str(hint))


def _options(hint: Any) -> list[Any]:
    """Alternatives of a union, nested ones included, without None."""
    if get_origin(hint) is Annotated and get_origin(get_args(hint)[0]) in (Union, types.UnionType):
        return _options(get_args(hint)[0])
    if get_origin(hint) in (Union, types.UnionType):
        return [option for inner in get_args(hint) for option in _options(inner) if option is not type(None)]
    return [hint]


def _kind(hint: Any) -> str | None:
    """What a table of this type says under `kind`, if it says anything."""
    if isinstance(hint, type) and issubclass(hint, BaseModel) and "kind" in hint.model_fields:
        return str(hint.model_fields["kind"].default)
    return None


def _either(words: Iterable[Any]) -> str:
    """'a', 'b' or 'c'."""
    *head, last = [repr(word) for word in words]
    return f"{', '.join(head)} or {last}" if head else last


def parse(where: str, hint: Any, value: Any, folder: Path | None = None) -> Any:
    """Convert `value` to the annotated type; raises UserError with one sentence that starts with `where`."""
    value = _plain(value)
    try:
        return _adapter(hint).validate_python(value, context={"folder": folder})
    except ValidationError as error:
        raise UserError(f"{where}{_sentence(error, hint, value)}") from error


def _adapter(hint: Any) -> Any:
    """What converts to a type; made once for each, as making one takes longer than all else of a task's terms."""
    try:
        return _adapters(hint)
    except TypeError:  # an annotation that cannot be hashed
        return TypeAdapter(Annotated[hint, Strict()])


@cache
def _adapters(hint: Any) -> Any:
    return TypeAdapter(Annotated[hint, Strict()])


def _plain(value: Any) -> Any:
    """Arrays and tensors as lists, so that Python callers need not convert the planner's output."""
    if isinstance(value, Tensor):
        return value.detach().cpu().tolist()
    if isinstance(value, np.ndarray | np.generic):
        return value.tolist()
    return value


_NAMED = (
    "value_error",
    "extra_forbidden",
    "greater_than",
    "greater_than_equal",
    "less_than",
    "less_than_equal",
    "too_short",
    "too_long",
)


def _sentence(error: ValidationError, hint: Any, value: Any) -> str:
    """What is wrong with a table or a bound, where in it; of any other value that it should be of another type."""
    if isinstance(value, Mapping) or deepest(error)["type"] in _NAMED:
        return ": " + sentence(error, value, hint)
    return f" must be {describe(hint)}, not {shown(value)}"


def stated(hint: Any, value: Any, kind: Any) -> list[Any]:
    """Every part of `value` whose annotation in `hint` is `kind`: `Time`, `Window`."""
    if hint == kind:
        base = get_args(kind)[0]
        return [value] if isinstance(value, get_origin(base) or base) else []
    origin, inner = get_origin(hint), get_args(hint)
    if origin in (Union, types.UnionType, Annotated):
        options = inner[:1] if origin is Annotated else inner
        return [found for option in options for found in stated(option, value, kind)]
    if origin is list and isinstance(value, list):
        return [found for item in value for found in stated(inner[0], item, kind)]
    if origin is dict and isinstance(value, dict):
        return [found for item in value.values() for found in stated(inner[1], item, kind)]
    return []


def moved(hint: Any, value: Any, by: Place) -> Any:
    """A parameter's value, annotated as `hint`, where everything lies so much (m) further: all coordinates in it move.

    Coordinates are what is annotated so (`WorldX`, `WorldY`, `WorldZ`), also in lists, points, regions and tracks.

    Raises:
        UserError: a number without such an annotation that can hardly be anything else.
    """
    if hasattr(value, "moved"):
        return value.moved(by)
    if isinstance(value, BaseModel):
        hints = {name: field.annotation for name, field in type(value).model_fields.items()}
        return value.model_copy(update={name: moved(hint, getattr(value, name), by) for name, hint in hints.items()})
    if isinstance(value, Point | FloorPoint):
        hints = get_type_hints(type(value), include_extras=True)
        return type(value)(*(moved(hints[name], number, by) for name, number in value._asdict().items()))
    options = _options(hint)
    if isinstance(value, list | tuple):
        items = next((get_args(option) for option in options if get_origin(option) in (list, tuple, Sequence)), (Any,))
        each = items if len(items) == len(value) and ... not in items else items[:1] * len(value)
        return type(value)(moved(inner, item, by) for inner, item in zip(each, value, strict=True))
    if not isinstance(value, int | float) or isinstance(value, bool):
        return value
    if (axis := next((_WORLD.index(option) for option in options if option in _WORLD), None)) is not None:
        return value + by[axis]
    if any(abs(value + shift) < FAR <= abs(value) for shift in by):
        raise UserError(
            f"{value:.10g} looks like a coordinate far from the origin; annotate it in the goal as WorldX, WorldY or "
            "WorldZ"
        )
    return value


def later(hint: Any, value: Any, by: float) -> Any:
    """A parameter's value, annotated as `hint`, so many seconds later: its times (`Time`, `Window`) and tracks."""
    if hasattr(value, "later"):
        return value.later(by)
    options = _options(hint)
    if value is None or isinstance(value, BaseModel):
        return value
    if isinstance(value, dict):
        items = next((get_args(option)[1] for option in options if get_origin(option) is dict), Any)
        return {key: later(items, item, by) for key, item in value.items()}
    if Window in options and isinstance(value, tuple):
        return value[0] + by, value[1] + by
    if Time in options and isinstance(value, int | float):
        return value + by
    if isinstance(value, list):
        items = next((get_args(option)[0] for option in options if get_origin(option) in (list, Sequence)), Any)
        return [later(items, item, by) for item in value]
    return value


T = TypeVar("T")


def instances(value: Any, kind: type[T]) -> list[T]:
    """Every instance of `kind` inside nested lists, tuples and tables; not inside other objects."""
    if isinstance(value, kind):
        return [value]
    if isinstance(value, Mapping):
        value = list(value.values())
    if isinstance(value, list | tuple):
        return [found for item in value for found in instances(item, kind)]
    return []
