"""A recipe: everything that decides what a training run makes, in one TOML file."""

from __future__ import annotations

from collections.abc import Mapping
from importlib.resources import files
from operator import attrgetter
from pathlib import Path
from typing import Any, TypeVar

from pydantic import BaseModel, Field, ValidationError

from scenectl.data.augment import Augmentation
from scenectl.training.placement import Precision
from scenes.errors import UserError, clipped, did_you_mean
from scenes.files import read_toml, unreadable
from scenes.tables import Table
from scenes.validation import sentence

R = TypeVar("R", bound="Recipe")


class Variant(Table):
    """A recipe's variant: its name, and the keys that it changes, by their dotted names."""

    name: str = Field(pattern=r"^[\w.+-]+$")
    set: dict[str, Any] = Field(default_factory=dict)


class Recipe(Table):
    """Data and training settings; each family's own recipe adds a table for every stage and says what `model` is.

    Attributes:
        family: of generators, whose networks are trained.
        seed: of windows, initial weights and dropout.
        commercial_only: leave out clips whose terms forbid commercial use.
        precision: in which networks compute while they train (`scenectl.training.placement.place`).
        model: configuration of the networks, with their `name`, as it is stored with the weights.
        augmentation: copies of clips that are trained on, too.
        sweep: variants of this recipe that `scenectl train sweep` compares.
    """

    family: str
    seed: int = 0
    commercial_only: bool = False
    precision: Precision = "auto"
    model: BaseModel
    augmentation: Augmentation = Augmentation()
    sweep: tuple[Variant, ...] = ()

    @property
    def name(self) -> str:
        """Of the networks."""
        return str(self.value("model.name"))

    def value(self, dotted: str) -> Any:
        """What stands under a dotted name."""
        return attrgetter(dotted)(self)

    def varied(self: R, changes: Mapping[str, Any]) -> R:
        """This recipe with some of its keys changed, each given by its dotted name.

        Raises:
            UserError: a key or value that recipes do not have.
        """
        table = self.model_dump()
        for dotted, value in changes.items():
            *path, last = dotted.split(".")
            inner = table
            for key in path:
                inner = inner.get(key, {}) if isinstance(inner, dict) else {}
            if not isinstance(inner, dict) or last not in inner:
                raise UserError(f"recipe '{self.name}' has no key '{dotted}'{did_you_mean(dotted, _keys(table))}")
            inner[last] = value
        try:
            return type(self).model_validate(table)
        except ValidationError as error:
            raise UserError(f"recipe '{self.name}': {sentence(error, table, type(self))}") from error


def load_recipe(name: str | Path, kind: type[R]) -> R:
    """A bundled recipe by name, or a TOML file; raises UserError saying which line of it is wrong.

    A recipe with ``extends = "compact"`` is that one (bundled, or a file beside it) with its own keys in place of
    the other's, table by table.

    Args:
        name: of the recipe, or its file.
        kind: the family's own class of recipes.
    """
    path = _find(name, Path())
    table = _table(path, ())
    try:
        return kind.model_validate(table)
    except ValidationError as error:
        raise UserError(f"training config '{path}': {sentence(error, table, kind)}") from error


def family_of(name: str | Path) -> str | None:
    """The family that a recipe states, before anything else in it is looked at; None where it states none."""
    family = _table(_find(name, Path()), ()).get("family")
    return None if family is None else str(family)


def _find(name: str | Path, beside: Path) -> Path:
    folder = Path(str(files("scenectl"))) / "configs"
    known = sorted(path.stem for path in folder.glob("*.toml"))
    path = folder / f"{name}.toml" if str(name) in known else beside / name
    if unreadable(path):
        hint = did_you_mean(str(name), known)
        raise UserError(f"no training config '{clipped(str(name), 300)}': neither a file nor bundled{hint}")
    return path


def _table(path: Path, seen: tuple[Path, ...]) -> dict[str, Any]:
    """A recipe's keys over those of the one it extends."""
    if path.resolve() in seen:
        raise UserError(f"training config '{path}' extends itself; let one of the configs stand alone")
    table = read_toml(path, "training config")
    other = table.pop("extends", None)
    if other is None:
        return table
    if not isinstance(other, str):
        raise UserError(f"training config '{path}': extends: give the name of one config")
    return _over(_table(_find(other, path.parent), (*seen, path.resolve())), table)


def _over(base: dict[str, Any], changes: dict[str, Any]) -> dict[str, Any]:
    both = [key for key, value in changes.items() if isinstance(value, dict) and isinstance(base.get(key), dict)]
    return base | changes | {key: _over(base[key], changes[key]) for key in both}


def _keys(table: Mapping[str, Any], prefix: str = "") -> list[str]:
    """Dotted names of everything that is no table."""
    found: list[str] = []
    for key, value in table.items():
        found += _keys(value, f"{prefix}{key}.") if isinstance(value, dict) else [f"{prefix}{key}"]
    return found
