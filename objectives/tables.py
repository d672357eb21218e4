"""[[goal]] tables as pydantic models, of which JSON Schema follows: one for each registered goal."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Literal

from pydantic import BaseModel, ConfigDict, Field, create_model

from objectives.registry import GoalSpec, goals
from objectives.signatures import Parameter
from objectives.term import OPTIONS


def goal_tables() -> tuple[type[BaseModel], ...]:
    """The table of every goal that is registered now, by name; terms themselves are read by `Term.from_table`."""
    return tuple(_table(spec) for spec in goals())


def fields_of(parameters: Mapping[str, Parameter]) -> dict[str, Any]:
    """Parameters of a registered function as fields of a pydantic model."""
    return {
        parameter.name: (parameter.hint, Field(parameter.default, description=parameter.doc or None))
        for parameter in parameters.values()
    }


def _table(spec: GoalSpec) -> type[BaseModel]:
    stated = fields_of(spec.parameters)
    stated |= {key: (hint | None, None) for key, hint in OPTIONS.items()}
    stated["use"] = (Literal[spec.name], ...)
    return create_model(spec.name, __config__=ConfigDict(extra="forbid"), __doc__=spec.summary, **stated)
