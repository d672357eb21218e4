"""Products with a decoder's Jacobian, as convolution passes with saved masks.

A decoder of convolutions, ReLUs and upsampling is piecewise linear: where its units are on or off is all that a
linearisation has to remember. One forward pass saves that; any number of tangents and cotangents then go through at
the price of their convolutions, all in one batch, without autograd's record, and in whatever precision they come.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import reduce

import torch
import torch.nn.functional as F
from jaxtyping import Float
from torch import Tensor, nn

from scenectl.networks.layers import ResidualBlock

Pass = Callable[[Tensor], Tensor]


@dataclass(frozen=True)
class _Link:
    """One linear map of the chain, and its adjoint, on tensors ``[R, S, C, T]``."""

    forward: Pass
    adjoint: Pass


class LinearisedDecoder:
    """A decoder at one latent.

    Attributes:
        output: what the decoder makes of it, ``[S, C, T]``.
    """

    @torch.no_grad()
    def __init__(self, decoder: nn.Sequential, latent: Float[Tensor, "S d L"], channels: int | None = None) -> None:
        """Decode once and remember which units were on.

        Args:
            decoder: any chain of `Conv1d`, `ReLU`, nearest `Upsample` and `ResidualBlock`.
            latent: where to linearise.
            channels: only so many of the output's first channels are of interest, by default all.

        Raises:
            TypeError: the decoder holds a module of another kind.
        """
        *before, last = decoder
        assert isinstance(last, nn.Conv1d)
        x, self._links = _chain(before, latent)
        x, link = _convolution(last, x, channels)
        self.output = x
        self._links.append(link)

    @torch.no_grad()
    def jvp(self, tangent: Float[Tensor, "R S d L"]) -> Float[Tensor, "R S C T"]:
        """First-order changes of the output for R changes of the latent."""
        return _forward(self._links, tangent)

    @torch.no_grad()
    def vjp(self, cotangent: Float[Tensor, "R S C T"]) -> Float[Tensor, "R S d L"]:
        """Gradients in the latent for R gradients in the output."""
        return _adjoint(self._links, cotangent)


def _forward(links: list[_Link], tangent: Tensor) -> Tensor:
    return reduce(lambda t, link: link.forward(t), links, tangent)


def _adjoint(links: list[_Link], cotangent: Tensor) -> Tensor:
    return reduce(lambda y, link: link.adjoint(y), reversed(links), cotangent)


def _chain(modules: list[nn.Module], x: Tensor) -> tuple[Tensor, list[_Link]]:
    links: list[_Link] = []
    for module in modules:
        if isinstance(module, nn.Conv1d):
            x, link = _convolution(module, x)
        elif isinstance(module, nn.ReLU):
            x, link = _rectifier(x)
        elif isinstance(module, nn.Upsample):
            x, link = _upsampling(module, x)
        elif isinstance(module, ResidualBlock):
            x, link = _residual(module, x)
        elif isinstance(module, nn.Sequential):
            x, inner = _chain(list(module), x)
            links += inner
            continue
        else:
            raise TypeError(f"a {type(module).__name__} cannot be linearised; give it a link in {__name__}")
        links.append(link)
    return x, links


def _convolution(conv: nn.Conv1d, x: Tensor, channels: int | None = None) -> tuple[Tensor, _Link]:
    weight, bias = conv.weight[:channels], None if conv.bias is None else conv.bias[:channels]
    (dilation,), reach = conv.dilation, int(conv.padding[0])
    mode = "replicate" if conv.padding_mode == "replicate" else "constant"

    def apply(x: Tensor, bias: Tensor | None) -> Tensor:
        padded = F.pad(x, (reach, reach), mode=mode) if reach else x
        return F.conv1d(padded, weight.to(x), bias, dilation=dilation)

    def adjoint(y: Tensor) -> Tensor:
        wide = F.conv_transpose1d(y.flatten(0, 1), weight.to(y), dilation=dilation)
        if reach:
            inner = wide[..., reach:-reach].clone()
            if mode == "replicate":  # what lies beyond an end is the end's own
                inner[..., 0] += wide[..., :reach].sum(-1)
                inner[..., -1] += wide[..., -reach:].sum(-1)
            wide = inner
        return wide.unflatten(0, y.shape[:2])

    link = _Link(lambda t: apply(t.flatten(0, 1), None).unflatten(0, t.shape[:2]), adjoint)
    return apply(x, bias), link


def _rectifier(x: Tensor) -> tuple[Tensor, _Link]:
    on = (x > 0).to(x)
    return x * on, _Link(lambda t: t * on.to(t), lambda t: t * on.to(t))


def _upsampling(module: nn.Upsample, x: Tensor) -> tuple[Tensor, _Link]:
    (times,) = {int(factor) for factor in torch.tensor([module.scale_factor]).flatten().tolist()}

    def up(x: Tensor) -> Tensor:
        return x.repeat_interleave(times, dim=-1)

    return up(x), _Link(up, lambda y: y.unflatten(-1, (-1, times)).sum(-1))


def _residual(block: ResidualBlock, x: Tensor) -> tuple[Tensor, _Link]:
    h, links = _chain([nn.ReLU(), block.wide, nn.ReLU(), block.point], x)
    return x + h, _Link(lambda t: t + _forward(links, t), lambda y: y + _adjoint(links, y))
