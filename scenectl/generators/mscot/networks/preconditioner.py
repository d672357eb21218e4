"""Coordinates of embeddings in which equal steps are about equally much motion."""

from __future__ import annotations

import torch
from jaxtyping import Float
from torch import Tensor, nn


class Preconditioner(nn.Module):
    """What a decoder makes of a change of each scale's embeddings, averaged over motions and positions.

    With G_k the mean of J_k^T J_k, where J_k leads from e_k to joints and their accelerations, refinement looks for u
    in e_k = u root_k, with root_k = (G_k / mean eigenvalue of all scales + 1)^(-1/2). The least change is then the one
    that moves the body least and most smoothly, and least squares are better conditioned.
    `scenectl.generators.mscot.training.preconditioner` measures it.

    Attributes:
        root: of each scale, symmetric, ``[K, d, d]``; the identity until it has been measured.
    """

    root: Tensor

    def __init__(self, dim: int, scales: int) -> None:
        """For embeddings of `dim` numbers at so many scales."""
        super().__init__()
        self.register_buffer("root", torch.eye(dim).repeat(scales, 1, 1))

    @torch.no_grad()
    def adopt(self, energy: Float[Tensor, "K d d"]) -> None:
        """Take over measured G_k."""
        scales, dim = energy.shape[:2]
        mean = torch.einsum("kii->", energy) / (scales * dim)
        values, vectors = torch.linalg.eigh(energy / mean + torch.eye(dim).to(energy))
        self.root.copy_(vectors @ torch.diag_embed(values.clamp_min(1.0).rsqrt()) @ vectors.mT)

    def embeddings(self, coordinates: list[Float[Tensor, "S _L_k d"]]) -> list[Float[Tensor, "S _L_k d"]]:
        """Embeddings of all scales for these coordinates; linear."""
        return [u @ root.to(u) for u, root in zip(coordinates, self.root, strict=True)]

    def coordinates(self, embeddings: list[Float[Tensor, "S _L_k d"]]) -> list[Float[Tensor, "S _L_k d"]]:
        """The inverse of `embeddings`."""
        return [torch.linalg.solve(root.to(e), e, left=False) for e, root in zip(embeddings, self.root, strict=True)]
