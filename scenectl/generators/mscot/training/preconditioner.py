"""How much motion a change of the embeddings is, measured on training clips."""

from __future__ import annotations

import torch
from jaxtyping import Float
from torch import Tensor

from scenectl.data.clips import ClipSet, beginnings
from scenectl.data.features import body_joints
from scenectl.generators.mscot.networks.preconditioner import Preconditioner
from scenectl.generators.mscot.networks.refiner import Refiner
from scenectl.generators.mscot.networks.tokenizer import Tokenizer
from scenectl.generators.mscot.schedule import MAX_FRAMES, MIN_FRAMES

_CLIPS, _BATCH, _PROBES = 48, 8, 4
_FRAMES = (64, MAX_FRAMES)
_SMOOTH = 10.0
"""Weight of a joint's acceleration (m/frame^2) beside its displacement (m): a smooth move counts for less."""


def measure_preconditioner(tokenizer: Tokenizer, refiner: Refiner, data: ClipSet, seed: int = 0) -> Preconditioner:
    """Gradients for random pulls on joints: their mean square is what changes of each embedding do, to first order.

    A pull is a normal number on every coordinate of every joint and frame, and another, weighted, on its second
    difference. Clips of 64 and of 196 frames count alike, where the data has both, or those of 36 where it has neither.
    """
    quantiser, dim, device = tokenizer.quantiser, tokenizer.config.code_dim, data.features.device
    draw = torch.Generator().manual_seed(seed)
    energy = torch.zeros(quantiser.scales, dim, dim, dtype=torch.float64, device=device)
    counted = torch.zeros(quantiser.scales, device=device)
    for frames in [n for n in _FRAMES if bool((data.lengths >= n).any())] or [MIN_FRAMES]:
        for features in beginnings(data, frames, _CLIPS, seed).split(_BATCH):
            with torch.no_grad():
                tokens = tokenizer.encode(features)
                finest = tokens[-1].shape[-1]
                codes = [quantiser.lookup(k, t) for k, t in enumerate(tokens)]
                moved = [e + refiner(e, k, finest) for k, e in enumerate(codes)]
            for k, part in enumerate(_pulled(tokenizer, moved, finest, draw)):
                flat = part.flatten(0, -2).double()
                energy[k] += flat.T @ flat
                counted[k] += len(flat)
    made = Preconditioner(dim, quantiser.scales).to(device)
    made.adopt((energy / counted[:, None, None]).float())
    return made


def _pulled(
    tokenizer: Tokenizer, embeddings: list[Float[Tensor, "S _L d"]], finest: int, draw: torch.Generator
) -> list[Float[Tensor, "R S _L d"]]:
    """Each scale's gradients for random pulls."""
    parts = [e.requires_grad_(True) for e in embeddings]
    joints = body_joints(tokenizer.decode_latent(tokenizer.quantiser.latent(parts, finest)))
    pulls = [torch.autograd.grad(joints, parts, pull, retain_graph=True) for pull in _pulls(joints, draw)]
    return [torch.stack(each) for each in zip(*pulls, strict=True)]


def _pulls(joints: Float[Tensor, "S T J 3"], draw: torch.Generator) -> Float[Tensor, "R S T J 3"]:
    """Random pulls, drawn on the CPU, so that a run sees the same numbers on every device."""
    samples, frames, *rest = joints.shape
    pulls = torch.randn((_PROBES, samples, frames, *rest), generator=draw)
    bends = _SMOOTH * torch.randn((_PROBES, samples, frames - 2, *rest), generator=draw)
    pulls[:, :, 2:] += bends
    pulls[:, :, 1:-1] -= 2 * bends
    pulls[:, :, :-2] += bends
    return pulls.to(joints.device)
