"""The families of generators by name. A new one is a folder beside this file, and a line in `MODULES`."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from importlib import import_module
from importlib.metadata import entry_points
from pathlib import Path
from typing import TYPE_CHECKING, Any

from pydantic import BaseModel

from scenectl.generators.spec import Spec
from scenes.errors import UserError, clipped, did_you_mean

if TYPE_CHECKING:
    from scenectl.generators.base import EditingGenerator, Generator

MODULES = {"mscot": "scenectl.generators.mscot"}
"""Module of each family, which holds its `FAMILY`."""

DEFAULT = "mscot"
"""The family of tasks that name none, and of weights from before manifests said it."""

ENTRY_POINTS = "scenectl.generators"
"""Group in which other packages name theirs: ``lively = "lively.scenectl:FAMILY"``."""


@dataclass(frozen=True)
class Family:
    """A family of generators, before any weights are read; its module imports no networks.

    Attributes:
        name: what tasks write.
        spec: what it can do.
        settings: pydantic model of its sampling, whose keys stand beside `name` in a task's [generator].
        open: makes a generator of weights and settings; raises UserError where they do not fit.
        weights: name of the bundled weights that "default" stands for, or a folder; None where it has no weights, and
            `open` is handed none.
        training: "module:attribute" of its `scenectl.training.stages.Training`; None where it cannot be trained here.
    """

    name: str
    spec: Spec
    settings: type[BaseModel]
    open: Callable[[Any, Any], Generator]
    weights: str | Path | None = "default"
    training: str | None = None


_REGISTERED: dict[str, Family] = {}


def register(family: Family) -> Family:
    """Make a family known to tasks and benches of this process; raises UserError where the name is taken."""
    if family.name in names():
        raise UserError(f"a generator '{family.name}' is registered already; choose another name")
    _REGISTERED[family.name] = family
    return family


def forget(name: str) -> None:
    """Remove what `register` added; no error when it is absent."""
    _REGISTERED.pop(name, None)


def names() -> list[str]:
    """Every family: ours, those of other packages, and those registered in this process."""
    return [*MODULES, *(point.name for point in entry_points(group=ENTRY_POINTS)), *_REGISTERED]


def find(name: str) -> Family:
    """A family by its name; raises UserError naming the nearest one, or the package that cannot be imported."""
    if name in _REGISTERED:
        return _REGISTERED[name]
    if name in MODULES:
        family: Family = import_module(MODULES[name]).FAMILY
        return family
    for point in entry_points(group=ENTRY_POINTS, name=name):
        try:
            found = point.load()
        except Exception as error:
            raise UserError(f"generator '{name}' ({point.value}) cannot be imported: {error}") from error
        if not isinstance(found, Family):
            raise UserError(f"generator '{name}': {point.value} is no scenectl.generators.registry.Family")
        return found
    raise UserError(f"unknown generator '{clipped(name)}'{did_you_mean(name, names())}")


def editing(generator: Generator) -> EditingGenerator:
    """A generator that can make parts of a motion anew; raises UserError naming those that can for any other."""
    from scenectl.generators.base import EditingGenerator

    if isinstance(generator, EditingGenerator):
        return generator
    able = [name for name in names() if "edit" in find(name).spec.abilities]
    raise UserError(f"generator '{generator.name}' cannot edit motions; {' and '.join(able)} can")
