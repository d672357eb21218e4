"""Token refiner: continuous residuals on top of discrete codes (section 3.2)."""

from __future__ import annotations

import torch
from jaxtyping import Float
from torch import Tensor, nn

from scenectl.generators.mscot.config import RefinerConfig
from scenectl.networks.layers import sinusoids


def _attentive(config: RefinerConfig) -> nn.Module:
    """Tokens look at each other."""
    layer = nn.TransformerEncoderLayer(
        config.width, config.heads, 4 * config.width, dropout=0.0, batch_first=True, norm_first=True
    )
    return nn.TransformerEncoder(layer, config.layers, enable_nested_tensor=False)


def _alone(config: RefinerConfig) -> nn.Module:
    """Every token by itself."""
    layers = (nn.Sequential(nn.Linear(config.width, config.width), nn.GELU()) for _ in range(config.layers))
    return nn.Sequential(*layers)


class Refiner(nn.Module):
    """Predicts what quantisation lost at one scale from that scale's own tokens."""

    def __init__(self, config: RefinerConfig, code_dim: int, scales: int) -> None:
        super().__init__()
        self.config = config
        self.inward = nn.Linear(code_dim, config.width)
        self.scale = nn.Parameter(torch.randn(scales, config.width) * 0.02)
        self.encoder = _attentive(config) if config.kind == "transformer" else _alone(config)
        self.outward = nn.Linear(config.width, code_dim)
        # Zero residuals to begin with: an untrained refiner changes nothing.
        nn.init.zeros_(self.outward.weight)
        nn.init.zeros_(self.outward.bias)

    def forward(self, e: Float[Tensor, "B L d"], k: int, finest: int) -> Float[Tensor, "B L d"]:
        """Residual to add to the embeddings of scale k."""
        at = (torch.arange(e.shape[1], device=e.device) + 0.5) * (finest / e.shape[1])
        h = self.inward(e) + self.scale[k] + sinusoids(at, self.config.width)
        out: Tensor = self.outward(self.encoder(h))
        return out
