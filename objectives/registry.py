"""The registry: goals by name, their parameters read from the signature, and what a goal may return."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeVar

from jaxtyping import Bool, Float
from torch import Tensor

from objectives.aims import A_METRE, Aim
from objectives.kernels import KERNELS, REDUCTIONS, Kernel, Reduction
from objectives.marks import Mark
from objectives.signatures import Parameter, checked, parameters_of, summary_of
from scenes.errors import UserError, clipped, did_you_mean

TERM_KEYS = (
    "use",
    "name",
    "weight",
    "tolerance",
    "at",
    "weights",
    "window",
    "sometime",
    "kernel",
    "delta",
    "reduction",
)
"""Keys of a [[goal]] table that belong to the term. A goal may declare `at` and `weights`, which it is then handed."""

_RESERVED = frozenset(TERM_KEYS) - {"at", "weights"}

JOINT = "joint"
"""A goal whose parameter has this name is about that joint or those joints, and need not say so in its result."""
EXEMPT = ("exempt", "exempt_windows", "touches")
"""Parameters of goals that keep the body out of things: joints that may touch them, and when."""


@dataclass(frozen=True)
class Masked:
    """A residual with the facts that a plain tensor cannot carry. Everything but `residual` may be left out.

    Attributes:
        residual: natural units, zero where satisfied, ``[*b, T, k]``. Its k components are n entries.
        active: where the goal applies: ``[T]``, ``[*b, T]`` or, one for each entry, ``[*b, T, n]`` (told apart by
            the number of axes). What is inactive costs nothing and is left out of means.
        weights: factor on the cost of each entry, same shapes; the mean still divides by the plain count.
        sizes: components of each entry: one number, or one for each entry. A target in space has entries of 3,
            whose length (and not each coordinate) is what all kernels and the report look at.
        labels: name of each entry in reports, usually a joint.
        joints: the joint that each entry is about, where its label is no joint's name; None for no single joint.
        points: where each entry is, world m, for reports.
        targets: where each entry is drawn to, world m, of goals that pull; nan on coordinates that are free and where
            an entry is drawn nowhere. The diagnosis tells targets out of reach by it, the viewer marks them, and
            generators that take positions as inputs are told them.
        aim: how each entry shall be turned, of goals that ask for directions or rotations; likewise marked and told.
        marks: what the viewer shows, asked for only when it does; by default targets, or else aims and the points and
            tracks among the parameters.
    """

    residual: Float[Tensor, "*b T k"]
    active: Bool[Tensor, "..."] | None = None
    weights: Float[Tensor, "..."] | None = None
    sizes: int | tuple[int, ...] | None = None
    labels: Sequence[str] = ()
    joints: Sequence[str | None] = ()
    points: Float[Tensor, "*b T n 3"] | None = None
    targets: Float[Tensor, "*b T n 3"] | None = None
    aim: Aim | None = None
    marks: Callable[[], Sequence[Mark]] | None = None


GoalFunction = Callable[..., "Tensor | Masked"]
Supports = Callable[[Mapping[str, Any]], Sequence[str]]
F = TypeVar("F", bound=GoalFunction)


@dataclass(frozen=True)
class GoalSpec:
    """A registered goal: the function, how its residual becomes a cost, and what it can be told.

    Attributes:
        name: what task files write after `use`.
        summary: first sentence of its documentation.
        unit: of the residual: m, rad, m/s, ...
        kernel, reduction, scale: the defaults of a term, from the paper that states the goal.
        dim: components of one entry, where the goal itself does not say.
        tolerance: worst residual that still counts as met, where the term does not say.
        pulls: whether it draws joints to a place, or turns them, however far, so that one out of reach is an outlier.
        parameters: by name, in the order of the signature.
        local: what it says of a frame depends on that frame and two to both sides alone.
        supports: of parameters, the joints whose part of the body then rests on something, which the verdict counts
            as support; None for none.
    """

    name: str
    function: GoalFunction
    summary: str
    unit: str
    kernel: Kernel
    reduction: Reduction
    scale: float
    delta: float
    dim: int
    tolerance: float
    pulls: bool
    parameters: Mapping[str, Parameter]
    local: bool = False
    supports: Supports | None = None

    @property
    def draws(self) -> bool:
        """It draws joints to a place, and does not only turn them."""
        return self.pulls and self.unit == "m"

    @property
    def metre(self) -> float:
        """What counts as a metre in its unit."""
        return A_METRE.get(self.unit, 1.0)

    def validate(self, given: Mapping[str, Any], folder: Path | None = None, label: str = "") -> dict[str, Any]:
        """Parameters converted to their annotated types.

        Args:
            given: as written in a task file or in Python.
            folder: where relative file names are looked for.
            label: how errors start, by default with the goal's name.

        Raises:
            UserError: one sentence for an unknown or missing parameter, or a value that does not fit.
        """
        label = label or f"goal '{self.name}'"
        return checked(label, self.parameters, given, folder, set(TERM_KEYS) - {"use"})


_GOALS: dict[str, GoalSpec] = {}
_RETIRED = {"bone_length": "bones of all that is generated are rigid by construction; remove it from the task"}
"""Goals of earlier versions: why nothing needs them, and what to do."""


def goal(
    *,
    unit: str,
    kernel: Kernel = "squared",
    reduction: Reduction = "sum",
    scale: float = 1.0,
    delta: float = 0.1,
    dim: int = 1,
    tolerance: float = 0.0,
    pulls: bool = False,
    local: bool = False,
    supports: Supports | None = None,
    name: str | None = None,
    replace: bool = False,
) -> Callable[[F], F]:
    """Register a function ``(motion, context, *, parameters) -> residual [*b, T, k]`` as a goal.

    The function stays as it is. Parameters, their types, defaults and meanings are read from its signature and
    the `Args:` section of its docstring.

    Args:
        unit: unit of the residual (m, rad, m/s, ...).
        kernel: `squared`, `linear`, `huber` or `geman_mcclure`, the default of terms that use the goal.
        reduction: `sum` or `mean` over active valid frames and entries.
        scale: factor on the cost, multiplied by the term's weight.
        delta: where `huber` turns linear and `geman_mcclure` flat, in `unit`.
        dim: components that make up one entry of the residual, 3 for a vector in space.
        tolerance: worst residual that still counts as met, in `unit`.
        pulls: it draws joints to a place, or turns them, however far; refinement pulls no harder where that is out of
            reach.
        local: what it says of a frame depends on that frame and two to both sides alone, so that a term with a window
            need not show it the rest of a long motion.
        supports: of parameters, the joints whose part of the body rests on something where the goal is met.
        name: name in task files, by default the function's.
        replace: replace a goal of the same name; otherwise a second one is an error.
    """

    def register(function: F) -> F:
        label = name or function.__name__
        if label in _GOALS and not replace:
            old = _GOALS[label].function.__module__
            raise UserError(f"a goal '{label}' is already registered by {old}; choose another name or say replace=True")
        if kernel not in KERNELS or reduction not in REDUCTIONS:
            raise UserError(f"goal '{label}': kernel is one of {KERNELS} and reduction one of {REDUCTIONS}")
        parameters = parameters_of(f"goal '{label}'", function, ("motion", "context"), _RESERVED)
        _GOALS[label] = GoalSpec(
            label, function, summary_of(function), unit, kernel, reduction, float(scale), float(delta), dim,
            float(tolerance), pulls, parameters, local, supports,
        )  # fmt: skip
        return function

    return register


def get_goal(use: str | GoalFunction) -> GoalSpec:
    """The goal of that name, or the one that a decorated function is; raises UserError naming the nearest."""
    if not isinstance(use, str):
        for spec in _GOALS.values():
            if spec.function is use:
                return spec
        raise UserError(f"function '{getattr(use, '__name__', use)}' is not a goal; decorate it with @goal(unit=...)")
    if use not in _GOALS and use in _RETIRED:
        raise UserError(f"goal '{use}' is gone: {_RETIRED[use]}")
    if use not in _GOALS:
        raise UserError(
            f"unknown goal '{clipped(use)}'{did_you_mean(use, _GOALS)} (--allow-code FILE.py brings one of your own)"
        )
    return _GOALS[use]


def goals() -> list[GoalSpec]:
    """Every registered goal, by name: the command line's table."""
    return [_GOALS[name] for name in sorted(_GOALS)]


def forget(name: str) -> None:
    """Remove a goal from the registry, as tests and notebooks need; no error when it is absent."""
    _GOALS.pop(name, None)
