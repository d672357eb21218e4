"""The tokenizer's linear shortcut: principal components, exact where there are enough of them."""

from __future__ import annotations

import pytest
import torch

from scenectl.data.features import POSITIONS, joints_to_features
from scenectl.generators.mscot.config import TokenizerConfig
from scenectl.generators.mscot.networks.tokenizer import Tokenizer
from scenectl.generators.mscot.training.principal import components_alone, start_at_principal_components
from tests.scenectl.small import walk


def started(code_dim: int) -> tuple[Tokenizer, torch.Tensor]:
    torch.manual_seed(0)
    features = torch.stack([joints_to_features(walk(65))] * 8)
    features = features + 0.05 * torch.randn_like(features)
    made = Tokenizer(TokenizerConfig(width=12, code_dim=code_dim, codes=16, shortcut=True))
    made.mean.copy_(features.flatten(0, 1).mean(0))
    made.std.copy_(features.flatten(0, 1).std(0))
    start_at_principal_components(made, features)
    for net in (made.encoder.net, made.decoder.net):  # the shortcut alone
        for parameter in net[-1].parameters():
            parameter.data.zero_()
    return made, features


def lost(code_dim: int) -> float:
    made, features = started(code_dim)
    with torch.no_grad():
        error = (made.decode_latent(made.latent(features)) - features) / made.std
    return float(error[..., : POSITIONS.stop].square().mean().sqrt())


def test_more_components_lose_less_and_enough_of_them_nothing() -> None:
    few, more, all_of_them = lost(8), lost(40), lost(200)
    assert few > more > all_of_them
    assert all_of_them == pytest.approx(0.0, abs=1e-3)  # 8 windows of 16 blocks span 127 dimensions


def test_the_networks_begin_quietly() -> None:
    made, features = started(16)
    torch.manual_seed(0)
    plain = Tokenizer(made.config)
    plain.mean.copy_(made.mean)
    plain.std.copy_(made.std)
    loud = plain.encoder.net(((features - plain.mean) / plain.std).transpose(1, 2)).detach()
    start_at_principal_components(plain, features)
    with torch.no_grad():
        added = plain.latent(features) - made.latent(features)
    assert 0 < float(added.norm()) < 0.02 * float(loud.norm())


def test_components_alone_are_what_the_shortcut_does() -> None:
    made, features = started(16)
    with torch.no_grad():
        shortcut, alone = made.decode_latent(made.latent(features)), components_alone(made, features)(features)
    torch.testing.assert_close(alone, shortcut, atol=1e-4, rtol=1e-4)
    made, features = started(200)  # as many as there are directions
    torch.testing.assert_close(components_alone(made, features)(features), features, atol=1e-3, rtol=1e-3)
