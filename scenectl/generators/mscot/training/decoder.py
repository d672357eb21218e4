"""Training of the decoder alone, once the codes stand still."""

from __future__ import annotations

from pathlib import Path

import torch
from pydantic import BaseModel, ConfigDict
from torch import Tensor

from scenectl.generators.mscot.networks.tokenizer import Tokenizer
from scenectl.generators.mscot.schedule import DOWNSAMPLING
from scenectl.training.dataset import Windows
from scenectl.training.loop import FRAMES, Figures, Loop, LoopSettings
from scenectl.training.losses import ReconstructionWeights, reconstruction_loss
from scenectl.training.placement import Placement


class DecoderTraining(BaseModel):
    """Settings of the decoder's own training.

    Attributes:
        loop: length and speed.
        frames: window lengths, one drawn for each batch.
        reconstruction: weights of the reconstruction terms; without an encoder to steer, feet may weigh more.
    """

    model_config = ConfigDict(extra="forbid", frozen=True)

    loop: LoopSettings
    frames: tuple[int, ...] = (64,)
    reconstruction: ReconstructionWeights = ReconstructionWeights()


def train_decoder(
    tokenizer: Tokenizer,
    settings: DecoderTraining,
    data: Windows,
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
        choice = int(torch.randint(len(settings.frames), (), generator=generator))
        frames = settings.frames[choice]
        batch = max(1, settings.loop.batch * settings.frames[0] // frames)
        features = data.draw(frames, batch, generator)[0]
        quantiser = tokenizer.quantiser
        with torch.no_grad():
            codes = [quantiser.lookup(k, t) for k, t in enumerate(tokenizer.encode(features))]
            latent = quantiser.latent(codes, frames // DOWNSAMPLING)
        with place.autocast():
            got = tokenizer.decode_latent(latent)
        loss, error = reconstruction_loss(got.float(), features, tokenizer.std, settings.reconstruction)
        return loss, {"error_m": error, FRAMES: float(batch * frames)}

    loop.run(step)
    return loop
