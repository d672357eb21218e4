"""Where families and their training meet: which plan a recipe asks for, and the manifest that exported weights get."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from importlib import import_module
from pathlib import Path
from typing import Any

from scenectl.generators.registry import DEFAULT, find
from scenectl.generators.weights import Weights
from scenectl.training.recipe import family_of
from scenectl.training.stages import Training
from scenes.errors import UserError


def plan_of(config: str | Path) -> Training[Any]:
    """The plan of a recipe's family (MSCoT's where it states none).

    Raises:
        UserError: the recipe cannot be read, or no such family can be trained.
    """
    name = family_of(config) or DEFAULT
    where = find(name).training
    if where is None:
        raise UserError(f"generator '{name}' cannot be trained here; name another family in '{config}'")
    module, _, attribute = where.partition(":")
    plan = getattr(import_module(module), attribute, None)
    if not isinstance(plan, Training):
        raise UserError(f"generator '{name}': {where} is no scenectl.training.stages.Training")
    return plan


def manifest_of(family: str) -> Callable[[Path, Mapping[str, Path], Mapping[str, Any]], None]:
    """Writes the manifest of a family's weights; see `scenectl.training.stages.Training.manifest`."""

    def write(folder: Path, parts: Mapping[str, Path], about: Mapping[str, Any]) -> None:
        Weights(folder, family, parts, about["config"], about["licence"], tuple(about["credits"])).save()

    return write
