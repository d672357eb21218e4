"""A recipe: everything that decides what a training run makes, in one TOML file."""

from __future__ import annotations

import tomllib
from importlib.resources import files
from pathlib import Path

from pydantic import BaseModel, ConfigDict, ValidationError

from scenectl.data.augment import Augmentation
from scenectl.models.config import ModelConfig
from scenectl.training.refiner import RefinerTraining
from scenectl.training.tokenizer import TokenizerTraining
from scenectl.training.transformer import TransformerTraining
from scenes.errors import UserError, did_you_mean


class Recipe(BaseModel):
    """Networks, data and training settings.

    Attributes:
        seed: of windows, initial weights and dropout.
        commercial_only: leave out clips whose terms forbid commercial use.
    """

    model_config = ConfigDict(extra="forbid", frozen=True)

    seed: int = 0
    commercial_only: bool = False
    model: ModelConfig
    augmentation: Augmentation = Augmentation()
    tokenizer: TokenizerTraining
    refiner: RefinerTraining
    transformer: TransformerTraining


def load_recipe(name: str | Path) -> Recipe:
    """A bundled recipe by name, or a TOML file; raises UserError saying which line of it is wrong."""
    folder = Path(str(files("scenectl"))) / "configs"
    known = sorted(path.stem for path in folder.glob("*.toml"))
    path = folder / f"{name}.toml" if str(name) in known else Path(name)
    if not path.is_file():
        raise UserError(f"no training config '{name}': neither a file nor bundled{did_you_mean(str(name), known)}")
    try:
        return Recipe.model_validate(tomllib.loads(path.read_text()))
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise UserError(f"training config '{path}' is not valid TOML: {error}") from error
    except ValidationError as error:
        first = error.errors()[0]
        where = ".".join(str(part) for part in first["loc"])
        raise UserError(f"training config '{path}': {where}: {first['msg'].lower()}") from error
