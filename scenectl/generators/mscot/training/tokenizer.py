"""Training of the multi-scale VQ-VAE (appendix B.2)."""

from __future__ import annotations

from pathlib import Path

import torch
from jaxtyping import Int
from pydantic import BaseModel, ConfigDict
from torch import Tensor

from scenectl.data.features import features_to_joints
from scenectl.generators.mscot.config import TokenizerConfig
from scenectl.generators.mscot.networks.tokenizer import Tokenizer
from scenectl.training.dataset import Windows
from scenectl.training.loop import FRAMES, Figures, Loop, LoopSettings
from scenectl.training.losses import ReconstructionWeights, reconstruction_loss
from scenectl.training.placement import Placement

REVIVED = "revived"
"""Name, in the loss curve, of the codes restarted on data, per step."""


class TokenizerTraining(BaseModel):
    """Settings of the tokenizer's training.

    Attributes:
        loop: length and speed.
        frames: window lengths, one drawn for each batch.
        commitment: beta of Eq. 37.
        dropout: probability that a sample's last scales are switched off (quantisation dropout).
        continuous: first iterations, which run without quantising, so that codes start from useful latents.
        decay: of the codebook's moving average.
        revive_below: uses a step under which a code restarts on data.
        reconstruction: weights of the reconstruction terms.
    """

    model_config = ConfigDict(extra="forbid", frozen=True)

    loop: LoopSettings
    frames: tuple[int, ...] = (64,)
    commitment: float = 0.02
    dropout: float = 0.2
    continuous: int = 120
    decay: float = 0.99
    revive_below: float = 0.05
    reconstruction: ReconstructionWeights = ReconstructionWeights()


def train_tokenizer(
    config: TokenizerConfig,
    settings: TokenizerTraining,
    data: Windows,
    folder: Path,
    seed: int,
    place: Placement | None = None,
) -> Loop:
    """Train, or go on training, in `folder`; returns the finished loop, whose `averaged` is the result.

    Encoder and decoder compute in the placement's precision; quantisation, joints and losses always in float32.
    """
    place = place or Placement()
    torch.manual_seed(seed)  # initial weights belong to the run's seed
    model = Tokenizer(config)
    mean, std = data.statistics()
    data = data.on(place.device)
    model.mean.copy_(mean)
    model.std.copy_(std)
    loop = Loop(model, settings.loop, folder, seed, place)

    def decoded(latent: Tensor) -> Tensor:
        with place.autocast():
            return model.decode_latent(latent).float()

    def step(iteration: int, generator: torch.Generator) -> tuple[Tensor, Figures]:
        choice = int(torch.randint(len(settings.frames), (), generator=generator))
        frames = settings.frames[choice]
        # The same number of frames a step, whatever the length of the windows.
        batch = max(1, settings.loop.batch * settings.frames[0] // frames)
        features = data.draw(frames, batch, generator)[0]
        with place.autocast():
            latent = model.latent(features)
        latent = latent.float()
        seen = {FRAMES: float(batch * frames)}
        if iteration < settings.continuous:
            loss, error = reconstruction_loss(decoded(latent), features, model.std, settings.reconstruction)
            return loss, {"error_m": error, **seen}
        if iteration == settings.continuous:
            model.quantiser.initialise(latent.detach())
        kept = _kept_scales(model, batch, settings.dropout, generator).to(place.device)
        quantised = model.quantiser(latent, kept)
        loss, error = reconstruction_loss(decoded(quantised.latent), features, model.std, settings.reconstruction)
        total = loss + quantised.codebook_loss + settings.commitment * quantised.commitment_loss
        used = torch.zeros(model.config.codes, device=place.device).index_fill_(0, quantised.tokens[-1].flatten(), 1.0)
        figures: Figures = {
            "error_m": error,
            "commitment": quantised.commitment_loss.detach(),
            "codes": used.sum(),
            **seen,
        }
        return total, figures

    def after() -> Figures:
        if loop.iteration < settings.continuous:
            return {}
        return {REVIVED: model.quantiser.update_codebook(settings.decay, settings.revive_below)}

    loop.run(step, after)
    return loop


def _kept_scales(model: Tokenizer, batch: int, dropout: float, generator: torch.Generator) -> Int[Tensor, " B"]:
    """How many scales each sample keeps: all, or with probability `dropout` a uniform number of the first ones."""
    scales = model.quantiser.scales
    short = torch.randint(1, scales, (batch,), generator=generator)
    drop = torch.rand(batch, generator=generator) < dropout
    return torch.where(drop, short, torch.full_like(short, scales))


@torch.no_grad()
def reconstruction_error(model: Tokenizer, data: Windows, frames: int) -> dict[str, dict[str, float]]:
    """Mean joint error (m) over the first `frames` frames of every clip that is long enough, by source.

    Global error is of world positions; local error of positions relative to the pelvis; drift is the
    pelvis at the last frame.
    """
    model.eval()
    rows: dict[str, list[tuple[float, float, float]]] = {}
    for i, start in enumerate(data.starts[:-1].tolist()):
        if int(data.lengths[i]) < frames:
            continue
        features = data.features[start : start + frames][None]
        got = features_to_joints(model.decode(model.encode(features)))
        true = features_to_joints(features)
        error = (got - true).norm(dim=-1)
        local = ((got - got[..., :1, :]) - (true - true[..., :1, :])).norm(dim=-1)
        row = float(error.mean()), float(local.mean()), float(error[0, -1, 0])
        for key in {data.sources[i], "all", "bandai" if data.sources[i] == "bandai" else "other"}:
            rows.setdefault(key, []).append(row)
    return {
        key: {
            "clips": float(len(values)),
            "global_error_m": sum(v[0] for v in values) / len(values),
            "local_error_m": sum(v[1] for v in values) / len(values),
            "root_drift_m": sum(v[2] for v in values) / len(values),
        }
        for key, values in sorted(rows.items())
    }
