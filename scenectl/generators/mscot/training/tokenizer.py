"""Training of the multi-scale VQ-VAE (appendix B.2)."""

from __future__ import annotations

import torch
from jaxtyping import Float, Int
from torch import Tensor

from scenectl.generators.mscot.config import TokenizerConfig
from scenectl.generators.mscot.networks.tokenizer import Quantised, Tokenizer
from scenectl.generators.mscot.training.principal import start_at_principal_components
from scenectl.training.loop import FRAMES, Figures, Loop
from scenectl.training.losses import ReconstructionTraining, reconstruction_loss
from scenectl.training.stages import Job

_SEEN = 2048
"""Windows whose principal components a shortcut starts at."""
REVIVED = "revived"
"""Name, in the loss curve, of the codes restarted on data, per step."""


class TokenizerTraining(ReconstructionTraining):
    """Settings of the tokenizer's training, over those of any training by reconstruction.

    Attributes:
        commitment: beta of Eq. 37.
        dropout: probability that a sample's last scales are switched off (quantisation dropout).
        continuous: first iterations, which run without quantising, so that codes start from useful latents.
        decay: of the codebook's moving average.
        revive_below: uses a step under which a code restarts on data.
    """

    commitment: float = 0.02
    dropout: float = 0.2
    continuous: int = 120
    decay: float = 0.99
    revive_below: float = 0.05


def train_tokenizer(config: TokenizerConfig, settings: TokenizerTraining, job: Job) -> Loop:
    """Train, or go on training; returns the finished loop, whose `averaged` is the result.

    Encoder and decoder compute in the placement's precision; quantisation, joints and losses always in float32.
    """
    place = job.place
    torch.manual_seed(job.seed)  # initial weights belong to the run's seed
    model = Tokenizer(config)
    mean, std = job.data.statistics()
    model.mean.copy_(mean)
    model.std.copy_(std)
    if config.shortcut:
        drawn = job.data.draw(settings.frames[0], _SEEN, torch.Generator().manual_seed(job.seed))
        start_at_principal_components(model, drawn.features.cpu())
    loop = job.loop(model, settings.loop)
    # Finished weights have codes.
    continuous = settings.continuous if job.start is None else 0

    def step(iteration: int, generator: torch.Generator) -> tuple[Tensor, Figures]:
        features = job.data.draw_any(settings.frames, settings.loop.batch, generator)
        with place.autocast():
            latent = model.latent(features)
        latent, quantised = latent.float(), None
        if iteration == continuous and job.start is None:
            model.quantiser.initialise(latent.detach())
        if iteration >= continuous:
            kept = _kept_scales(model, len(features), settings.dropout, generator).to(place.device)
            quantised = model.quantiser(latent, kept)
            latent = quantised.latent
        with place.autocast():
            got = model.decode_latent(latent)
        loss, error = reconstruction_loss(got.float(), features, model.std, settings.reconstruction)
        figures: Figures = {"error_m": error, FRAMES: float(features.shape[:2].numel())}
        if quantised is not None:
            loss = loss + quantised.codebook_loss + settings.commitment * quantised.commitment_loss
            figures |= {"commitment": quantised.commitment_loss.detach(), "codes": _used(model, quantised)}
        return loss, figures

    def after() -> Figures:
        if loop.iteration < continuous:
            return {}
        return {REVIVED: model.quantiser.update_codebook(settings.decay, settings.revive_below)}

    loop.run(step, after)
    return loop


def _used(model: Tokenizer, quantised: Quantised) -> Float[Tensor, ""]:
    """How many codes the finest scale used."""
    used = torch.zeros(model.config.codes, device=quantised.latent.device)
    return used.index_fill_(0, quantised.tokens[-1].flatten(), 1.0).sum()


def _kept_scales(model: Tokenizer, batch: int, dropout: float, generator: torch.Generator) -> Int[Tensor, " B"]:
    """How many scales each sample keeps: all, or with probability `dropout` a uniform number of the first ones."""
    scales = model.quantiser.scales
    short = torch.randint(1, scales, (batch,), generator=generator)
    drop = torch.rand(batch, generator=generator) < dropout
    return torch.where(drop, short, torch.full_like(short, scales))
