"""MSCoT's training as data: tokenizer, its decoder alone, refiner and transformer; the parts they make; their figures.

Refiner and transformer read the finished tokenizer; the transformer's tokens don't depend on the decoder.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Literal

from torch import nn

from scenectl.data.clips import ClipSet, beginnings
from scenectl.generators.mscot.bundle import build, load_bundle
from scenectl.generators.mscot.config import ModelConfig
from scenectl.generators.mscot.networks.preconditioner import Preconditioner
from scenectl.generators.mscot.networks.tokenizer import Decoder, Tokenizer
from scenectl.generators.mscot.networks.transformer import ScaleTransformer
from scenectl.generators.mscot.training.measures import code_use, least_use, measure_tokenizer, round_trip
from scenectl.generators.mscot.training.preconditioner import measure_preconditioner
from scenectl.generators.mscot.training.reconstruction import train_decoder, train_refiner
from scenectl.generators.mscot.training.tokenizer import REVIVED, TokenizerTraining, train_tokenizer
from scenectl.generators.mscot.training.transformer import (
    TransformerTraining,
    cross_entropy_by_scale,
    train_transformer,
)
from scenectl.generators.training import manifest_of
from scenectl.generators.weights import described, weights_folder
from scenectl.training.card import table
from scenectl.training.errors import band_table, error_by_source, joint_table, source_table
from scenectl.training.loop import Loop
from scenectl.training.losses import ReconstructionTraining
from scenectl.training.recipe import Recipe
from scenectl.training.stages import Comparison, Figures, Job, Run, Stage, Training

FRAMES = (64, 128, 196)
"""Lengths at which reconstruction is measured; the paper's is the first."""


class MSCoTRecipe(Recipe):
    """Networks, data and training settings of MSCoT.

    Attributes:
        decoder: its training after the tokenizer's, on codes that stand still; none by default.
    """

    family: Literal["mscot"] = "mscot"
    model: ModelConfig
    tokenizer: TokenizerTraining
    decoder: ReconstructionTraining | None = None
    refiner: ReconstructionTraining
    transformer: TransformerTraining


MSCoTRun = Run[MSCoTRecipe]


def tokenizer_of(run: MSCoTRun, decoder: bool = True) -> Tokenizer:
    """The finished tokenizer, with its finished decoder where the recipe trains one."""
    tokenizer = run.finished("tokenizer").averaged
    assert isinstance(tokenizer, Tokenizer)
    if decoder and "decoder" in run.stages:
        tokenizer.decoder.load_state_dict(run.finished("decoder").averaged.state_dict())
    return tokenizer


def _tokenizer(run: MSCoTRun, settings: TokenizerTraining, job: Job) -> Loop:
    return train_tokenizer(run.recipe.model.tokenizer, settings, job)


def _decoder(run: MSCoTRun, settings: ReconstructionTraining, job: Job) -> Loop:
    return train_decoder(tokenizer_of(run, decoder=False), settings, job)


def _refiner(run: MSCoTRun, settings: ReconstructionTraining, job: Job) -> Loop:
    return train_refiner(run.recipe.model.refiner, tokenizer_of(run), settings, job)


def _transformer(run: MSCoTRun, settings: TransformerTraining, job: Job) -> Loop:
    tokenizer = tokenizer_of(run, decoder=False)  # tokens, in which the decoder has no part
    return train_transformer(run.recipe.model.transformer, tokenizer, run.encoder(), settings, job)


def _restarts(loop: Loop) -> list[str]:
    """How many codes restarted on data because nothing used them; the curve holds means a step."""
    points = [point for point in loop.curve if REVIVED in point]
    if not points:
        return []
    total = sum(point[REVIVED] for point in points) * loop.settings.log_every
    half = [point[REVIVED] for point in points if point["iteration"] > loop.iteration / 2]
    late = sum(half) * loop.settings.log_every
    return [f"Codes restarted because nothing used them: {total:.0f}, {late:.0f} of them in the second half.", ""]


def _preconditioner(run: MSCoTRun, folder: Path) -> Preconditioner:
    """In what coordinates refinement of the exported weights searches best."""
    bundle = load_bundle(described(folder), with_metric=False)
    return measure_preconditioner(bundle.tokenizer, bundle.refiner, run.clips(["train"], True), run.recipe.seed)


def _exported(weights: str | Path) -> Mapping[str, nn.Module]:
    bundle = load_bundle(described(weights_folder(weights)), with_metric=False)
    tokenizer = bundle.tokenizer
    return {
        "tokenizer": tokenizer,
        "decoder": tokenizer.decoder,
        "refiner": bundle.refiner,
        "transformer": bundle.transformer,
    }


def _figures(run: MSCoTRun, parts: Mapping[str, nn.Module], train: ClipSet, test: ClipSet) -> dict[str, Any]:
    tokenizer, transformer = parts["tokenizer"], parts["transformer"]
    assert isinstance(tokenizer, Tokenizer) and isinstance(transformer, ScaleTransformer)
    return {
        "reconstruction": {str(n): error_by_source(round_trip(tokenizer), test, n) for n in FRAMES},
        **measure_tokenizer(tokenizer, train, test),
        "cross_entropy_by_scale": cross_entropy_by_scale(transformer, tokenizer, run.encoder("cpu"), test),
    }


def _report(figures: Figures) -> list[str]:
    return [
        *source_table(figures["reconstruction"]),
        "",
        f"By joint, 64 frames, {figures['clips']} clips:",
        "",
        *joint_table(figures["error_by_joint"]),
        "",
        "By frequency: root mean square of joints relative to the pelvis, about their mean over the clip:",
        "",
        *band_table(figures["error_by_band"]),
        "",
        "Scale by scale, 64 frames (perplexity: of the codes used; cross-entropy: of the transformer, nats a token):",
        "",
        *_scale_table(figures["code_use"], figures["cross_entropy_by_scale"]),
        "",
        "Movement kept by the scales up to each (root mean square over the real one, joints relative to the pelvis):",
        "",
        *_kept_table(figures["kept_by_scales"]),
    ]


def _scale_table(use: Mapping[str, Sequence[Mapping[str, float]]], entropy: Sequence[float]) -> list[str]:
    rows = []
    for k, parts in enumerate(zip(use["train"], use["test"], strict=True)):
        figures = [text for part in parts for text in (f"{part['share_used']:.0%}", f"{part['perplexity']:.0f}")]
        rows.append((f"{k + 1}", *figures, f"{entropy[k]:.2f}" if entropy else "-"))
    codes = ("codes used, training", "perplexity", "codes used, test", "perplexity")
    return table(("scale", *codes, "cross-entropy"), rows)


def _kept_table(kept: Sequence[Mapping[str, float | None]]) -> list[str]:
    rows = [
        (f"{k}", *("-" if share is None else f"{share:.0%}" for share in bands.values()))
        for k, bands in enumerate(kept, start=1)
    ]
    return table(("scales", *kept[0]), rows)


def _columns(run: MSCoTRun) -> dict[str, float]:
    """Errors and code use over the first 64 frames of the test clips."""
    test, tokenizer = run.clips(["test"], False), tokenizer_of(run)
    errors = error_by_source(round_trip(tokenizer), test, 64)
    use = code_use(tokenizer, beginnings(test, 64))
    found = {f"error_{name}_m": errors[name]["global_error_m"] for name in ("bandai", "other", "all") if name in errors}
    return {
        **found,
        "local_error_m": errors["all"]["local_error_m"],
        "root_drift_m": errors["all"]["root_drift_m"],
        "codes_used": least_use(use),
        "perplexity": least_use(use, "perplexity"),
    }


def _shortened(recipe: MSCoTRecipe, iterations: int) -> dict[str, Any]:
    """No decoder of its own, for what is compared stops short of it; codes still quantise for most of the time."""
    return {"decoder": None, "tokenizer.continuous": min(recipe.tokenizer.continuous, iterations // 4)}


TRAINING = Training(
    recipe=MSCoTRecipe,
    stages=(
        Stage("tokenizer", lambda model: Tokenizer(model.tokenizer), _tokenizer, report=_restarts),
        Stage("decoder", lambda model: Decoder(model.tokenizer), _decoder, needs=("tokenizer",)),
        Stage("refiner", lambda model: build(model)[2], _refiner, needs=("tokenizer", "decoder")),
        Stage("transformer", lambda model: build(model)[1], _transformer, needs=("tokenizer",), reads_text=True),
    ),
    parts={
        "tokenizer": tokenizer_of,
        "transformer": lambda run: run.finished("transformer").averaged,
        "refiner": lambda run: run.finished("refiner").averaged,
    },
    manifest=manifest_of("mscot"),
    measure=_figures,
    report=_report,
    measured={"metric": _preconditioner},
    exported=_exported,
    text=("model.text", "model.transformer.text_dim"),
    comparison=Comparison("tokenizer", _columns, _shortened),
)
