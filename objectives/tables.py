"""[[goal]] tables as pydantic models, of which JSON Schema follows: one for each registered goal."""

from __future__ import annotations

from typing import Any, Literal

from pydantic import BaseModel, ConfigDict, Field, create_model

from objectives.registry import GoalSpec, goals
from objectives.term import OPTIONS


def goal_tables() -> tuple[type[BaseModel], ...]:
    """The table of every goal that is registered now, by name; terms themselves are read by `Term.from_table`."""
    return tuple(_table(spec) for spec in goals())


def _table(spec: GoalSpec) -> type[BaseModel]:
    stated: dict[str, Any] = {
        parameter.name: (parameter.hint, Field(parameter.default, description=parameter.doc or None))
        for parameter in spec.parameters.values()
    }
    stated |= {key: (hint | None, None) for key, hint in OPTIONS.items()}
    stated["use"] = (Literal[spec.name], ...)
    return create_model(spec.name, __config__=ConfigDict(extra="forbid"), __doc__=spec.summary, **stated)
