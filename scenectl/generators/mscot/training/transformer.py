"""Training of the scale-wise transformer on the frozen tokenizer's tokens (Eq. 39)."""

from __future__ import annotations

from typing import Annotated

import torch
import torch.nn.functional as F
from pydantic import Field
from torch import Tensor

from scenectl.data.clips import ClipSet, Drawn
from scenectl.generators.mscot.config import TransformerConfig
from scenectl.generators.mscot.networks.tokenizer import Tokenizer
from scenectl.generators.mscot.networks.transformer import ScaleTransformer
from scenectl.generators.mscot.schedule import DOWNSAMPLING
from scenectl.generators.mscot.training.mistakes import Reader
from scenectl.networks.text import TextEncoder
from scenectl.training.captions import Captions
from scenectl.training.loop import FRAMES, Figures, Loop, LoopSettings
from scenectl.training.placement import Placement
from scenectl.training.stages import Job
from scenes.tables import Table


class TransformerTraining(Table):
    """Settings of the transformer's training.

    Attributes:
        loop: length and speed; `batch` is for windows of 64 frames, and shrinks with longer ones.
        min_frames, max_frames: window lengths, drawn for each batch as clips are long, in steps of four frames.
        drop_text: probability of training a sample without text (classifier-free guidance).
        misread: largest share of a window's tokens that are read wrong (`Reader`), as its own will be later.
        smoothing: label smoothing.
    """

    loop: LoopSettings
    min_frames: int = 36
    max_frames: int = 196
    drop_text: float = 0.1
    misread: Annotated[float, Field(ge=0, le=1)] = 0.3
    smoothing: float = 0.05


def train_transformer(
    config: TransformerConfig,
    tokenizer: Tokenizer,
    encoder: TextEncoder,
    settings: TransformerTraining,
    job: Job,
) -> Loop:
    """Train, or go on training; the tokens are those of float32."""
    data, place = job.data, job.place
    tokenizer.to(place.device).eval().requires_grad_(False)
    captions = Captions(data, encoder, job.cache)
    quantiser = tokenizer.quantiser
    torch.manual_seed(job.seed)  # initial weights belong to the run's seed
    model = ScaleTransformer(config, tokenizer.config.codes, tokenizer.config.code_dim, quantiser.scales)
    loop = job.loop(model, settings.loop)
    reader = Reader(quantiser, settings.misread)

    def step(iteration: int, generator: torch.Generator) -> tuple[Tensor, Figures]:
        frames = data.draw_length(settings.min_frames, settings.max_frames, DOWNSAMPLING, generator)
        finest = frames // DOWNSAMPLING
        batch = max(4, settings.loop.batch * 16 // finest)
        windows = data.draw(frames, batch, generator)
        reading = reader(tokenizer.latent(windows.features), generator)
        drop = torch.rand(batch, generator=generator) < settings.drop_text
        prompt = place.text(captions.of_windows(windows, DOWNSAMPLING, generator))
        with place.autocast():
            logits = model(quantiser, model.without_text(prompt, drop.to(place.device)), reading.seen, finest)
        logits, target = logits.float().flatten(0, 1), torch.cat(reading.right, dim=1).flatten()
        loss = F.cross_entropy(logits, target, label_smoothing=settings.smoothing)
        figures: Figures = {
            "cross_entropy": F.cross_entropy(logits.detach(), target),
            FRAMES: float(batch * frames),
        }
        return loss, figures

    loop.run(step)
    return loop


@torch.no_grad()
def cross_entropy_by_scale(
    model: ScaleTransformer, tokenizer: Tokenizer, encoder: TextEncoder, data: ClipSet, frames: int = 64
) -> list[float]:
    """Cross-entropy (nats a token) of each scale over the first `frames` frames of every clip long enough."""
    model.eval()
    captions = Captions(data, encoder)
    quantiser, sums = tokenizer.quantiser, []
    clips = (data.lengths >= frames).nonzero()[:, 0]
    lengths = list(quantiser.lengths(frames // DOWNSAMPLING))
    for i, part in enumerate(clips.split(32)):
        rows = (data.starts[part][:, None] + torch.arange(frames)).to(data.features.device)
        windows = Drawn(data.features[rows], part, torch.zeros_like(part))
        tokens = tokenizer.encode(windows.features)
        said = captions.of_windows(windows, DOWNSAMPLING, torch.Generator().manual_seed(32 * i))
        prompt = Placement(rows.device).text(said)
        logits = model(quantiser, prompt, tokens, frames // DOWNSAMPLING)
        loss = F.cross_entropy(logits.transpose(1, 2), torch.cat(tokens, 1), reduction="none")
        sums.append(torch.stack([piece.mean(1).sum() for piece in loss.split(lengths, dim=1)]))
    return (torch.stack(sums).sum(0) / len(clips)).tolist() if len(clips) else []
