"""Our own evaluator: motions and captions drawn together where they belong together (as TMR, Petrovich et al. 2023)."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated

import torch
import torch.nn.functional as F
from jaxtyping import Float
from pydantic import BaseModel, ConfigDict, Field
from torch import Tensor, nn

from scenectl.evaluation import SHIPPED
from scenectl.evaluation.motions import EncoderConfig, MotionEncoder, Padded
from scenectl.networks.checkpoint import load_network
from scenectl.networks.text import TextEncoder, load_text_encoder

FILE = "contrastive.safetensors"
ALIKE = 0.9
"""Cosine between two captions from which on their motions do not count as wrong for one another."""


class ContrastiveConfig(BaseModel):
    """The motion encoder, the text encoder's name and width, and the width between text and embedding."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    motion: EncoderConfig = EncoderConfig()
    text: str = "minilm"
    text_dim: Annotated[int, Field(ge=1, le=2**14)] = 384
    hidden: Annotated[int, Field(ge=1, le=2**14)] = 256


class Contrastive(nn.Module):
    """A motion encoder and a small network on frozen sentence features; both give vectors of length 1."""

    def __init__(self, config: ContrastiveConfig) -> None:
        super().__init__()
        self.config = config
        self.motion = MotionEncoder(config.motion)
        self.text = nn.Sequential(
            nn.Linear(config.text_dim, config.hidden),
            nn.GELU(),
            nn.Dropout(config.motion.dropout),
            nn.Linear(config.hidden, config.motion.out),
        )
        self.temperature = nn.Parameter(torch.tensor(math.log(0.1)))

    def embed_motions(self, batch: Padded) -> Float[Tensor, "B d"]:
        return F.normalize(self.motion(batch), dim=-1)

    def embed_sentences(self, sentences: Float[Tensor, "B D"]) -> Float[Tensor, "B d"]:
        return F.normalize(self.text(sentences), dim=-1)

    def loss(self, batch: Padded, sentences: Float[Tensor, "B D"]) -> Float[Tensor, ""]:
        """Symmetric InfoNCE over a batch; captions that say nearly the same are not held against one another."""
        similarity = self.embed_motions(batch) @ self.embed_sentences(sentences).T / self.temperature.exp()
        unit = F.normalize(sentences, dim=-1)
        alike = (unit @ unit.T > ALIKE).fill_diagonal_(False)
        similarity = similarity.masked_fill(alike, -torch.inf)
        own = torch.arange(len(similarity))
        return (F.cross_entropy(similarity, own) + F.cross_entropy(similarity.T, own)) / 2


class ContrastiveEvaluator:
    """The trained network and its text encoder as an `Evaluator`."""

    name = "own contrastive evaluator"

    def __init__(self, model: Contrastive, text: TextEncoder) -> None:
        self.model, self.text = model.eval().requires_grad_(False), text

    def embed_motions(self, motions: Sequence[Float[Tensor, "_T 263"]]) -> Float[Tensor, "N d"]:
        """Unit vectors, one a motion of at least four frames; longer ones are cut at 196."""
        parts = [self.model.embed_motions(Padded.of(motions[i : i + 64])) for i in range(0, len(motions), 64)]
        return torch.cat(parts)

    def embed_texts(self, captions: Sequence[str]) -> Float[Tensor, "N d"]:
        """Unit vectors, one a caption."""
        unique = sorted(set(captions))
        parts = [self.text.encode(unique[i : i + 64]).sentence for i in range(0, len(unique), 64)]
        place = {caption: i for i, caption in enumerate(unique)}
        return self.model.embed_sentences(torch.cat(parts))[[place[caption] for caption in captions]]


def load_contrastive(folder: str | Path = SHIPPED) -> ContrastiveEvaluator:
    """Our evaluator from a folder; the one that ships by default.

    Raises:
        UserError: weights are missing, damaged, or of another network.
    """
    path = Path(folder) / FILE
    model = load_network(path, lambda config: Contrastive(ContrastiveConfig.model_validate(config)), "evaluator")
    return ContrastiveEvaluator(model, load_text_encoder(model.config.text))
