"""Layers that the networks of several families are made of."""

from __future__ import annotations

import math
from typing import Literal

import torch
import torch.nn.functional as F
from jaxtyping import Float
from torch import Tensor, nn

Padding = Literal["zeros", "replicate"]
"""What a convolution sees beyond the ends of a motion."""


class ResidualBlock(nn.Module):
    """Dilated convolution and a pointwise one around a shortcut, as in T2M-GPT."""

    def __init__(self, width: int, dilation: int, padding: Padding = "zeros") -> None:
        super().__init__()
        self.wide = nn.Conv1d(width, width, 3, padding=dilation, dilation=dilation, padding_mode=padding)
        self.point = nn.Conv1d(width, width, 1)

    def forward(self, x: Float[Tensor, "B C T"]) -> Float[Tensor, "B C T"]:
        h: Tensor = self.point(F.relu(self.wide(F.relu(x))))
        return x + h


def sinusoids(at: Float[Tensor, " N"], width: int) -> Float[Tensor, "N C"]:
    """Sines and cosines of a position, wavelengths from about 6 to 1,000 tokens."""
    rate = torch.exp(torch.arange(width // 2, device=at.device) * (-math.log(160.0) / (width // 2 - 1)))
    angle = at[:, None] * rate
    return torch.cat([angle.sin(), angle.cos()], dim=-1)


class Dropout(nn.Module):
    """Zeroes a share of all numbers in training and scales up the rest; the share is rounded to a 256th.

    A random byte decides for each: on a CPU torch's own takes three times as long, a tenth of a transformer's step.
    """

    def __init__(self, share: float) -> None:
        super().__init__()
        self.gone = round(256 * share)

    def forward(self, x: Float[Tensor, "*b"]) -> Float[Tensor, "*b"]:
        if not self.training or not self.gone:
            return x
        eights = torch.empty(-(-x.numel() // 8), dtype=torch.long, device=x.device).random_(-(2**63), None)
        kept = eights.view(torch.uint8)[: x.numel()].view_as(x) >= self.gone
        return x * (kept.to(x.dtype) * (256 / (256 - self.gone)))
