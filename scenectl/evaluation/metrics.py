"""The standard text-to-motion metrics, on embeddings of any evaluator (definitions of Guo et al., CVPR 2022)."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from scenes.errors import UserError

BATCH = 32
"""Candidates a motion is ranked among; R-precision is defined by it."""

PAIRS = 300
"""Random pairs behind diversity; 100 where there are fewer samples than that."""


@dataclass(frozen=True)
class Estimate:
    """A figure over repeats.

    Attributes:
        mean: over the repeats.
        interval: half the width of its 95 % interval, ``1.96 std / sqrt(n)``.
    """

    mean: float
    interval: float

    def __str__(self) -> str:
        return f"{self.mean:.3f} ± {self.interval:.3f}"


def repeated(figure: Callable[[torch.Generator], float], repeats: int, seed: int) -> Estimate:
    """A random figure over repeats, with its 95 % interval."""
    values = torch.tensor([figure(torch.Generator().manual_seed(seed + i)) for i in range(repeats)], dtype=torch.double)
    return Estimate(float(values.mean()), float(1.96 * values.std(correction=0) / len(values) ** 0.5))


def check_enough(clips: int) -> None:
    """Raise UserError where there are fewer clips than R-precision ranks among."""
    if clips < BATCH:
        raise UserError(f"R-precision ranks among {BATCH} motions and there are {clips}; evaluate more clips")


def r_precision(
    texts: Float[Tensor, "N d"], motions: Float[Tensor, "N d"], draw: torch.Generator, top: int = 3
) -> Float[Tensor, " top"]:
    """Share of texts whose own motion is among the 1, 2, .. nearest of a batch of 32, by Euclidean distance.

    Batches are drawn at random; the last one is dropped where it is incomplete.

    Raises:
        UserError: there are fewer than 32 pairs.
    """
    check_enough(len(texts))
    order = torch.randperm(len(texts), generator=draw)[: len(texts) // BATCH * BATCH]
    hits = torch.stack([_hits(texts[i], motions[i], top) for i in order.split(BATCH)])
    return hits.double().mean((0, 1)).float()


def _hits(texts: Float[Tensor, "B d"], motions: Float[Tensor, "B d"], top: int) -> Bool[Tensor, "B top"]:
    distance = torch.cdist(texts.double(), motions.double())
    # How many other motions are nearer than a text's own; equal distances count against it.
    nearer = (distance <= distance.diagonal()[:, None]).sum(1) - 1
    return nearer[:, None] <= torch.arange(top)


def multimodal_distance(texts: Float[Tensor, "N d"], motions: Float[Tensor, "N d"]) -> float:
    """Mean Euclidean distance between a text and its motion."""
    return float((texts - motions).norm(dim=-1).mean())


def frechet_distance(a: Float[Tensor, "N d"], b: Float[Tensor, "M d"]) -> float:
    """FID: squared 2-Wasserstein distance between Gaussians fitted to both sets (unbiased covariances).

    ``tr sqrt(A B)`` is the sum of the square roots of the eigenvalues of ``A B``, which are those of the symmetric
    ``sqrt(A) B sqrt(A)``: no square root of a matrix that may not be finite.

    Raises:
        UserError: a set has fewer than two samples.
    """
    if min(len(a), len(b)) < 2:
        raise UserError("FID needs at least two motions in each set; evaluate more clips")
    a, b = a.double(), b.double()
    cov_a, cov_b = torch.cov(a.T), torch.cov(b.T)
    values, vectors = torch.linalg.eigh(cov_a.reshape(a.shape[1], -1))
    root = vectors @ (values.clamp_min(0.0).sqrt()[:, None] * vectors.T)
    cross = torch.linalg.eigvalsh(root @ cov_b.reshape(a.shape[1], -1) @ root).clamp_min(0.0).sqrt().sum()
    means = (a.mean(0) - b.mean(0)).square().sum()
    return float((means + cov_a.trace() + cov_b.trace() - 2 * cross).clamp_min(0.0))


def diversity(motions: Float[Tensor, "N d"], draw: torch.Generator) -> float:
    """Mean distance of random pairs of different motions."""
    pairs = PAIRS if len(motions) >= PAIRS else 100
    first = torch.randint(len(motions), (pairs,), generator=draw)
    other = (first + torch.randint(1, len(motions), (pairs,), generator=draw)) % len(motions)
    return float((motions[first] - motions[other]).norm(dim=-1).mean())


def multimodality(motions: Float[Tensor, "P S d"], draw: torch.Generator, pairs: int = 10) -> float:
    """Mean distance of random pairs of different motions of the same prompt: P prompts, S samples each."""
    samples = motions.shape[1]
    first = torch.randint(samples, (len(motions), pairs), generator=draw)
    other = (first + torch.randint(1, samples, first.shape, generator=draw)) % samples
    rows = torch.arange(len(motions))[:, None]
    return float((motions[rows, first] - motions[rows, other]).norm(dim=-1).mean())
