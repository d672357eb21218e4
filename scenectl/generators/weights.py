"""Weights on disk: a folder with a manifest that says whose they are, and a file for each part.

``manifest.json`` holds `format`, `family`, `parts` (file by name), `config` and `licence`. Folders from before there
were manifests are described by the headers of their files.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from importlib.resources import files
from pathlib import Path
from typing import Any

from pydantic import BaseModel, ValidationError

from scenectl.generators.registry import DEFAULT, Family
from scenes.errors import UserError, did_you_mean
from scenes.files import write_json
from scenes.validation import sentence

MANIFEST = "manifest.json"
FORMAT = 1
BUNDLED = Path(str(files("scenectl"))) / "weights"


@dataclass(frozen=True)
class Weights:
    """A folder of weights, described.

    Attributes:
        folder: where they lie.
        family: that they belong to.
        parts: file of each part.
        config: of the networks, as the family's own model validates it.
        licence: terms, which follow from the data they were trained on.
        credits: sources of that data, with their terms.
    """

    folder: Path
    family: str
    parts: Mapping[str, Path]
    config: Mapping[str, Any]
    licence: str
    credits: tuple[str, ...] = field(default=())

    def part(self, name: str) -> Path:
        """File of a part; raises UserError where there is none."""
        if name not in self.parts:
            raise UserError(f"weights in '{self.folder}' have no {name}; copy all files from one training")
        return self.parts[name]

    def save(self) -> None:
        """Write the manifest beside the parts, whole or not at all."""
        table = {
            "format": FORMAT,
            "family": self.family,
            "parts": {name: path.name for name, path in self.parts.items()},
            "config": self.config,
            "licence": self.licence,
            "credits": list(self.credits),
        }
        write_json(table, self.folder / MANIFEST)


class _Header(BaseModel):
    """What stands in the header of a file, about all parts."""

    family: str = DEFAULT
    config: dict[str, Any]
    licence: str
    credits: list[str] = []


class _Manifest(_Header):
    """What `manifest.json` holds."""

    format: int = FORMAT
    family: str
    parts: dict[str, str]


def bundled_weights() -> list[str]:
    """Names of the weights that come with the package."""
    return sorted({path.parent.name for path in BUNDLED.glob("*/*.safetensors")})


def weights_folder(name: str | Path) -> Path:
    """Folder of bundled weights by name, or the folder given; raises UserError where there is none."""
    known = bundled_weights()
    if str(name) in known:
        return BUNDLED / str(name)
    if Path(name).is_dir():
        return Path(name)
    raise UserError(f"no weights '{name}': neither a folder nor bundled{did_you_mean(str(name), known)}")


def open_weights(family: Family, name: str | Path = "default") -> Weights | None:
    """The weights of a family by name, or in a folder; None for a family that has none.

    Raises:
        UserError: there are none of that name, they are damaged, or another family's.
    """
    if family.weights is None:
        if str(name) != "default":
            raise UserError(f"generator '{family.name}' has no weights; leave '{name}' out")
        return None
    found = described(weights_folder(family.weights if str(name) == "default" else name))
    if found.family != family.name:
        raise UserError(
            f"weights in '{found.folder}' are those of generator '{found.family}', not of '{family.name}'; "
            f'state name = "{found.family}" under [generator], or --generator {found.family}'
        )
    return found


def described(folder: Path) -> Weights:
    """What a folder of weights holds: by its manifest, or by the headers of its files where it has none."""
    path = folder / MANIFEST
    if not path.exists():
        return _by_headers(folder)
    try:
        table = _Manifest.model_validate_json(path.read_bytes())
    except ValidationError as error:
        raise UserError(f"'{path}': {sentence(error, None, _Manifest)}; copy it anew from the training") from error
    except OSError as error:
        raise UserError(f"'{path}' cannot be read ({error.strerror}); copy it anew from the training") from error
    if table.format > FORMAT:
        raise UserError(f"'{path}' has format {table.format}, and this version reads up to {FORMAT}; update scenectl")
    parts = {name: folder / Path(file).name for name, file in table.parts.items()}
    return Weights(folder, table.family, parts, table.config, table.licence, tuple(table.credits))


def _by_headers(folder: Path) -> Weights:
    from scenectl.networks.checkpoint import read_about  # torch, which those who only look for names need not import

    about = {path.stem: read_about(path) for path in sorted(folder.glob("*.safetensors"))}
    if not about:
        raise UserError(f"'{folder}' holds no weights: neither a manifest.json nor a .safetensors file")
    first = about.get("tokenizer") or next(iter(about.values()))
    try:
        table = _Header.model_validate(first)
    except ValidationError as error:
        reason = sentence(error, first, _Header)
        raise UserError(f"weights in '{folder}' describe no model ({reason}); copy them anew") from error
    parts_of = {name: folder / f"{name}.safetensors" for name in about}
    return Weights(folder, table.family, parts_of, table.config, table.licence, tuple(table.credits))
