"""Long motions as overlapping windows, each of a length that the model knows, joined in latent space.

Windows are drawn side by side. A convolutional decoder makes of the cross-faded latent, in one pass, a motion without a
seam wherever neighbours agree in their overlap; `Windows.disagreement` is what a family tilts its tokens against.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import torch
from jaxtyping import Float, Int, Shaped
from torch import Tensor

FADE = 4
"""Tokens in the middle of an overlap over which one window fades into the next: few, for a mean of two is a little
smoother than either."""


@dataclass(frozen=True)
class Windows:
    """Windows of equal length over a row of tokens of the finest scale.

    Tensors of all windows have the windows one after the other along the second axis, ``[S, M = W * L, ...]``, so that
    the first axis is samples; `rows` and `series` convert to a batch of R = S * W windows and back.

    Attributes:
        tokens: N, of the whole motion at the finest scale.
        length: n, of each window at the finest scale.
        starts: first token of each window.
    """

    tokens: int
    length: int
    starts: tuple[int, ...]

    @classmethod
    def covering(cls, tokens: int, longest: int, overlap: int) -> Windows:
        """As few windows as cover the motion, evenly spread; a single one where it suffices."""
        if tokens <= longest:
            return cls(tokens, tokens, (0,))
        count = -(-(tokens - overlap) // (longest - overlap))
        length = -(-(tokens + (count - 1) * overlap) // count)
        return cls(tokens, length, tuple(round(w * (tokens - length) / (count - 1)) for w in range(count)))

    @property
    def count(self) -> int:
        """W, the number of windows."""
        return len(self.starts)

    def rows(self, x: Shaped[Tensor, "S M *d"]) -> Shaped[Tensor, "R L *d"]:
        """Every window a row of its own."""
        return x.unflatten(1, (self.count, -1)).flatten(0, 1)

    def series(self, x: Shaped[Tensor, "R L *d"]) -> Shaped[Tensor, "S M *d"]:
        """A sample's windows one after the other."""
        return x.unflatten(0, (-1, self.count)).flatten(1, 2)

    def join(self, latent: Float[Tensor, "R d n"]) -> Float[Tensor, "S d N"]:
        """Latent of the whole motion: each window's own, cross-faded in the overlaps."""
        if self.count == 1:
            return latent
        faded = latent.unflatten(0, (-1, self.count)) * self.fade[:, None].to(latent)
        flat = faded.transpose(1, 2).flatten(2)
        return flat.new_zeros(*flat.shape[:2], self.tokens).index_add(2, self._at.flatten(), flat)

    def split(self, latent: Float[Tensor, "S d N"]) -> Float[Tensor, "R d n"]:
        """Each window's part of a latent of the whole motion."""
        return latent[..., self._at].transpose(1, 2).flatten(0, 1)

    def disagreement(self, latent: Float[Tensor, "R d n"]) -> Float[Tensor, "R d n"]:
        """What each window lacks of its neighbours' latent, times the share that `others` gives them."""
        return self.split(self.join(latent)) - latent

    @cached_property
    def fade(self) -> Float[Tensor, "W n"]:
        """Each window's share of the whole at its tokens: ramps in the overlaps, everywhere adding up to 1."""
        at = torch.arange(self.length) + 0.5
        share = torch.ones(self.count, self.length)
        for w in range(self.count - 1):
            overlap = self.starts[w] + self.length - self.starts[w + 1]
            ramp = ((at[:overlap] - overlap / 2) / FADE + 0.5).clamp(0, 1)
            share[w + 1, :overlap] = ramp
            share[w, self.length - overlap :] = 1 - ramp
        return share

    @property
    def others(self) -> Float[Tensor, "W n"]:
        """The neighbours' share at each window's tokens."""
        return 1 - self.fade

    @cached_property
    def _at(self) -> Int[Tensor, "W n"]:
        return torch.tensor(self.starts)[:, None] + torch.arange(self.length)
