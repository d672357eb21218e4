"""MSCoT's steps: embeddings of one or of all scales, through the tokenizer's decoder, to joints."""

from __future__ import annotations

from collections.abc import Callable

import torch
from torch import Tensor

from scenectl.data.features import POSITIONS
from scenectl.generators.mscot.networks.tokenizer import Tokenizer
from scenectl.generators.steps import LatentStep
from scenes.motion.motion import Motion

_READ = POSITIONS.stop
"""Features from which joints are recovered: the first so many."""


def step_of(
    tokenizer: Tokenizer,
    value: Tensor,
    latent: Callable[[Tensor], Tensor],
    place: Callable[[Tensor], Motion],
    rough: torch.dtype | None = None,
) -> LatentStep:
    """A step at a value, by the affine map from values to latents ``[S, d, L]``; see `LatentStep`."""
    scale, offset = tokenizer.std[:_READ], tokenizer.mean[:_READ]
    return LatentStep(value, tokenizer.decoder, scale, offset, latent, place, rough)
