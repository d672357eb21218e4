"""Training of the token refiner on the frozen tokenizer, by reconstruction alone (section 3.2)."""

from __future__ import annotations

import torch
from torch import Tensor

from scenectl.generators.mscot.config import RefinerConfig
from scenectl.generators.mscot.networks.refiner import Refiner
from scenectl.generators.mscot.networks.tokenizer import Tokenizer
from scenectl.training.loop import FRAMES, Figures, Loop
from scenectl.training.losses import ReconstructionTraining, reconstruction_loss
from scenectl.training.stages import Job


def train_refiner(config: RefinerConfig, tokenizer: Tokenizer, settings: ReconstructionTraining, job: Job) -> Loop:
    """Train, or go on training; the tokens are those of float32."""
    tokenizer.to(job.place.device).eval().requires_grad_(False)
    torch.manual_seed(job.seed)  # initial weights belong to the run's seed
    model = Refiner(config, tokenizer.config.code_dim, tokenizer.quantiser.scales)
    loop = job.loop(model, settings.loop)

    def step(iteration: int, generator: torch.Generator) -> tuple[Tensor, Figures]:
        features = job.data.draw_any(settings.frames, settings.loop.batch, generator)
        with torch.no_grad():
            tokens = tokenizer.encode(features)
        finest = tokens[-1].shape[-1]
        codes = [tokenizer.quantiser.lookup(k, t) for k, t in enumerate(tokens)]
        with job.place.autocast():
            refined = [e + model(e, k, finest) for k, e in enumerate(codes)]
            got = tokenizer.decode_latent(tokenizer.quantiser.latent(refined, finest))
        loss, error = reconstruction_loss(got.float(), features, tokenizer.std, settings.reconstruction)
        return loss, {"error_m": error, FRAMES: float(features.shape[:2].numel())}

    loop.run(step)
    return loop
