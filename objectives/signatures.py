"""Parameters of registered functions (goals, actions): read from a signature and its docstring, checked when given."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, get_type_hints

from objectives.docstrings import meanings
from objectives.parameters import describe, parse
from scenes.errors import UserError, did_you_mean


@dataclass(frozen=True)
class Parameter:
    """One parameter: name, type in words, default (`...` where it must be stated), meaning."""

    name: str
    type: str
    default: Any
    doc: str
    hint: Any

    @property
    def required(self) -> bool:
        return self.default is ...


def parameters_of(
    label: str, function: Callable[..., Any], first: Sequence[str], reserved: Collection[str] = ()
) -> dict[str, Parameter]:
    """Parameters of a function beyond its first ones, by name, in order.

    Args:
        label: how errors name the function, such as "goal 'face'".
        function: whose annotations and docstring (`Args:`) tell types, defaults and meanings.
        first: names of the parameters that it must begin with, which nobody states in a file.
        reserved: names that no other parameter may have.

    Raises:
        UserError: another beginning, a type that cannot be resolved or is missing, or a reserved name.
    """
    try:
        hints = get_type_hints(function, include_extras=True)
    except Exception as error:
        raise UserError(f"{label}: a type in its signature cannot be resolved ({error})") from error
    signature = list(inspect.signature(function).parameters.values())
    if [p.name for p in signature[: len(first)]] != list(first):
        raise UserError(f"{label}: its function must start with ({', '.join(first)}, *, ...)")
    told = meanings(inspect.getdoc(function) or "", "Args:", "Arguments:")
    found: dict[str, Parameter] = {}
    for p in signature[len(first) :]:
        if p.kind in (p.VAR_POSITIONAL, p.VAR_KEYWORD) or p.name not in hints:
            raise UserError(f"{label}: parameter '{p.name}' needs a name of its own and a type annotation")
        if p.name in reserved:
            raise UserError(f"{label}: parameter name '{p.name}' belongs to every table; choose another")
        default = ... if p.default is p.empty else p.default
        hint = hints[p.name]
        found[p.name] = Parameter(p.name, describe(hint), default, told.get(p.name, ""), hint)
    return found


def checked(
    label: str,
    parameters: Mapping[str, Parameter],
    given: Mapping[str, Any],
    folder: Path | None = None,
    others: Collection[str] = (),
) -> dict[str, Any]:
    """Given values converted to their annotated types.

    Args:
        label: how errors start.
        parameters: those that there are.
        given: as written in a task file or in Python.
        folder: where relative file names are looked for.
        others: keys of the same table that are no parameters, for hints.

    Raises:
        UserError: one sentence for an unknown or missing parameter, or a value that does not fit.
    """
    for key in given:
        if key not in parameters:
            raise UserError(f"{label}: unknown parameter '{key}'{did_you_mean(key, {*parameters, *others})}")
    for parameter in parameters.values():
        if parameter.required and parameter.name not in given:
            meaning = f" ({parameter.doc})" if parameter.doc else ""
            raise UserError(f"{label}: parameter '{parameter.name}' is missing; it is {parameter.type}{meaning}")
    return {
        key: parse(f"{label}: parameter '{key}'", parameters[key].hint, value, folder) for key, value in given.items()
    }


def summary_of(function: Callable[..., Any]) -> str:
    """The first paragraph of a docstring, on one line."""
    return " ".join((inspect.getdoc(function) or "").split("\n\n")[0].split())
