"""Scale-wise transformer: predicts all tokens of a scale at once from the text and the coarser scales (Eq. 1)."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import cast

import torch
import torch.nn.functional as F
from jaxtyping import Bool, Float, Int
from torch import Tensor, nn

from scenectl.generators.mscot.config import TransformerConfig
from scenectl.generators.mscot.networks.tokenizer import Quantiser
from scenectl.networks.layers import Dropout, sinusoids
from scenectl.networks.text import TimedText

NOTHING = 1e-30
"""Share of a token that stands for none: its logarithm is finite, and what it weighs is lost in rounding."""


@dataclass
class Cache:
    """What the scales already predicted leave to the next.

    Attributes:
        keys, values: theirs, one of each a layer, ``[B, H, tokens, C]``.
        words: keys and values of the text, one pair a layer; empty before the first scale.
        latent: of their embeddings, ``[B, d, finest]``; None before the second scale.
    """

    keys: list[Tensor] = field(default_factory=list)
    values: list[Tensor] = field(default_factory=list)
    words: list[tuple[Tensor, Tensor]] = field(default_factory=list)
    latent: Tensor | None = None


class Attention(nn.Module):
    """Multi-head attention over itself or over words."""

    def __init__(self, width: int, heads: int, source: int | None = None) -> None:
        super().__init__()
        self.heads = heads
        self.query = nn.Linear(width, width)
        self.key_value = nn.Linear(source or width, 2 * width)
        self.out = nn.Linear(width, width)

    def split(self, x: Float[Tensor, "B N C"]) -> Float[Tensor, "B H N c"]:
        return x.unflatten(-1, (self.heads, -1)).transpose(1, 2)

    def project(self, source: Float[Tensor, "B N D"]) -> tuple[Tensor, Tensor]:
        key, value = self.key_value(source).chunk(2, dim=-1)
        return self.split(key), self.split(value)

    def attend(self, x: Tensor, key: Tensor, value: Tensor, bias: Tensor | None) -> Float[Tensor, "B N C"]:
        """What `x` finds; `bias` is added to the scores, ``[..., N, sources]``.

        Plain products: on a CPU, half of a training step went into the backward pass of torch's fused attention.
        """
        query = self.split(self.query(x)) * (x.shape[-1] // self.heads) ** -0.5
        scores = query @ key.transpose(-1, -2)
        shares = (scores if bias is None else scores + bias).softmax(-1)
        result: Tensor = self.out((shares @ value).transpose(1, 2).flatten(2))
        return result


class Block(nn.Module):
    """Self-attention over scales, cross-attention to words, feed-forward; normalised first."""

    def __init__(self, config: TransformerConfig) -> None:
        super().__init__()
        width = config.width
        self.norm_self, self.norm_cross, self.norm_feed = (nn.LayerNorm(width) for _ in range(3))
        self.self_attention = Attention(width, config.heads)
        self.cross_attention = Attention(width, config.heads)
        narrow = nn.Linear(4 * width, width)
        self.feed = nn.Sequential(nn.Linear(width, 4 * width), nn.GELU(), narrow)
        self.dropout = Dropout(config.dropout)
        # Residual branches start small, so that depth does not hurt early on.
        for out in (self.self_attention.out, self.cross_attention.out, narrow):
            nn.init.normal_(out.weight, std=0.02 / math.sqrt(2 * config.layers))

    def forward(
        self,
        x: Tensor,
        words: tuple[Tensor, Tensor],
        word_bias: Tensor,
        bias: Tensor | None,
        past: tuple[Tensor, Tensor] | None,
    ) -> tuple[Tensor, tuple[Tensor, Tensor]]:
        h = self.norm_self(x)
        key, value = self.self_attention.project(h)
        if past is not None:
            key, value = torch.cat([past[0], key], dim=2), torch.cat([past[1], value], dim=2)
        x = x + self.dropout(self.self_attention.attend(h, key, value, bias))
        x = x + self.dropout(self.cross_attention.attend(self.norm_cross(x), *words, word_bias))
        return x + self.dropout(self.feed(self.norm_feed(x))), (key, value)


class ScaleTransformer(nn.Module):
    """Logits of every scale's tokens given all coarser ones.

    A scale attends to itself and to coarser scales, never to finer ones. Positions are times: a token knows
    where in the motion it lies, in units of the finest scale, so that all scales and lengths share one clock.

    Sentences have their times on that clock, too, and a token reads those that are about its own stretch: words count
    in attention as often as their sentence's share of the stretch says, so that one sentence about all of the motion
    is read as it is, and a coarse token reads all that fall into it.
    """

    def __init__(self, config: TransformerConfig, codes: int, code_dim: int, scales: int) -> None:
        super().__init__()
        self.config, width = config, config.width
        self.sentence = nn.Linear(config.text_dim, width)
        self.words = nn.Linear(config.text_dim, width)
        self.no_sentence = nn.Parameter(torch.zeros(config.text_dim))
        self.no_word = nn.Parameter(torch.zeros(config.text_dim))
        self.code = nn.Linear(code_dim, width)
        self.scale = nn.Parameter(torch.randn(scales, width) * 0.02)
        self.duration = nn.Linear(width, width)
        self.blocks = nn.ModuleList(Block(config) for _ in range(config.layers))
        self.norm = nn.LayerNorm(width)
        self.head = nn.Linear(width, codes)

    def without_text(self, prompt: TimedText, drop: Bool[Tensor, " B"]) -> TimedText:
        """The prompt with some samples' text replaced by the learned 'no text' (classifier-free guidance)."""
        first, alone = torch.full_like(prompt.owner, -1), torch.zeros_like(prompt.end)
        first[:, 0], alone[:, 0] = 0, math.inf
        return TimedText(
            torch.where(drop[:, None, None], self.no_sentence, prompt.sentence),
            torch.where(drop[:, None, None], self.no_word, prompt.words),
            torch.where(drop[:, None], first, prompt.owner),
            torch.where(drop[:, None], 0.0, prompt.begin),
            torch.where(drop[:, None], alone, prompt.end),
        )

    def inputs(
        self,
        quantiser: Quantiser,
        prompt: TimedText,
        embeddings: list[Float[Tensor, "B _L_k d"]],
        k: int,
        finest: int,
        cache: Cache | None = None,
    ) -> Float[Tensor, "B L_k C"]:
        """Input tokens of scale k: the text for the first, what came before for the others."""
        length = quantiser.lengths(finest)[k]
        device, width = prompt.words.device, self.config.width
        edges = _edges([length], finest, device)
        if k == 0:
            shares = _shares(prompt, edges)
            x = self.sentence(shares / shares.sum(-1, keepdim=True) @ prompt.sentence)
        else:
            x = self.code(self._prefix(quantiser, embeddings[:k], length, finest, cache))
        at = edges.mean(-1)
        duration = self.duration(sinusoids(torch.tensor([float(finest)], device=device), width))
        out: Tensor = x + self.scale[k] + sinusoids(at, width) + duration
        return out

    def _prefix(
        self, quantiser: Quantiser, embeddings: list[Tensor], length: int, finest: int, cache: Cache | None
    ) -> Tensor:
        if self.config.prefix == "cumulative":
            if cache is None or cache.latent is None:
                latent = quantiser.latent(embeddings, finest)
            else:
                last = len(embeddings) - 1
                latent = cache.latent + quantiser.up(last, embeddings[last], finest)
            if cache is not None:
                cache.latent = latent
            return quantiser.down(latent, length).transpose(1, 2)
        newest = embeddings[-1].transpose(1, 2)
        return F.interpolate(newest, size=length, mode="linear", align_corners=False).transpose(1, 2)

    def forward(
        self, quantiser: Quantiser, prompt: TimedText, tokens: list[Int[Tensor, "B _L_k"]], finest: int
    ) -> Float[Tensor, "B N V"]:
        """Logits of all scales at once (training), the scales one after the other along N."""
        embeddings = [quantiser.lookup(k, t) for k, t in enumerate(tokens[:-1])]
        lengths = quantiser.lengths(finest)
        x = torch.cat([self.inputs(quantiser, prompt, embeddings, k, finest) for k in range(len(lengths))], dim=1)
        return self._run(x, prompt, lengths, finest)

    def predict(
        self,
        quantiser: Quantiser,
        prompt: TimedText,
        embeddings: list[Float[Tensor, "B _L_k d"]],
        k: int,
        finest: int,
        cache: Cache | None = None,
    ) -> Float[Tensor, "B L_k V"]:
        """Logits of scale k.

        With a cache, only scale k is computed and the cache grows; without one, all scales up to k are.
        """
        lengths = quantiser.lengths(finest)[: k + 1]
        if cache is not None:
            x = self.inputs(quantiser, prompt, embeddings, k, finest, cache)
            return self._run(x, prompt, lengths[k:], finest, cache)
        x = torch.cat([self.inputs(quantiser, prompt, embeddings, i, finest) for i in range(k + 1)], dim=1)
        return self._run(x, prompt, lengths, finest)[:, -lengths[-1] :]

    def _run(
        self, x: Tensor, prompt: TimedText, lengths: Sequence[int], finest: int, cache: Cache | None = None
    ) -> Tensor:
        """Logits of some scales' inputs, one after the other; those before are in the cache, if there is one."""
        words = self._words(prompt, cache)
        word_bias = _word_bias(prompt, _edges(lengths, finest, x.device))[:, None]
        bias = _scale_bias(lengths, x.device) if len(lengths) > 1 else None
        if torch.is_autocast_enabled(x.device.type):  # once, instead of in every layer
            kind = torch.get_autocast_dtype(x.device.type)
            word_bias, bias = word_bias.to(kind), None if bias is None else bias.to(kind)
        for i, block in enumerate(self.blocks):
            past = (cache.keys[i], cache.values[i]) if cache is not None and len(cache.keys) > i else None
            x, (key, value) = block(x, words[i], word_bias, bias, past)
            if cache is not None:
                cache.keys[i : i + 1], cache.values[i : i + 1] = [key], [value]
        out: Tensor = self.head(self.norm(x))
        return out

    def _words(self, prompt: TimedText, cache: Cache | None) -> list[tuple[Tensor, Tensor]]:
        """Keys and values of the text for every layer."""
        if cache is not None and cache.words:
            return cache.words
        words = self.words(prompt.words)
        found = [cast(Block, block).cross_attention.project(words) for block in self.blocks]
        if cache is not None:
            cache.words = found
        return found


def _edges(lengths: Sequence[int], finest: int, device: torch.device) -> Float[Tensor, "M 2"]:
    """Begin and end of every token of some scales, in tokens of the finest one."""
    begins = [torch.arange(length, device=device) * (finest / length) for length in lengths]
    ends = [torch.arange(1, length + 1, device=device) * (finest / length) for length in lengths]
    return torch.stack([torch.cat(begins), torch.cat(ends)], dim=-1)


def _shares(prompt: TimedText, edges: Float[Tensor, "M 2"]) -> Float[Tensor, "B M S"]:
    """How much of each token every sentence is about; never nothing at all, so that there is always one to read."""
    return prompt.shares(edges).clamp_min(NOTHING)


def _word_bias(prompt: TimedText, edges: Float[Tensor, "M 2"]) -> Float[Tensor, "B M N"]:
    """What is added to the scores of the words: the logarithm of their sentence's share of each token."""
    owner = prompt.owner[:, None].expand(-1, len(edges), -1)
    return _shares(prompt, edges).log().gather(2, owner.clamp_min(0)).masked_fill(owner < 0, -math.inf)


def _scale_bias(lengths: Sequence[int], device: torch.device) -> Float[Tensor, "M M"]:
    """What is added to the scores of tokens: nothing, and minus infinity for those of finer scales."""
    scale = torch.repeat_interleave(torch.arange(len(lengths)), torch.tensor(lengths)).to(device)
    return torch.zeros(len(scale), len(scale), device=device).masked_fill(scale[:, None] < scale, -math.inf)
