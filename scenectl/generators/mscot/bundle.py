"""The networks of one trained model, loaded from a folder of weights, frozen."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pydantic import ValidationError

from scenectl.generators.mscot.config import ModelConfig
from scenectl.generators.mscot.networks.preconditioner import Preconditioner
from scenectl.generators.mscot.networks.refiner import Refiner
from scenectl.generators.mscot.networks.tokenizer import Tokenizer
from scenectl.generators.mscot.networks.transformer import ScaleTransformer
from scenectl.generators.weights import Weights
from scenectl.networks.checkpoint import load_weights, read_about, untrained
from scenectl.networks.text import TextEncoder, load_text_encoder
from scenes.errors import UserError
from scenes.validation import sentence

PARTS = ("tokenizer", "transformer", "refiner")
METRIC = "metric"
"""A fourth part, measured on the others when they are exported; weights may lack it."""


@dataclass(frozen=True)
class Bundle:
    """Tokenizer, transformer, refiner and text encoder that belong together.

    Attributes:
        licence: terms of the weights, which follow from the data they were trained on.
        metric: coordinates in which refinement searches; None, as in weights that lack it, leaves embeddings alone.
    """

    config: ModelConfig
    tokenizer: Tokenizer
    transformer: ScaleTransformer
    refiner: Refiner
    text: TextEncoder
    licence: str
    metric: Preconditioner | None = None


def load_bundle(weights: Weights, with_metric: bool = True) -> Bundle:
    """Load a model; raises UserError where files are missing, damaged or of different models.

    Args:
        weights: a folder, described.
        with_metric: read the metric, too, where there is one.
    """
    config = _config(weights.config, weights.folder)
    if any(_config_of(weights, part) != config for part in PARTS):
        raise UserError(f"weights in '{weights.folder}' belong to different models; copy all files from one training")
    networks = build(config, lambda part, make: untrained(weights.part(part), make, part))
    for part, module in zip(PARTS, networks, strict=True):
        load_weights(module, weights.part(part))
        module.eval().requires_grad_(False)
    text = load_text_encoder(config.text)
    if text.dim != config.transformer.text_dim:
        raise UserError(
            f"weights in '{weights.folder}' want text features of {config.transformer.text_dim} numbers, and text "
            f"encoder '{config.text}' gives {text.dim}; name the encoder they were trained with"
        )
    metric = _metric(weights, config) if with_metric else None
    return Bundle(config, *networks, text, weights.licence, metric)


def _metric(weights: Weights, config: ModelConfig) -> Preconditioner | None:
    """The metric in a folder of weights, or None where it has none; raises UserError for another model's."""
    if METRIC not in weights.parts:
        return None
    path = weights.part(METRIC)
    if _config_of(weights, METRIC) != config:
        raise UserError(f"'{path}' belongs to another model; measure it anew with 'scenectl train metric'")
    dim, scales = config.tokenizer.code_dim, len(config.tokenizer.scales)
    metric = untrained(path, lambda: Preconditioner(dim, scales), METRIC)
    load_weights(metric, path)
    return metric.requires_grad_(False)


def _config_of(weights: Weights, part: str) -> ModelConfig:
    """What a part's own header says; raises UserError for a damaged one."""
    path = weights.part(part)
    return _config(read_about(path).get("config"), path)


def _config(given: Any, where: Path) -> ModelConfig:
    """A configuration with today's defaults for fields that it does not know; raises UserError for no MSCoT's."""
    try:
        return ModelConfig.model_validate(given)
    except ValidationError as error:
        reason = sentence(error, given, ModelConfig)
        raise UserError(f"weights in '{where}' describe no model of this family ({reason}); copy them anew") from error


def build(
    config: ModelConfig, each: Callable[[str, Callable[[], Any]], Any] = lambda part, make: make()
) -> tuple[Tokenizer, ScaleTransformer, Refiner]:
    """The three networks, untrained.

    Args:
        config: their sizes.
        each: makes one, given which of `PARTS` it is, and how; by default without more ado.
    """
    codes, dim, scales = config.tokenizer.codes, config.tokenizer.code_dim, len(config.tokenizer.scales)
    return (
        each("tokenizer", lambda: Tokenizer(config.tokenizer)),
        each("transformer", lambda: ScaleTransformer(config.transformer, codes, dim, scales)),
        each("refiner", lambda: Refiner(config.refiner, dim, scales)),
    )
