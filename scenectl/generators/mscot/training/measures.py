"""What a finished tokenizer makes of held-out motion: errors, and how it uses its codes."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

import torch
from jaxtyping import Float

from scenectl.data.clips import ClipSet, beginnings, overlapping
from scenectl.generators.mscot.coding import after_scales
from scenectl.generators.mscot.networks.tokenizer import Tokenizer
from scenectl.training.errors import RoundTrip, error_by_band, error_by_joint, joints_after, kept_by_band

FINER = 3
"""Code use is judged at the scales beyond this one: coarser ones have few tokens to use codes with."""


def round_trip(tokenizer: Tokenizer) -> RoundTrip:
    """Features through the tokenizer's codes and back; their number of frames is a multiple of 4."""
    tokenizer.eval()
    return lambda features: tokenizer.decode(tokenizer.encode(features))


@torch.no_grad()
def code_use(tokenizer: Tokenizer, features: Float[Tensor, "C T 263"]) -> list[dict[str, float]]:
    """How each scale uses its codes (Fig. 7).

    Returns:
        For every scale its number, the tokens it was counted over, the share of its V codes that occur, and the
        perplexity of their distribution (V where all are used alike, 1 where one is).
    """
    quantiser = tokenizer.eval().quantiser
    codes = quantiser.config.codes
    count = torch.zeros(quantiser.scales, codes, device=features.device)
    for part in features.split(64):
        for k, tokens in enumerate(tokenizer.encode(part)):
            count[k] += torch.bincount(tokens.flatten(), minlength=codes)
    share = count / count.sum(1, keepdim=True)
    entropy = -torch.special.xlogy(share, share).sum(1)
    return [
        {
            "scale": k + 1.0,
            "tokens": float(count[k].sum()),
            "share_used": float((count[k] > 0).float().mean()),
            "perplexity": math.exp(float(entropy[k])),
        }
        for k in range(quantiser.scales)
    ]


def least_use(use: Sequence[Mapping[str, float]], figure: str = "share_used") -> float:
    """The smallest figure of `code_use` among the scales beyond `FINER`, or at the last where there are no more."""
    return min(row[figure] for row in use[FINER:] or use[-1:])


def measure_tokenizer(tokenizer: Tokenizer, train: ClipSet, test: ClipSet, frames: int = 64) -> dict[str, Any]:
    """Code use on both splits, and on the second errors and what each number of scales keeps of the movement.

    All over the first `frames` frames of the clips.
    """
    held_out = beginnings(test, frames)
    got, true = joints_after(round_trip(tokenizer), held_out)
    return {
        "clips": len(held_out),
        "code_use": {
            "train": code_use(tokenizer, overlapping(train, frames)),
            "test": code_use(tokenizer, held_out),
        },
        "error_by_joint": error_by_joint(got, true),
        "error_by_band": error_by_band(got, true),
        "kept_by_scales": [
            kept_by_band(*joints_after(after_scales(tokenizer, k + 1), held_out))
            for k in range(tokenizer.quantiser.scales)
        ],
    }
