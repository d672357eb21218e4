"""How much motion a change of the embeddings is, measured on training clips."""

from __future__ import annotations

import torch
from jaxtyping import Float
from torch import Tensor

from scenectl.data.features import features_to_joints
from scenectl.generators.mscot.networks.metric import Metric
from scenectl.generators.mscot.networks.refiner import Refiner
from scenectl.generators.mscot.networks.tokenizer import Tokenizer
from scenectl.generators.mscot.schedule import MAX_FRAMES, MIN_FRAMES
from scenectl.generators.mscot.step import step_of
from scenectl.generators.mscot.training.measures import beginnings
from scenectl.training.dataset import Windows
from scenes.motion.motion import Motion

_CLIPS, _BATCH, _PROBES = 48, 8, 4
_FRAMES = (64, MAX_FRAMES)
_SMOOTH = 10.0
"""Weight of a joint's acceleration (m/frame^2) beside its displacement (m): a smooth move counts for less."""


def measure_metric(tokenizer: Tokenizer, refiner: Refiner, data: Windows, seed: int = 0) -> Metric:
    """Gradients for random pulls on joints: their mean square is what changes of each embedding do, to first order.

    A pull is a normal number on every coordinate of every joint and frame, and another, weighted, on its second
    difference. Clips of 64 and of 196 frames count alike, where the data has both, or those of 36 where it has neither.
    """
    quantiser, dim = tokenizer.quantiser, tokenizer.config.code_dim
    draw = torch.Generator().manual_seed(seed)
    energy, counted = torch.zeros(quantiser.scales, dim, dim, dtype=torch.float64), torch.zeros(quantiser.scales)
    for frames in [n for n in _FRAMES if bool((data.lengths >= n).any())] or [MIN_FRAMES]:
        for features in beginnings(data, frames, _CLIPS, seed).split(_BATCH):
            with torch.no_grad():
                tokens = tokenizer.encode(features)
                finest = tokens[-1].shape[-1]
                codes = [quantiser.lookup(k, t) for k, t in enumerate(tokens)]
                value = torch.cat([e + refiner(e, k, finest) for k, e in enumerate(codes)], dim=1)
            for k, part in enumerate(_pulled(tokenizer, value, finest, draw)):
                flat = part.flatten(0, -2).double()
                energy[k] += flat.T @ flat
                counted[k] += len(flat)
    metric = Metric(dim, quantiser.scales)
    metric.adopt((energy / counted[:, None, None]).float())
    return metric


def _pulled(
    tokenizer: Tokenizer, value: Float[Tensor, "S M d"], finest: int, draw: torch.Generator
) -> list[Float[Tensor, "R S _L d"]]:
    """Each scale's gradients for random pulls."""
    lengths = list(tokenizer.quantiser.lengths(finest))
    step = step_of(
        tokenizer, value, lambda v: tokenizer.quantiser.latent(list(v.split(lengths, dim=1)), finest),
        lambda features: Motion(features_to_joints(features)),
    )  # fmt: skip
    shape = (_PROBES, *step.motion.joints.shape)
    pulls = torch.randn(shape, generator=draw)
    bends = _SMOOTH * torch.randn((*shape[:2], shape[2] - 2, *shape[3:]), generator=draw)
    pulls[:, :, 2:] += bends
    pulls[:, :, 1:-1] -= 2 * bends
    pulls[:, :, :-2] += bends
    return list(step.vjps(pulls).split(lengths, dim=2))
