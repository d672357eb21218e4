"""Training of the decoder alone, once the codes stand still."""

from __future__ import annotations

from pathlib import Path

import torch
from torch import Tensor

from scenectl.data.clips import ClipSet
from scenectl.generators.mscot.networks.tokenizer import Tokenizer
from scenectl.training.loop import FRAMES, Figures, Loop
from scenectl.training.losses import ReconstructionTraining, reconstruction_loss
from scenectl.training.placement import Placement


def train_decoder(
    tokenizer: Tokenizer,
    settings: ReconstructionTraining,
    data: ClipSet,
    folder: Path,
    seed: int,
    place: Placement | None = None,
) -> Loop:
    """Train the decoder of a finished tokenizer, or go on, in `folder`; encoder and codes stay as they are.

    Tokens do not change by it, so that the transformer may be trained at the same time.
    """
    place = place or Placement()
    data = data.on(place.device)
    tokenizer.to(place.device).eval().requires_grad_(False)
    tokenizer.decoder.requires_grad_(True)
    loop = Loop(tokenizer.decoder, settings.loop, folder, seed, place)

    def step(iteration: int, generator: torch.Generator) -> tuple[Tensor, Figures]:
        features = data.draw_any(settings.frames, settings.loop.batch, generator)
        with torch.no_grad():
            tokens = tokenizer.encode(features)
            codes = [tokenizer.quantiser.lookup(k, t) for k, t in enumerate(tokens)]
            latent = tokenizer.quantiser.latent(codes, tokens[-1].shape[-1])
        with place.autocast():
            got = tokenizer.decode_latent(latent)
        loss, error = reconstruction_loss(got.float(), features, tokenizer.std, settings.reconstruction)
        return loss, {"error_m": error, FRAMES: float(features.shape[:2].numel())}

    loop.run(step)
    return loop
