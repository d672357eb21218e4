"""Training by reconstruction alone, once the codes stand still: of the decoder, and of the refiner (section 3.2)."""

from __future__ import annotations

from collections.abc import Callable

import torch
from jaxtyping import Float
from torch import Tensor, nn

from scenectl.generators.mscot.config import RefinerConfig
from scenectl.generators.mscot.networks.refiner import Refiner
from scenectl.generators.mscot.networks.tokenizer import Tokenizer
from scenectl.generators.mscot.training.mistakes import Reader
from scenectl.training.loop import FRAMES, Figures, Loop
from scenectl.training.losses import ReconstructionTraining, reconstruction_loss
from scenectl.training.stages import Job

_Decoded = Callable[[list[Float[Tensor, "B _L d"]], int], Float[Tensor, "B T 263"]]
"""Raw features of the codes of all scales and the length of the finest."""


def train_decoder(tokenizer: Tokenizer, settings: ReconstructionTraining, job: Job) -> Loop:
    """Train the decoder of a finished tokenizer, or go on; encoder and codes stay as they are.

    Tokens do not change by it, so that the transformer may be trained at the same time.
    """

    def decoded(codes: list[Float[Tensor, "B _L d"]], finest: int) -> Float[Tensor, "B T 263"]:
        latent = tokenizer.quantiser.latent(codes, finest)
        with job.place.autocast():
            return tokenizer.decode_latent(latent)

    return _train(tokenizer.decoder, tokenizer, decoded, settings, job)


def train_refiner(config: RefinerConfig, tokenizer: Tokenizer, settings: ReconstructionTraining, job: Job) -> Loop:
    """Train, or go on training; the tokens are those of float32."""
    torch.manual_seed(job.seed)  # initial weights belong to the run's seed
    model = Refiner(config, tokenizer.config.code_dim, tokenizer.quantiser.scales)

    def decoded(codes: list[Float[Tensor, "B _L d"]], finest: int) -> Float[Tensor, "B T 263"]:
        with job.place.autocast():
            refined = [e + model(e, k, finest) for k, e in enumerate(codes)]
            return tokenizer.decode_latent(tokenizer.quantiser.latent(refined, finest))

    return _train(model, tokenizer, decoded, settings, job)


def _train(
    model: nn.Module, tokenizer: Tokenizer, decoded: _Decoded, settings: ReconstructionTraining, job: Job
) -> Loop:
    """Train a module, which may be the tokenizer's own decoder, while all else of the tokenizer stands still."""
    tokenizer.to(job.place.device).eval().requires_grad_(False)
    loop = job.loop(model.requires_grad_(True), settings.loop)
    reader = Reader(tokenizer.quantiser, settings.misread)

    def step(_: int, generator: torch.Generator) -> tuple[Tensor, Figures]:
        features = job.data.draw_any(settings.frames, settings.loop.batch, generator)
        tokens = reader(tokenizer.latent(features), generator).seen
        codes = [tokenizer.quantiser.lookup(k, t) for k, t in enumerate(tokens)]
        got = decoded(codes, tokens[-1].shape[-1]).float()
        loss, error = reconstruction_loss(got, features, tokenizer.std, settings.reconstruction)
        return loss, {"error_m": error, FRAMES: float(features.shape[:2].numel())}

    loop.run(step)
    return loop
