"""Products with a decoder's Jacobian, as convolution passes with saved masks.

A decoder of convolutions, ReLUs and upsampling is piecewise linear: where its units are on or off is all that a
linearisation has to remember. One forward pass saves that; any number of tangents and cotangents then go through at
the price of their convolutions, all in one batch, without autograd's record, and in whatever precision they come.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import reduce

import torch
import torch.nn.functional as F
from jaxtyping import Float
from torch import Tensor, nn

from scenectl.networks.layers import Frames, ResidualBlock, Shortcut, folded, unfolded

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
    def __init__(self, decoder: nn.Module, latent: Float[Tensor, "S d L"], channels: int | None = None) -> None:
        """Decode once and remember which units were on.

        Args:
            decoder: any chain of `Conv1d`, `ReLU`, nearest `Upsample`, `ResidualBlock`, `Frames` and `Shortcut`.
            latent: where to linearise.
            channels: only so many of the output's first channels are of interest, by default all.

        Raises:
            TypeError: the decoder holds a module of another kind.
        """
        self.output, self._links = _chain([decoder], latent, channels)

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


def _chain(modules: Sequence[nn.Module], x: Tensor, channels: int | None = None) -> tuple[Tensor, list[_Link]]:
    """The output of modules one after the other, of the last one so many channels, and their links."""
    links: list[_Link] = []
    for i, module in enumerate(modules):
        last = channels if i + 1 == len(modules) else None
        if isinstance(module, nn.Conv1d):
            x, link = _convolution(module, x, last)
        elif isinstance(module, Frames):
            x, link = _frames(module, x, last)
        elif isinstance(module, Shortcut) and module.linear is not None:
            x, link = _sum([_chain([branch], x, last) for branch in (module.net, module.linear)])
        elif isinstance(module, nn.Sequential | Shortcut):
            x, inner = _chain(list(module if isinstance(module, nn.Sequential) else module.net), x, last)
            links += inner
            continue
        elif last is not None:
            raise TypeError(f"channels of a {type(module).__name__} cannot be left out; end the decoder otherwise")
        elif isinstance(module, nn.ReLU):
            x, link = _rectifier(x)
        elif isinstance(module, nn.Upsample):
            x, link = _upsampling(module, x)
        elif isinstance(module, ResidualBlock):
            x, link = _residual(module, x)
        else:
            raise TypeError(f"a {type(module).__name__} cannot be linearised; give it a link in {__name__}")
        links.append(link)
    return x, links


def _sum(branches: list[tuple[Tensor, list[_Link]]]) -> tuple[Tensor, _Link]:
    outputs, chains = zip(*branches, strict=True)
    link = _Link(
        lambda t: sum((_forward(links, t) for links in chains[1:]), _forward(chains[0], t)),
        lambda y: sum((_adjoint(links, y) for links in chains[1:]), _adjoint(chains[0], y)),
    )
    return torch.stack(outputs).sum(0), link


def _frames(module: Frames, x: Tensor, channels: int | None) -> tuple[Tensor, _Link]:
    count, conv = module.frames, module.linear
    weight = conv.weight[..., 0].unflatten(0, (count, -1))[:, :channels].flatten(0, 1)
    bias = None if conv.bias is None else conv.bias.unflatten(0, (count, -1))[:, :channels].flatten()
    out = unfolded(F.conv1d(x, weight[..., None].to(x), bias), count)
    return out, _Link(lambda t: unfolded(weight.to(t) @ t, count), lambda y: weight.T.to(y) @ folded(y, count))


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
