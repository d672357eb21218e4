"""What `scenectl train` does: stages in order, each in its own folder, then weights and a model card."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Literal

import torch
from torch import nn

from scenectl.generators.mscot.bundle import METRIC, PARTS, build, load_bundle
from scenectl.generators.mscot.networks.tokenizer import Tokenizer
from scenectl.generators.mscot.training.decoder import train_decoder
from scenectl.generators.mscot.training.measures import measure_tokenizer
from scenectl.generators.mscot.training.metric import measure_metric
from scenectl.generators.mscot.training.refiner import train_refiner
from scenectl.generators.mscot.training.tokenizer import reconstruction_error, train_tokenizer
from scenectl.generators.mscot.training.transformer import cross_entropy_by_scale, train_transformer
from scenectl.networks.checkpoint import save_weights
from scenectl.networks.text import TextEncoder, load_text_encoder
from scenectl.training.card import write_card
from scenectl.training.dataset import Windows, census
from scenectl.training.loop import Loop, LoopSettings
from scenectl.training.placement import Placement, place
from scenectl.training.recipe import Recipe, load_recipe
from scenectl.training.sources import is_humanml3d, windows
from scenes.errors import UserError

Stage = Literal["all", "tokenizer", "decoder", "refiner", "transformer", "export", "metric"]
STAGES: tuple[Stage, ...] = ("tokenizer", "decoder", "refiner", "transformer", "export")


def train(
    stage: Stage,
    data: str | Path,
    config: str | Path = "compact",
    out: str | Path = "runs/compact",
    iterations: int | None = None,
    text: str | None = None,
    threads: int | None = None,
    device: str = "auto",
) -> Path:
    """Train one stage, or all of them, and export weights.

    A stage goes on where it was killed. Stages need the ones before them in `out`.

    Args:
        stage: "tokenizer", "decoder" (where the recipe has one), "refiner", "transformer", "export" (weights, their
            metric and model card), or "all"; "metric" measures the metric of exported weights anew.
        data: folder of the motion collection, or of HumanML3D.
        config: name of a bundled recipe, or a TOML file.
        out: folder of the run; a stage's state lies in a folder of its own inside.
        iterations: instead of the recipe's, for a single stage.
        text: text encoder instead of the recipe's (a folder with CLIP, say); the transformer takes its width.
        threads: CPU threads; torch's choice by default.
        device: "cpu", "cuda", or "auto"; a run may go on elsewhere than where it began.

    Returns:
        The folder of the run, whose `weights/` holds what `load_generator` reads.
    """
    recipe, out = load_recipe(config), Path(out)
    if stage == "all" and iterations is not None:
        raise UserError("iterations can be given for a single stage only; name it instead of 'all'")
    if threads is not None:
        torch.set_num_threads(threads)
    run = Run(recipe, Path(data), out, iterations, text, place(device, recipe.precision))
    is_humanml3d(Path(data))  # a wrong folder or encoder is found now rather than after hours
    if stage in ("all", "transformer"):
        run.encoder()
    for each in STAGES if stage == "all" else (stage,):
        getattr(run, str(each))()
    return out


class Run:
    """One recipe on one data folder; stages are its methods.

    Attributes:
        recipe: with the text encoder that is really used.
        out: folder of the run.
    """

    def __init__(
        self,
        recipe: Recipe,
        data: Path,
        out: Path,
        iterations: int | None = None,
        text: str | None = None,
        where: Placement | None = None,
        cache: Path | None = None,
    ) -> None:
        """Set up a run; nothing is trained yet.

        Args:
            recipe: networks, data and settings.
            data: folder of the motions.
            out: folder of the run.
            iterations: instead of the recipe's, for every stage.
            text: text encoder instead of the recipe's.
            where: device and precision; the CPU in float32 by default.
            cache: folder of prepared data, which runs can share; one inside `out` by default.
        """
        self.where, self.cache = where or Placement(), cache or out / "data"
        self.data_folder, self.out, self.iterations = data, out, iterations
        self.recipe, self.text_name = recipe, text or recipe.model.text
        if text is not None:
            width = load_text_encoder(text).dim
            self.recipe = recipe.varied({"model.text": text, "model.transformer.text_dim": width})

    def windows(self, splits: Sequence[str], augmented: bool) -> Windows:
        """Clips of some splits, with the recipe's augmentation or as they were recorded."""
        recipe = self.recipe
        augmentation = recipe.augmentation if augmented else None
        return windows(self.data_folder, splits, augmentation, self.cache, recipe.seed, recipe.commercial_only)

    def encoder(self) -> TextEncoder:
        """The text encoder, on the run's device; raises UserError where its width is not the transformer's."""
        encoder = load_text_encoder(self.text_name, self.where.device.type)
        wanted = self.recipe.model.transformer.text_dim
        if encoder.dim != wanted:
            raise UserError(
                f"text encoder '{self.text_name}' gives features of {encoder.dim} numbers, and text_dim in the "
                f"training config is {wanted}; set it to {encoder.dim}"
            )
        return encoder

    def tokenizer(self) -> Loop:
        """Train the VQ-VAE."""
        recipe = self.recipe
        settings = recipe.tokenizer.model_copy(update={"loop": self._loop(recipe.tokenizer.loop)})
        data, folder = self.windows(["train"], True), self.out / "tokenizer"
        return train_tokenizer(recipe.model.tokenizer, settings, data, folder, recipe.seed, self.where)

    def decoder(self) -> None:
        """Train the decoder on, with the finished tokenizer's codes, where the recipe says so."""
        recipe = self.recipe
        if recipe.decoder is None:
            return
        settings = recipe.decoder.model_copy(update={"loop": self._loop(recipe.decoder.loop)})
        data, folder, tokenizer = self.windows(["train"], True), self.out / "decoder", self._tokenizer()
        train_decoder(tokenizer, settings, data, folder, recipe.seed, self.where)

    def refiner(self) -> None:
        """Train the token refiner on the finished tokenizer."""
        recipe = self.recipe
        settings = recipe.refiner.model_copy(update={"loop": self._loop(recipe.refiner.loop)})
        data, folder, tokenizer = self.windows(["train"], True), self.out / "refiner", self.trained_tokenizer()
        train_refiner(recipe.model.refiner, tokenizer, settings, data, folder, recipe.seed, self.where)

    def transformer(self) -> None:
        """Train the scale-wise transformer on the finished tokenizer."""
        recipe = self.recipe
        settings = recipe.transformer.model_copy(update={"loop": self._loop(recipe.transformer.loop)})
        data = self.windows(["train"], True)
        tokenizer, folder = self._tokenizer(), self.out / "transformer"  # tokens, in which the decoder has no part
        model, encoder = recipe.model.transformer, self.encoder()
        train_transformer(model, tokenizer, encoder, settings, data, folder, recipe.seed, self.where)

    def _loop(self, settings: LoopSettings) -> LoopSettings:
        return settings if self.iterations is None else settings.model_copy(update={"iterations": self.iterations})

    def trained_tokenizer(self) -> Tokenizer:
        """The finished tokenizer with its finished decoder, which the other stages build on."""
        tokenizer = self._tokenizer()
        if self.recipe.decoder is not None:
            self._read("decoder", tokenizer.decoder)
        return tokenizer

    def _tokenizer(self) -> Tokenizer:
        tokenizer, _, _ = build(self.recipe.model)
        self._read("tokenizer", tokenizer)
        return tokenizer

    def _read(self, part: str, module: nn.Module) -> Loop:
        folder = self.out / part
        if not (folder / "state.safetensors").is_file():
            raise UserError(f"'{folder}' holds no trained {part}; train that stage first")
        settings: LoopSettings = getattr(self.recipe, part).loop
        loop = Loop(module, settings, folder, self.recipe.seed)
        module.load_state_dict(loop.averaged.state_dict())
        module.eval()
        return loop

    def export(self) -> None:
        """Write the averaged weights in half precision, and the model card."""
        networks = build(self.recipe.model)
        tokenizer, transformer, refiner = networks
        stages = {"tokenizer": tokenizer, "transformer": transformer, "refiner": refiner}
        if self.recipe.decoder is not None:  # after the tokenizer, whose decoder it replaces
            stages["decoder"] = tokenizer.decoder
        loops = {stage: self._read(stage, module) for stage, module in stages.items()}
        data, test = self.windows(["train"], True), self.windows(["test"], False)
        licence, credits = data.terms()
        about = {"config": self.recipe.model.model_dump(mode="json"), "licence": licence, "credits": credits}
        folder = self.out / "weights"
        for part, module in zip(PARTS, networks, strict=True):
            save_weights(module, folder / f"{part}.safetensors", {**about, "part": part}, half=True)
        encoder = load_text_encoder(self.text_name)
        metrics = {
            "reconstruction": {str(n): reconstruction_error(tokenizer, test, n) for n in (64, 128, 196)},
            **measure_tokenizer(tokenizer, data, test),
            "cross_entropy_by_scale": cross_entropy_by_scale(transformer, tokenizer, encoder, test),
        }
        frames = {"source": census(data, data.sources), "kind": census(data, data.groups)}
        self.metric()
        hours = (data.recorded_hours, data.hours)
        write_card(folder, self.recipe, loops, frames, hours, (licence, credits), metrics)

    def metric(self) -> None:
        """Measure in what coordinates refinement of the exported weights searches best, and write that beside them."""
        folder = self.out / "weights"
        bundle = load_bundle(folder, with_metric=False)
        metric = measure_metric(bundle.tokenizer, bundle.refiner, self.windows(["train"], True), self.recipe.seed)
        about = {**bundle.about["tokenizer"], "part": "metric"}
        save_weights(metric, folder / METRIC, about, half=True)
