"""Tokens read with mistakes that later scales put right: what a generator's own mistakes need (self-correction)."""

from __future__ import annotations

from typing import NamedTuple

import torch
from jaxtyping import Float, Int
from torch import Tensor

from scenectl.generators.mscot.networks.tokenizer import Quantiser

NEAREST = 32
"""Codes, from the nearest on, that a token is misread as.

A shipped transformer's distributions have an entropy of about 3.5 nats (the cards' cross-entropy), as wide as this many
codes drawn evenly.
"""


class Reading(NamedTuple):
    """Tokens of every scale, ``[B, L_k]`` each.

    Attributes:
        seen: as they were read, some of them wrong.
        right: the nearest codes of what the tokens seen at coarser scales had left to say.
    """

    seen: list[Int[Tensor, "B _L_k"]]
    right: list[Int[Tensor, "B _L_k"]]


class Reader:
    """Reads latents as `Quantiser.encode` does, and makes mistakes.

    A generator draws the tokens of a scale at once, which do not quite agree. Each scale is therefore read of what the
    mistakes of the coarser ones left over, so that finer ones learn to put them right: self-correction, as Infinity
    does it with bits (arXiv:2412.04431, section 3.4).

    Args:
        quantiser: whose codes are read.
        most: of each window's tokens, up to this share are misread: how many, is drawn evenly for every window.
    """

    def __init__(self, quantiser: Quantiser, most: float) -> None:
        self.quantiser, self.most = quantiser, most
        self.near = [neighbours(quantiser.codes(k)) for k in range(quantiser.scales)] if most else []

    def __call__(self, latent: Float[Tensor, "B d L"], generator: torch.Generator) -> Reading:
        """Tokens of latents; what is random is drawn on the CPU, so that every device reads the same."""
        if not self.most:
            tokens = self.quantiser.encode(latent)
            return Reading(tokens, tokens)
        finest, rest, reading = latent.shape[-1], latent, Reading([], [])
        share = self.most * torch.rand(len(latent), 1, generator=generator)
        for k, length in enumerate(self.quantiser.lengths(finest)):
            right = self.quantiser.nearest(k, self.quantiser.down(rest, length))
            seen = _misread(right, self.near[k], share, generator)
            rest = rest - self.quantiser.up(k, self.quantiser.lookup(k, seen), finest)
            reading.seen.append(seen)
            reading.right.append(right)
        return reading


def neighbours(codes: Float[Tensor, "V d"]) -> Int[Tensor, "V n"]:
    """The codes nearest to each, without itself."""
    away = torch.cdist(codes, codes).fill_diagonal_(torch.inf)
    found: Tensor = away.topk(min(NEAREST, len(codes) - 1), largest=False).indices
    return found


def _misread(
    tokens: Int[Tensor, "B L"], near: Int[Tensor, "V n"], share: Float[Tensor, "B 1"], generator: torch.Generator
) -> Int[Tensor, "B L"]:
    pick = torch.randint(near.shape[1], tokens.shape, generator=generator).to(tokens.device)
    wrong = (torch.rand(tokens.shape, generator=generator) < share).to(tokens.device)
    return torch.where(wrong, near[tokens].gather(-1, pick[..., None]).squeeze(-1), tokens)
