"""The registry of actions: functions by name, their parameters read from the signature."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeVar

from objectives.signatures import Parameter, checked, parameters_of, summary_of
from scenectl.tasks.actions.state import Act, Posture, State, World
from scenes.errors import UserError, clipped, did_you_mean

KEYS = ("do", "name", "goal")
"""Keys of an [[action]] table that are no parameters of its function."""
_FIRST = ("world", "state")

ActionFunction = Callable[..., Act]
F = TypeVar("F", bound=ActionFunction)


@dataclass(frozen=True)
class ActionSpec:
    """A registered action.

    Attributes:
        name: what task files write after `do`.
        function: ``(world, state, *, parameters) -> Act``.
        summary: first paragraph of its documentation.
        posture: in which it must find the body; None for any.
        parameters: by name, in the order of the signature.
    """

    name: str
    function: ActionFunction
    summary: str
    posture: Posture | None
    parameters: Mapping[str, Parameter]

    def validate(self, given: Mapping[str, Any], folder: Path | None = None, label: str = "") -> dict[str, Any]:
        """Parameters converted to their types; raises UserError for an unknown, missing or unfit one."""
        return checked(label or f"action '{self.name}'", self.parameters, given, folder, KEYS)

    def __call__(self, world: World, state: State, **parameters: Any) -> Act:
        """The act, where the body is as the action needs it; raises UserError elsewhere."""
        if self.posture is not None and state.posture != self.posture:
            before = "stand_up" if state.posture == "sitting" else "sit"
            raise UserError(f"the body is {state.posture} when it begins; put an action '{before}' before it")
        return self.function(world, state, **parameters)


_ACTIONS: dict[str, ActionSpec] = {}


def action(*, posture: Posture | None = "standing", name: str | None = None, replace: bool = False) -> Callable[[F], F]:
    """Register a function ``(world, state, *, parameters) -> Act`` as an action.

    The function stays as it is. Parameters, their types, defaults and meanings are read from its signature and the
    `Args:` section of its docstring.

    Args:
        posture: in which it must find the body; None for any.
        name: name in task files, by default the function's.
        replace: replace an action of the same name; otherwise a second one is an error.
    """

    def register(function: F) -> F:
        label = name or function.__name__
        if label in _ACTIONS and not replace:
            old = _ACTIONS[label].function.__module__
            raise UserError(
                f"an action '{label}' is already registered by {old}; choose another name or say replace=True"
            )
        parameters = parameters_of(f"action '{label}'", function, _FIRST, KEYS)
        _ACTIONS[label] = ActionSpec(label, function, summary_of(function), posture, parameters)
        return function

    return register


def get_action(name: str) -> ActionSpec:
    """The action of that name; raises UserError naming the nearest."""
    if name not in _ACTIONS:
        raise UserError(
            f"unknown action '{clipped(name)}'{did_you_mean(name, _ACTIONS)} (--allow-code FILE.py brings one of your "
            "own)"
        )
    return _ACTIONS[name]


def actions() -> list[ActionSpec]:
    """Every registered action, by name."""
    return [_ACTIONS[name] for name in sorted(_ACTIONS)]


def forget(name: str) -> None:
    """Remove an action from the registry, as tests and notebooks need; no error when it is absent."""
    _ACTIONS.pop(name, None)
