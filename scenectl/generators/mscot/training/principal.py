"""A tokenizer's linear shortcut at its best start: the principal components of what a latent stands for."""

from __future__ import annotations

from typing import NamedTuple

import torch
from jaxtyping import Float
from torch import Tensor, nn

from scenectl.data.features import FEATURES, POSITIONS, ROOT_VELOCITY, YAW
from scenectl.generators.mscot.networks.tokenizer import Tokenizer
from scenectl.generators.mscot.schedule import DOWNSAMPLING
from scenectl.networks.layers import Frames
from scenectl.training.errors import RoundTrip

UNREAD = 0.15
"""Weight of features that no joint is recovered from (rotations, velocities, contacts) beside those that are."""
TURNS, STEPS = 2.0, 3.0
"""Weights of yaw and root velocity, whose errors add up over a motion."""
_QUIET = 0.01
"""What is left of the networks' last layers, so that they hardly add to the shortcut when training begins."""


class Components(NamedTuple):
    """A linear code of four frames of normalised features, N numbers, and the way back.

    Attributes:
        analysis: ``[d, N]``.
        synthesis: ``[N, d]``.
        mean: of what is analysed.
    """

    analysis: Float[Tensor, "d N"]
    synthesis: Float[Tensor, "N d"]
    mean: Float[Tensor, " N"]


@torch.no_grad()
def principal_components(model: Tokenizer, features: Float[Tensor, "B T 263"]) -> Components:
    """The principal components of raw windows, as many as a code has dimensions; T a multiple of four."""
    weight = _weights().to(features).repeat(DOWNSAMPLING)
    blocks = _blocks(model, features).flatten(0, 1)
    mean = blocks.mean(0)
    scaled = (blocks - mean) * weight
    _, vectors = torch.linalg.eigh((scaled.T @ scaled / len(scaled)).double())
    components = vectors.flip(1)[:, : model.config.code_dim].T.to(features)
    return Components(components * weight, (components / weight).T, mean)


def components_alone(model: Tokenizer, features: Float[Tensor, "B T 263"]) -> RoundTrip:
    """Features through the principal components of raw windows and back: what a linear latent of that size can do."""
    analysis, synthesis, mean = principal_components(model, features)

    def round_trip(features: Tensor) -> Tensor:
        blocks = (_blocks(model, features) - mean) @ analysis.T @ synthesis.T + mean
        return blocks.unflatten(-1, (DOWNSAMPLING, FEATURES)).flatten(1, 2) * model.std + model.mean

    return round_trip


@torch.no_grad()
def start_at_principal_components(model: Tokenizer, features: Float[Tensor, "B T 263"]) -> None:
    """Set the shortcuts to the principal components of four frames, and let everything beside them begin quietly.

    With 128 components, joints about the pelvis come back to 4 mm (Bandai) and 11 mm (other sources) before any
    training (`scenectl bench tokenizer`).

    Args:
        model: with the statistics of its features set; its configuration has a shortcut.
        features: raw windows, T a multiple of four.
    """
    components = principal_components(model, features)
    inward, outward = model.encoder.linear, model.decoder.linear
    assert isinstance(inward, nn.Conv1d) and isinstance(outward, Frames) and inward.bias is not None
    inward.weight.copy_(components.analysis.unflatten(1, (DOWNSAMPLING, FEATURES)).transpose(1, 2))
    inward.bias.copy_(-components.analysis @ components.mean)
    outward.linear.weight.copy_(components.synthesis[..., None])
    assert outward.linear.bias is not None
    outward.linear.bias.copy_(components.mean)
    for net in (model.encoder.net, model.decoder.net):
        for parameter in net[-1].parameters():
            parameter.mul_(_QUIET)
    for conv in model.quantiser.convs:
        assert isinstance(conv, nn.Conv1d) and conv.bias is not None
        nn.init.dirac_(conv.weight)
        nn.init.zeros_(conv.bias)


def _blocks(model: Tokenizer, features: Float[Tensor, "B T 263"]) -> Float[Tensor, "B L N"]:
    """Normalised, four frames after one another in a row."""
    return ((features - model.mean) / model.std).unflatten(1, (-1, DOWNSAMPLING)).flatten(2)


def _weights() -> Float[Tensor, "263"]:
    weight = torch.full((FEATURES,), UNREAD)
    weight[: POSITIONS.stop] = 1.0
    weight[YAW], weight[ROOT_VELOCITY] = TURNS, STEPS
    return weight
