"""Training of the decoder alone, once the codes stand still."""

from __future__ import annotations

import torch
from torch import Tensor

from scenectl.generators.mscot.networks.tokenizer import Tokenizer
from scenectl.training.loop import FRAMES, Figures, Loop
from scenectl.training.losses import ReconstructionTraining, reconstruction_loss
from scenectl.training.stages import Job


def train_decoder(tokenizer: Tokenizer, settings: ReconstructionTraining, job: Job) -> Loop:
    """Train the decoder of a finished tokenizer, or go on; encoder and codes stay as they are.

    Tokens do not change by it, so that the transformer may be trained at the same time.
    """
    tokenizer.to(job.place.device).eval().requires_grad_(False)
    tokenizer.decoder.requires_grad_(True)
    loop = job.loop(tokenizer.decoder, settings.loop)

    def step(iteration: int, generator: torch.Generator) -> tuple[Tensor, Figures]:
        features = job.data.draw_any(settings.frames, settings.loop.batch, generator)
        with torch.no_grad():
            tokens = tokenizer.encode(features)
            codes = [tokenizer.quantiser.lookup(k, t) for k, t in enumerate(tokens)]
            latent = tokenizer.quantiser.latent(codes, tokens[-1].shape[-1])
        with job.place.autocast():
            got = tokenizer.decode_latent(latent)
        loss, error = reconstruction_loss(got.float(), features, tokenizer.std, settings.reconstruction)
        return loss, {"error_m": error, FRAMES: float(features.shape[:2].numel())}

    loop.run(step)
    return loop
