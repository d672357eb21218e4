"""Round trips through a part of what codes a motion, by which it is told where movement is lost."""

from __future__ import annotations

from jaxtyping import Float
from torch import Tensor

from scenectl.data.features import on_body
from scenectl.generators.mscot.bundle import Bundle
from scenectl.generators.mscot.networks.refiner import Refiner
from scenectl.generators.mscot.networks.tokenizer import Tokenizer
from scenectl.generators.mscot.training.principal import components_alone
from scenectl.training.errors import RoundTrip


def round_trips(bundle: Bundle, seen: Float[Tensor, "W T 263"]) -> dict[str, RoundTrip]:
    """Round trips by name: a linear latent of the same size, the latent before it is quantised, tokens by scales.

    Args:
        bundle: the networks.
        seen: raw windows of training, whose principal components the linear latent takes.
    """
    tokenizer = bundle.tokenizer
    scales = tokenizer.quantiser.scales
    # Decoders learn to put bodies on rigid bones; the components get them there.
    components = components_alone(tokenizer, on_body(seen))
    return {
        f"{tokenizer.config.code_dim} principal components": lambda features: components(on_body(features)),
        "continuous latent": lambda features: tokenizer.decode_latent(tokenizer.latent(features)),
        **{f"tokens of {k} scale{'s' * (k > 1)}": after_scales(tokenizer, k) for k in range(1, scales + 1)},
        "all tokens, refined": after_scales(tokenizer, scales, bundle.refiner),
    }


def after_scales(tokenizer: Tokenizer, scales: int, refiner: Refiner | None = None) -> RoundTrip:
    """Features through the tokens of the first scales, with the refiner's residuals if there is one, and back."""
    quantiser = tokenizer.quantiser

    def round_trip(features: Tensor) -> Tensor:
        tokens = tokenizer.encode(features)
        codes = [quantiser.lookup(k, found) for k, found in enumerate(tokens[:scales])]
        finest = tokens[-1].shape[-1]
        if refiner is not None:
            codes = [e + refiner(e, k, finest) for k, e in enumerate(codes)]
        return tokenizer.decode_latent(quantiser.latent(codes, finest))

    return round_trip
