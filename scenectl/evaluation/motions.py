"""Motions of many lengths as one padded batch, and the encoder that reads such batches."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated

import torch
import torch.nn.functional as F
from jaxtyping import Bool, Float, Int
from pydantic import BaseModel, ConfigDict, Field
from torch import Tensor, nn

from scenectl.data.features import FEATURES

STRIDE = 4
"""Frames behind one step of the encoder's output; lengths are cut to multiples of it."""

SHORTEST, LONGEST = 36, 196
"""Frames of the motions that evaluations look at; longer ones are cut (HumanML3D's evaluators know up to 196)."""


@dataclass(frozen=True)
class Padded:
    """Feature rows of B clips, padded behind.

    Attributes:
        features: raw features, ``[B, T, 263]``, zero where padded; T is a multiple of `STRIDE`.
        lengths: real rows of each, multiples of `STRIDE`, ``[B]``.
    """

    features: Float[Tensor, "B T 263"]
    lengths: Int[Tensor, " B"]

    @classmethod
    def of(cls, clips: Sequence[Float[Tensor, "_T 263"]], longest: int = LONGEST) -> Padded:
        """Clips of any lengths from `STRIDE` frames on, cut to `longest` and to a multiple of `STRIDE`."""
        cut = [clip[: min(len(clip), longest) // STRIDE * STRIDE] for clip in clips]
        lengths = torch.tensor([len(clip) for clip in cut], device=cut[0].device)
        return cls(nn.utils.rnn.pad_sequence(cut, batch_first=True), lengths)

    def mask(self, step: int) -> Bool[Tensor, "B N"]:
        """True where a row at every `step`-th frame is real."""
        return torch.arange(self.features.shape[1] // step, device=self.lengths.device) < self.lengths[:, None] // step


class EncoderConfig(BaseModel):
    """Sizes of a motion encoder: channels, residual blocks at the coarse rate, numbers that it returns."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    width: Annotated[int, Field(ge=1, le=2**14)] = 192
    depth: Annotated[int, Field(ge=0, le=256)] = 3
    out: Annotated[int, Field(ge=1, le=2**14)] = 128
    dropout: Annotated[float, Field(ge=0, lt=1)] = 0.2


class MotionEncoder(nn.Module):
    """Convolutions over time, then mean and maximum over the real steps; padding changes nothing."""

    mean: Tensor
    std: Tensor

    def __init__(self, config: EncoderConfig) -> None:
        super().__init__()
        width = config.width
        self.register_buffer("mean", torch.zeros(FEATURES))
        self.register_buffer("std", torch.ones(FEATURES))
        self.first = nn.Conv1d(FEATURES, width, 4, stride=2, padding=1)
        self.second = nn.Conv1d(width, width, 4, stride=2, padding=1)
        self.blocks = nn.ModuleList(nn.Conv1d(width, width, 3, padding=1) for _ in range(config.depth))
        self.dropout = nn.Dropout(config.dropout)
        self.head = nn.Linear(2 * width, config.out)

    def forward(self, batch: Padded) -> Float[Tensor, "B d"]:
        x = ((batch.features - self.mean) / self.std) * batch.mask(1)[..., None]
        x = F.gelu(self.first(x.transpose(1, 2))) * batch.mask(2)[:, None]
        real = batch.mask(STRIDE)[:, None]
        x = F.gelu(self.second(x)) * real
        for block in self.blocks:
            x = x + self.dropout(F.gelu(block(x))) * real
        mean = x.sum(-1) / real.sum(-1)
        most = x.masked_fill(~real, -torch.inf).amax(-1)
        out: Tensor = self.head(self.dropout(torch.cat([mean, most], dim=-1)))
        return out
