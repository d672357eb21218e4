"""The networks of one trained model, loaded from a folder, frozen."""

from __future__ import annotations

from dataclasses import dataclass
from importlib.resources import files
from pathlib import Path
from typing import Any

from pydantic import ValidationError

from scenectl.generators.mscot.config import ModelConfig
from scenectl.generators.mscot.networks.metric import Metric
from scenectl.generators.mscot.networks.refiner import Refiner
from scenectl.generators.mscot.networks.tokenizer import Tokenizer
from scenectl.generators.mscot.networks.transformer import ScaleTransformer
from scenectl.networks.checkpoint import load_weights, read_about
from scenectl.networks.text import TextEncoder, load_text_encoder
from scenes.errors import UserError, did_you_mean

PARTS = ("tokenizer", "transformer", "refiner")
METRIC = "metric.safetensors"
"""Beside the networks, and measured on them when they are exported."""

_BUNDLED = Path(str(files("scenectl"))) / "weights"


@dataclass(frozen=True)
class Bundle:
    """Tokenizer, transformer, refiner and text encoder that belong together.

    Attributes:
        licence: terms of the weights, which follow from the data they were trained on.
        about: the description stored with the weights.
        metric: coordinates in which refinement searches; None, as in weights that lack it, leaves embeddings alone.
    """

    config: ModelConfig
    tokenizer: Tokenizer
    transformer: ScaleTransformer
    refiner: Refiner
    text: TextEncoder
    licence: str
    about: dict[str, Any]
    metric: Metric | None = None


def bundled_weights() -> list[str]:
    """Names of the weights that come with the package."""
    return sorted(path.parent.name for path in _BUNDLED.glob("*/tokenizer.safetensors"))


def weights_folder(name: str | Path) -> Path:
    """Folder of bundled weights by name, or the folder given; raises UserError where there is none."""
    folder = Path(name)
    if folder.is_dir():
        return folder
    names = bundled_weights()
    if str(name) in names:
        return _BUNDLED / str(name)
    raise UserError(f"no weights '{name}': neither a folder nor bundled{did_you_mean(str(name), names)}")


def load_bundle(name: str | Path = "default", with_metric: bool = True) -> Bundle:
    """Load a model; raises UserError where files are missing, damaged or of different models.

    Args:
        name: of bundled weights, or a folder.
        with_metric: read the metric, too, where there is one.
    """
    folder = weights_folder(name)
    about = {part: read_about(folder / f"{part}.safetensors") for part in PARTS}
    try:
        config = ModelConfig.model_validate(about["tokenizer"]["config"])
        same = all(about[part]["config"] == about["tokenizer"]["config"] for part in PARTS)
        licence = str(about["tokenizer"]["licence"])
    except (KeyError, ValidationError) as error:
        raise UserError(f"weights in '{folder}' describe no model ({str(error).splitlines()[0]})") from error
    if not same:
        raise UserError(f"weights in '{folder}' belong to different models; copy all three files from one training")
    tokenizer, transformer, refiner = build(config)
    for part, module in zip(PARTS, (tokenizer, transformer, refiner), strict=True):
        load_weights(module, folder / f"{part}.safetensors")
        module.eval().requires_grad_(False)
    text = load_text_encoder(config.text)
    if text.dim != config.transformer.text_dim:
        raise UserError(
            f"weights in '{folder}' want text features of {config.transformer.text_dim} numbers, and text encoder "
            f"'{config.text}' gives {text.dim}; name the encoder they were trained with"
        )
    return Bundle(
        config, tokenizer, transformer, refiner, text, licence, about, _metric(folder, config) if with_metric else None
    )


def _metric(folder: Path, config: ModelConfig) -> Metric | None:
    """The metric in a folder of weights, or None where it has none; raises UserError for another model's."""
    path = folder / METRIC
    if not path.is_file():
        return None
    if read_about(path).get("config") != config.model_dump(mode="json"):
        raise UserError(f"'{path}' belongs to another model; measure it anew with 'scenectl train metric'")
    metric = Metric(config.tokenizer.code_dim, len(config.tokenizer.scales))
    load_weights(metric, path)
    return metric.requires_grad_(False)


def build(config: ModelConfig) -> tuple[Tokenizer, ScaleTransformer, Refiner]:
    """The three networks, untrained."""
    tokenizer = Tokenizer(config.tokenizer)
    codes, dim, scales = config.tokenizer.codes, config.tokenizer.code_dim, len(config.tokenizer.scales)
    transformer = ScaleTransformer(config.transformer, codes, dim, scales)
    return tokenizer, transformer, Refiner(config.refiner, dim, scales)
