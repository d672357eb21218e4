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


class Frames(nn.Module):
    """A linear map of every step to several frames of its own: ``[B, d, L]`` to ``[B, C, n L]``.

    Attributes:
        linear: to n C channels, the first frame's C first.
        frames: n.
    """

    def __init__(self, channels: int, out: int, frames: int) -> None:
        super().__init__()
        self.frames = frames
        self.linear = nn.Conv1d(channels, out * frames, 1)

    def forward(self, x: Float[Tensor, "B d L"]) -> Float[Tensor, "B C T"]:
        out: Tensor = self.linear(x)
        return unfolded(out, self.frames)


def unfolded(x: Float[Tensor, "*b N L"], frames: int) -> Float[Tensor, "*b C T"]:
    """Channels of several frames, one frame after the other, as frames."""
    return x.unflatten(-2, (frames, -1)).movedim(-3, -1).flatten(-2)


def folded(x: Float[Tensor, "*b C T"], frames: int) -> Float[Tensor, "*b N L"]:
    """Frames as channels of every so many; undoes `unfolded`."""
    return x.unflatten(-1, (-1, frames)).movedim(-1, -3).flatten(-3, -2)


class Shortcut(nn.Module):
    """A chain of layers, and beside it a linear map, if any, whose outputs add up."""

    def __init__(self, net: nn.Sequential, linear: nn.Module | None = None) -> None:
        super().__init__()
        self.net, self.linear = net, linear

    def forward(self, x: Float[Tensor, "B C T"]) -> Float[Tensor, "B c t"]:
        out: Tensor = self.net(x)
        return out if self.linear is None else out + self.linear(x)


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
