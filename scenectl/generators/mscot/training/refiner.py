"""Training of the token refiner on the frozen tokenizer, by reconstruction alone (section 3.2)."""

from __future__ import annotations

from pathlib import Path

import torch
from pydantic import BaseModel, ConfigDict
from torch import Tensor

from scenectl.generators.mscot.config import RefinerConfig
from scenectl.generators.mscot.networks.refiner import Refiner
from scenectl.generators.mscot.networks.tokenizer import Tokenizer
from scenectl.training.dataset import Windows
from scenectl.training.loop import FRAMES, Figures, Loop, LoopSettings
from scenectl.training.losses import ReconstructionWeights, reconstruction_loss
from scenectl.training.placement import Placement


class RefinerTraining(BaseModel):
    """Settings of the refiner's training."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    loop: LoopSettings
    frames: tuple[int, ...] = (64,)
    reconstruction: ReconstructionWeights = ReconstructionWeights()


def train_refiner(
    config: RefinerConfig,
    tokenizer: Tokenizer,
    settings: RefinerTraining,
    data: Windows,
    folder: Path,
    seed: int,
    place: Placement | None = None,
) -> Loop:
    """Train, or go on training, in `folder`; the tokens are those of float32."""
    place = place or Placement()
    data = data.on(place.device)
    tokenizer.to(place.device).eval().requires_grad_(False)
    torch.manual_seed(seed)  # initial weights belong to the run's seed
    model = Refiner(config, tokenizer.config.code_dim, tokenizer.quantiser.scales)
    loop = Loop(model, settings.loop, folder, seed, place)

    def step(iteration: int, generator: torch.Generator) -> tuple[Tensor, Figures]:
        choice = int(torch.randint(len(settings.frames), (), generator=generator))
        frames = settings.frames[choice]
        batch = max(1, settings.loop.batch * settings.frames[0] // frames)
        features = data.draw(frames, batch, generator)[0]
        with torch.no_grad():
            tokens = tokenizer.encode(features)
        finest = tokens[-1].shape[-1]
        codes = [tokenizer.quantiser.lookup(k, t) for k, t in enumerate(tokens)]
        with place.autocast():
            refined = [e + model(e, k, finest) for k, e in enumerate(codes)]
            got = tokenizer.decode_latent(tokenizer.quantiser.latent(refined, finest))
        loss, error = reconstruction_loss(got.float(), features, tokenizer.std, settings.reconstruction)
        return loss, {"error_m": error, FRAMES: float(batch * frames)}

    loop.run(step)
    return loop
