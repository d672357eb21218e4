"""Tokens that shall say what is known already: a neighbour's overlap, or the part of a motion that an edit keeps."""

from __future__ import annotations

from jaxtyping import Float
from torch import Tensor

from scenectl.models.tokenizer import Quantiser


def share_at(quantiser: Quantiser, k: int, share: Float[Tensor, "*b n"]) -> Float[Tensor, "*b L_k"]:
    """A weight over the finest scale's tokens, interpolated to scale k as the residuals are."""
    length = quantiser.lengths(share.shape[-1])[k]
    flat: Tensor = quantiser.down(share.reshape(-1, 1, share.shape[-1]), length)
    return flat.reshape(*share.shape[:-1], length)


def closeness(
    quantiser: Quantiser, k: int, rest: Float[Tensor, "B d n"], share: Float[Tensor, "B n"]
) -> Float[Tensor, "B L_k V"]:
    """Log-likelihood of every code of scale k, up to a constant, where part of the latent is known.

    The known part is seen through Gaussian noise as large as the scale's codes: minus half of
    ``m |u - c|^2 / mean |c|^2`` for code c, where m is the interpolated share and u what the scale is to add. The
    code that comes first is the one that quantisation would take (Eq. 34); nothing known is 0 for all.

    Args:
        quantiser: of the model.
        k: the scale, from 0.
        rest: what the coarser scales lack of the known latent, times `share`.
        share: how much is known of each token of the finest scale, 0 to 1.
    """
    codes = quantiser.codes(k)
    lengths = quantiser.lengths(rest.shape[-1])
    wanted: Tensor = quantiser.down(rest, lengths[k]).transpose(1, 2)
    size = codes.square().sum(-1)
    weighted = share_at(quantiser, k, share)[..., None] * size
    return (wanted @ codes.T - weighted / 2) / size.mean()
