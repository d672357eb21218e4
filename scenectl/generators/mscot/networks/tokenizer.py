"""Multi-scale residual VQ-VAE (MSCoT, section 3.1, algorithms 1 and 2)."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cache
from typing import cast

import torch
import torch.nn.functional as F
from jaxtyping import Float, Int
from torch import Tensor, nn

from scenectl.data.features import FEATURES
from scenectl.generators.mscot.config import TokenizerConfig
from scenectl.generators.mscot.schedule import DOWNSAMPLING, scale_lengths
from scenectl.networks.layers import Frames, Padding, ResidualBlock, Shortcut


def _blocks(config: TokenizerConfig, padding: Padding = "zeros") -> nn.Sequential:
    dilations = [config.dilation_growth**i for i in range(config.depth)]
    return nn.Sequential(*(ResidualBlock(config.width, d, padding) for d in reversed(dilations)))


def _same(channels: int, out: int) -> nn.Conv1d:
    """A convolution of the decoder; beyond its ends the latents go on as they were.

    Zeros there, which the paper leaves open, make the first and last three frames jump (`scenectl bench generator`).
    """
    return nn.Conv1d(channels, out, 3, padding=1, padding_mode="replicate")


class Encoder(Shortcut):
    """Features ``[B, 263, T]`` to latents ``[B, d, T / 4]``."""

    def __init__(self, config: TokenizerConfig) -> None:
        width = config.width
        net = nn.Sequential(
            nn.Conv1d(FEATURES, width, 3, padding=1),
            nn.ReLU(),
            nn.Conv1d(width, width, 4, stride=2, padding=1),
            _blocks(config),
            nn.Conv1d(width, width, 4, stride=2, padding=1),
            _blocks(config),
            nn.Conv1d(width, config.code_dim, 3, padding=1),
        )
        linear = nn.Conv1d(FEATURES, config.code_dim, DOWNSAMPLING, stride=DOWNSAMPLING) if config.shortcut else None
        super().__init__(net, linear)


class Decoder(Shortcut):
    """Latents ``[B, d, L]`` to features ``[B, 263, 4 L]``; piecewise linear."""

    def __init__(self, config: TokenizerConfig) -> None:
        width = config.width
        net = nn.Sequential(
            _same(config.code_dim, width),
            nn.ReLU(),
            _blocks(config, "replicate"),
            nn.Upsample(scale_factor=2, mode="nearest"),
            _same(width, width),
            _blocks(config, "replicate"),
            nn.Upsample(scale_factor=2, mode="nearest"),
            _same(width, width),
            nn.ReLU(),
            _same(width, width),
            nn.ReLU(),
            _same(width, FEATURES),
        )
        super().__init__(net, Frames(config.code_dim, FEATURES, DOWNSAMPLING) if config.shortcut else None)


@dataclass(frozen=True)
class Quantised:
    """What quantisation returns.

    Attributes:
        tokens: code indices of each scale, ``[B, L_k]``.
        latent: sum of all scales, ``[B, d, L]``, with straight-through gradients to the encoder.
        codebook_loss: moves scale convolutions towards the latents (Eq. 37, second term).
        commitment_loss: moves latents towards the codes (Eq. 37, third term).
    """

    tokens: list[Int[Tensor, "B _L_k"]]
    latent: Float[Tensor, "B d L"]
    codebook_loss: Float[Tensor, ""]
    commitment_loss: Float[Tensor, ""]


@dataclass
class _Seen:
    """What one training step showed the codebook: uses and sums of each code, best gains, vectors of each scale.

    A vector's weight is 1, or 0 where its sample had the scale switched off.
    """

    count: Tensor
    total: Tensor
    gain: Tensor
    pool: dict[int, Tensor] = field(default_factory=dict)
    weight: dict[int, Tensor] = field(default_factory=dict)


class Quantiser(nn.Module):
    """K scales of residual quantisation (Eq. 34 and 35) with one codebook, or with one for each scale.

    `codebook` holds the V codes that all scales share, ``[V, d]``, or the scales' own one after the other,
    ``[K V, d]``; tokens count from 0 at every scale.
    """

    codebook: Tensor
    gain: Tensor
    usage: Tensor
    sums: Tensor

    def __init__(self, config: TokenizerConfig) -> None:
        super().__init__()
        self.config = config
        self.convs = nn.ModuleList(
            nn.Conv1d(config.code_dim, config.code_dim, 3, padding=1) for _ in range(config.scale_convs)
        )
        rows = config.codes if config.shared_codebook else config.codes * len(config.scales)
        codes = torch.randn(rows, config.code_dim)
        self.register_buffer("gain", torch.ones(len(config.scales)))
        self.register_buffer("codebook", F.normalize(codes, dim=-1))
        # Running statistics of the codebook's moving average; of no use after training.
        self.register_buffer("usage", torch.ones(rows), persistent=True)
        self.register_buffer("sums", self.codebook.clone(), persistent=True)
        self._seen: _Seen | None = None

    @property
    def scales(self) -> int:
        return len(self.config.scales)

    def lengths(self, finest: int) -> tuple[int, ...]:
        """Tokens at each scale for a finest scale of `finest` tokens."""
        return scale_lengths(self.config.scales, finest)

    def codes(self, k: int) -> Float[Tensor, "V d"]:
        """Embeddings of all codes at scale k: unit vectors times the scale's gain, or the vectors as they are."""
        codes = self.codebook[self._rows(k)]
        return codes * self.gain[k] if self.config.normalised else codes

    def _rows(self, k: int) -> slice:
        """The rows of `codebook` that scale k uses."""
        first = 0 if self.config.shared_codebook else k * self.config.codes
        return slice(first, first + self.config.codes)

    def lookup(self, k: int, tokens: Int[Tensor, "*b L"]) -> Float[Tensor, "*b L d"]:
        """Embeddings of tokens at scale k."""
        return F.embedding(tokens, self.codes(k))

    def down(self, x: Float[Tensor, "B d L"], length: int) -> Float[Tensor, "B d l"]:
        """To a coarser scale."""
        if length == x.shape[-1]:
            return x
        if self.config.down == "area":
            return F.interpolate(x, size=length, mode="area")
        return F.interpolate(x, size=length, mode="linear", align_corners=False)

    def up(self, k: int, e: Float[Tensor, "B l d"], finest: int) -> Float[Tensor, "B d L"]:
        """Contribution of scale k's embeddings to the latent: ``Conv1D(Up_K(e))``, linear in `e`."""
        x = e.transpose(1, 2)
        if x.shape[-1] != finest:
            x = F.interpolate(x, size=finest, mode="linear", align_corners=False)
        # Half the signal skips the convolution, so that an untrained one does no harm (as in VAR).
        smooth: Tensor = self._conv(k)(x)
        return 0.5 * x + 0.5 * smooth

    def _conv(self, k: int) -> nn.Conv1d:
        """Of scale k; neighbours share one where there are fewer than scales."""
        return cast(nn.Conv1d, self.convs[round(k / max(self.scales - 1, 1) * (len(self.convs) - 1))])

    def nearest(self, k: int, u: Float[Tensor, "B d l"]) -> Int[Tensor, "B l"]:
        """Index of the nearest code at each position (Eq. 34)."""
        flat = u.transpose(1, 2)
        codes = self.codes(k)
        # |c - u|^2 = |c|^2 - 2 c.u + const
        return (codes.square().sum(-1) - 2 * flat @ codes.T).argmin(-1)

    def latent(self, embeddings: list[Float[Tensor, "B _L_k d"]], finest: int) -> Float[Tensor, "B d L"]:
        """Sum of the scales' contributions (algorithm 2), for as many scales as are given.

        All are linear, so that one product and one convolution do the work of `up` for every scale.
        """
        scales = range(len(embeddings))
        convs = list(dict.fromkeys(self._conv(k) for k in scales))
        spread = [_spread(e.shape[1], finest, convs.index(self._conv(k)), len(convs)) for k, e in enumerate(embeddings)]
        x = torch.cat(embeddings, dim=1).transpose(1, 2)
        x = (x @ torch.cat(spread).to(x)).unflatten(-1, (len(convs), finest))
        weight = torch.cat([conv.weight for conv in convs], dim=1)
        bias = torch.stack([cast(Tensor, self._conv(k).bias) for k in scales]).sum(0)
        smooth = F.conv1d(x.transpose(1, 2).flatten(1, 2), weight, bias, padding=1)
        return 0.5 * x.sum(2) + 0.5 * smooth

    def encode(self, f: Float[Tensor, "B d L"]) -> list[Int[Tensor, "B _L_k"]]:
        """Tokens of every scale (algorithm 1)."""
        rest, tokens = f, []
        for k, length in enumerate(self.lengths(f.shape[-1])):
            tokens.append(self.nearest(k, self.down(rest, length)))
            rest = rest - self.up(k, self.lookup(k, tokens[-1]), f.shape[-1])
        return tokens

    def forward(self, f: Float[Tensor, "B d L"], keep: Int[Tensor, " B"] | None = None) -> Quantised:
        """Quantise for training.

        Args:
            f: encoder output.
            keep: how many scales each sample keeps (quantisation dropout); all by default.
        """
        finest = f.shape[-1]
        total, tokens = torch.zeros_like(f), []
        codebook_loss, commitment_loss = f.new_zeros(()), f.new_zeros(())
        for k, length in enumerate(self.lengths(finest)):
            u = self.down((f - total).detach(), length)
            tokens.append(self.nearest(k, u))
            part = self.up(k, self.lookup(k, tokens[-1]), finest)
            on = torch.ones_like(f[:, :1, :1]) if keep is None else (keep > k).to(f)[:, None, None]
            total = total + part * on
            share = on.mean().clamp_min(1e-6)
            codebook_loss = codebook_loss + ((total - f.detach()).square() * on).mean() / share
            commitment_loss = commitment_loss + ((total.detach() - f).square() * on).mean() / share
            if self.training:
                self._observe(k, u, tokens[-1], on)
        straight = f + (total - f).detach()
        return Quantised(tokens, straight, codebook_loss / self.scales, commitment_loss / self.scales)

    @torch.no_grad()
    def _observe(self, k: int, u: Tensor, tokens: Tensor, on: Tensor) -> None:
        """Count what each code was used for; `update_codebook` turns the counts into new codes and gains."""
        if self._seen is None:
            self._seen = _Seen(torch.zeros_like(self.usage), torch.zeros_like(self.sums), self.gain.clone())
        seen, weight = self._seen, on[:, 0].expand(-1, tokens.shape[1]).flatten()
        flat, index = u.transpose(1, 2).flatten(0, 1), tokens.flatten() + self._rows(k).start
        if self.config.normalised:
            # The gain that fits best: the mean projection on the chosen unit codes.
            projection = (flat * self.codebook[index]).sum(-1)
            fit = (projection * weight).sum() / weight.sum().clamp_min(1.0)
            seen.gain[k] = torch.where(weight.sum() > 0, fit, seen.gain[k])
            flat = F.normalize(flat, dim=-1)
        seen.count.index_add_(0, index, weight)
        seen.total.index_add_(0, index, flat * weight[:, None])
        seen.pool[k], seen.weight[k] = flat, weight

    @torch.no_grad()
    def update_codebook(self, decay: float, revive_below: float) -> Int[Tensor, ""]:
        """Moving averages of codes and gains; codes used less than `revive_below` times a step restart on data.

        Data are the vectors that the code's scales were shown in this step. Returns how many codes restarted; nothing
        here waits for an accelerator.
        """
        seen, self._seen = self._seen, None
        revived = torch.zeros((), dtype=torch.long, device=self.codebook.device)
        if seen is None:
            return revived
        self.usage.mul_(decay).add_(seen.count, alpha=1 - decay)
        self.sums.mul_(decay).add_(seen.total, alpha=1 - decay)
        self.gain.lerp_(seen.gain.clamp_min(1e-3), 1 - decay)
        for rows, pool, weight in self._shown(seen):
            revived = revived + self._revive(rows, pool, weight, revive_below)
        codes = self.sums / self.usage.clamp_min(1e-6)[:, None]
        self.codebook.copy_(F.normalize(codes, dim=-1) if self.config.normalised else codes)
        return revived

    def _shown(self, seen: _Seen) -> list[tuple[slice, Tensor, Tensor]]:
        """Each codebook's rows with the vectors it was shown and their weights."""
        if self.config.shared_codebook:
            return [(self._rows(0), torch.cat(list(seen.pool.values())), torch.cat(list(seen.weight.values())))]
        return [(self._rows(k), pool, seen.weight[k]) for k, pool in seen.pool.items()]

    def _revive(self, rows: slice, pool: Tensor, weight: Tensor, below: float) -> Int[Tensor, ""]:
        usage, sums = self.usage[rows], self.sums[rows]
        dead = (usage < below) & (weight.sum() > 0)
        # Drawn for all codes and used for the dead: how many these are, only the device knows.
        fresh = pool[torch.multinomial(weight.clamp_min(1e-12), len(usage), replacement=True)]
        self.sums[rows] = torch.where(dead[:, None], fresh, sums)
        self.usage[rows] = torch.where(dead, torch.ones_like(usage), usage)
        return dead.sum()

    @torch.no_grad()
    def initialise(self, f: Float[Tensor, "B d L"]) -> None:
        """Codes from data and gains from the size of each scale's residual."""
        rest, pool = f, []
        for k, length in enumerate(self.lengths(f.shape[-1])):
            u = self.down(rest, length).transpose(1, 2)
            self.gain[k] = u.norm(dim=-1).mean().clamp_min(1e-3)
            pool.append(u.flatten(0, 1))
            directions = F.normalize(u, dim=-1) * self.gain[k]
            rest = rest - 0.5 * self.up(k, directions, f.shape[-1])
        flat = [torch.cat(pool)] if self.config.shared_codebook else pool
        picks = torch.cat([vectors[torch.randint(len(vectors), (self.config.codes,))] for vectors in flat])
        self.codebook.copy_(F.normalize(picks, dim=-1) if self.config.normalised else picks)
        self.sums.copy_(self.codebook)
        self.usage.fill_(1.0)


@cache
def _spread(length: int, finest: int, part: int, parts: int) -> Float[Tensor, "l n"]:
    """Matrix that brings a scale to the finest (as `Quantiser.up` does), in one of so many parts side by side."""
    up = F.interpolate(torch.eye(length, dtype=torch.float64)[None], size=finest, mode="linear", align_corners=False)[0]
    return F.pad(up, (part * finest, (parts - 1 - part) * finest))


class Tokenizer(nn.Module):
    """Encoder, quantiser and decoder, with the feature statistics that normalise their input and output."""

    mean: Tensor
    std: Tensor

    def __init__(self, config: TokenizerConfig) -> None:
        super().__init__()
        self.config = config
        self.encoder = Encoder(config)
        self.quantiser = Quantiser(config)
        self.decoder = Decoder(config)
        self.register_buffer("mean", torch.zeros(FEATURES))
        self.register_buffer("std", torch.ones(FEATURES))

    def latent(self, features: Float[Tensor, "B T 263"]) -> Float[Tensor, "B d L"]:
        """Encoder output for raw features; T is a multiple of 4."""
        out: Tensor = self.encoder(((features - self.mean) / self.std).transpose(1, 2))
        return out

    def encode(self, features: Float[Tensor, "B T 263"]) -> list[Int[Tensor, "B _L_k"]]:
        """Tokens of every scale (algorithm 1)."""
        return self.quantiser.encode(self.latent(features))

    def decode_latent(self, latent: Float[Tensor, "B d L"]) -> Float[Tensor, "B T 263"]:
        """Raw features of a latent."""
        out: Tensor = self.decoder(latent)
        return out.transpose(1, 2) * self.std + self.mean

    def decode(self, tokens: list[Int[Tensor, "B _L_k"]]) -> Float[Tensor, "B T 263"]:
        """Raw features of the tokens of all K scales (algorithm 2)."""
        finest = tokens[-1].shape[-1]
        if len(tokens) < self.quantiser.scales:
            raise ValueError("decode needs all scales; use quantiser.latent for a prefix")
        embeddings = [self.quantiser.lookup(k, t) for k, t in enumerate(tokens)]
        return self.decode_latent(self.quantiser.latent(embeddings, finest))
