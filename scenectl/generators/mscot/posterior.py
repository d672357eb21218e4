"""The posterior of one scale's tokens given goals: to first order (Eq. 9 to 11), or by trying every code."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TypeAlias

import torch
from jaxtyping import Float
from torch import Tensor

from scenectl.generators.base import Guide, Step
from scenectl.generators.mscot.settings import Sampling


@dataclass(frozen=True)
class Scale:
    """One scale before its tokens are drawn.

    Attributes:
        k: the scale, from 0.
        step: prior-mean embeddings (Eq. 11) and their decoder.
        prior: log-probabilities before guidance, ``[S, L_k, V]``.
        codes: embeddings of the codes at this scale, ``[V, d]``.
        nats: spread to which each sample's tilt is clipped, ``[S]``.
    """

    k: int
    step: Step
    prior: Float[Tensor, "S L_k V"]
    codes: Float[Tensor, "V d"]
    nats: Float[Tensor, " S"]

    def first_order(self, guide: Guide) -> Float[Tensor, "S L_k V"]:
        """Log-likelihood of every code to first order (Eq. 10), up to a constant and unclipped."""
        return guide.gradient(self.step) @ self.codes.T


Posterior: TypeAlias = Callable[[Scale, Guide], Float[Tensor, "S L_k V"]]
"""Log-probabilities of a scale's tokens given a guide; by default `tilted`."""


def tilted(scale: Scale, guide: Guide) -> Float[Tensor, "S L_k V"]:
    """The prior tilted once, by the gradient's inner product with each code (Eq. 9 to 11)."""
    return (scale.prior + clipped(scale.first_order(guide), scale.nats[:, None, None])).log_softmax(-1)


def exact_tilt(step: Step, guide: Guide, codes: Float[Tensor, "V d"], position: int) -> Float[Tensor, "S V"]:
    """Log-likelihood of the goals for every code at one position, the others at their means (Eq. 9, V decodes)."""
    rows = []
    for code in codes:
        value = step.value.clone()
        value[:, position] = code
        rows.append(guide.log_prob(step.at(value)))
    return torch.stack(rows, dim=-1)


def clipped(tilt: Float[Tensor, "*b V"], nats: float | Tensor) -> Float[Tensor, "*b V"]:
    """The tilt scaled down where its spread over the codes exceeds `nats` (one, or ``[*b, 1]``); 0 leaves it alone."""
    spread = tilt.amax(-1, keepdim=True) - tilt.amin(-1, keepdim=True)
    most = torch.as_tensor(nats, dtype=tilt.dtype, device=tilt.device)
    return tilt * torch.where(most > 0, (most / spread.clamp_min(1e-12)).clamp_max(1.0), 1.0)


def clip_at(sampling: Sampling, k: int, scales: int, samples: int) -> Float[Tensor, " S"]:
    """Largest spread (nats) of every sample's tilt at scale k of so many, from 0.

    A coarse token moves the whole motion: a body that is pushed there slides to a few keyframes, and one that is
    not finds no way around a wall. So the first sample's limit grows evenly from `clip_coarsest` of `clip_nats` at
    the coarsest scale, the last one's is the same at all, and those of samples in between lie in between.
    """
    coarsest = torch.linspace(sampling.clip_coarsest, 1.0, samples)
    return sampling.clip_nats * (coarsest + (1 - coarsest) * k / max(scales - 1, 1))
