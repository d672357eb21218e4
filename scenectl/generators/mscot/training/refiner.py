"""Training of the token refiner on the frozen tokenizer, by reconstruction alone (section 3.2)."""

from __future__ import annotations

from pathlib import Path

import torch
from torch import Tensor

from scenectl.data.clips import ClipSet
from scenectl.generators.mscot.config import RefinerConfig
from scenectl.generators.mscot.networks.refiner import Refiner
from scenectl.generators.mscot.networks.tokenizer import Tokenizer
from scenectl.training.loop import FRAMES, Figures, Loop
from scenectl.training.losses import ReconstructionTraining, reconstruction_loss
from scenectl.training.placement import Placement


def train_refiner(
    config: RefinerConfig,
    tokenizer: Tokenizer,
    settings: ReconstructionTraining,
    data: ClipSet,
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
        features = data.draw_any(settings.frames, settings.loop.batch, generator)
        with torch.no_grad():
            tokens = tokenizer.encode(features)
        finest = tokens[-1].shape[-1]
        codes = [tokenizer.quantiser.lookup(k, t) for k, t in enumerate(tokens)]
        with place.autocast():
            refined = [e + model(e, k, finest) for k, e in enumerate(codes)]
            got = tokenizer.decode_latent(tokenizer.quantiser.latent(refined, finest))
        loss, error = reconstruction_loss(got.float(), features, tokenizer.std, settings.reconstruction)
        return loss, {"error_m": error, FRAMES: float(features.shape[:2].numel())}

    loop.run(step)
    return loop
