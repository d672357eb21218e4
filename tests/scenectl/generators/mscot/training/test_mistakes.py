"""Tokens misread on purpose: by near codes alone, as often as is said, and with later scales read of what is left."""

from __future__ import annotations

import pytest
import torch

from scenectl.generators.mscot.config import TokenizerConfig
from scenectl.generators.mscot.networks.tokenizer import Quantiser
from scenectl.generators.mscot.training.mistakes import NEAREST, Reader, neighbours

FINEST = 16


@pytest.fixture
def quantiser() -> Quantiser:
    torch.manual_seed(0)
    made = Quantiser(TokenizerConfig(width=8, code_dim=8, codes=64, scales=(1, 2, 4, 8, 16, 16, 16)))
    made.initialise(torch.randn(64, 8, FINEST))
    return made.requires_grad_(False)


def test_wrong_tokens_are_neighbours_and_as_many_as_a_window_is_told(quantiser: Quantiser) -> None:
    latent, draw = torch.randn(400, 8, FINEST), torch.Generator().manual_seed(0)
    reading = Reader(quantiser, 0.6)(latent, draw)
    shares = torch.cat([s != r for s, r in zip(reading.seen, reading.right, strict=True)], 1).float().mean(1)
    assert float(shares.mean()) == pytest.approx(0.3, abs=0.02)
    assert float(shares.min()) < 0.1 and 0.5 < float(shares.max()) < 0.8  # even over windows, not the same for all
    for k, (seen, right) in enumerate(zip(reading.seen, reading.right, strict=True)):
        near = neighbours(quantiser.codes(k))
        wrong = seen != right
        assert (near[right[wrong]] == seen[wrong][:, None]).any(1).all()


def test_every_scale_is_read_of_what_the_tokens_seen_before_leave(quantiser: Quantiser) -> None:
    latent = torch.randn(20, 8, FINEST)
    reading = Reader(quantiser, 1.0)(latent, torch.Generator().manual_seed(0))
    for k, right in enumerate(reading.right):
        parts = [quantiser.up(i, quantiser.lookup(i, t), FINEST) for i, t in enumerate(reading.seen[:k])]
        rest = latent - sum(parts, torch.zeros_like(latent))
        assert torch.equal(right, quantiser.nearest(k, quantiser.down(rest, right.shape[1])))


def test_mistakes_that_are_put_right_leave_less_than_the_same_without(quantiser: Quantiser) -> None:
    latent = torch.randn(100, 8, FINEST)
    reading = Reader(quantiser, 0.6)(latent, torch.Generator().manual_seed(0))
    right = quantiser.encode(latent)
    wrong = [torch.where(s != r, s, t) for s, r, t in zip(reading.seen, reading.right, right, strict=True)]

    def rest(tokens: list[torch.Tensor]) -> float:
        codes = [quantiser.lookup(k, t) for k, t in enumerate(tokens)]
        return float((quantiser.latent(codes, FINEST) - latent).norm())

    assert rest(right) < rest(reading.seen) < rest(wrong)


def test_a_reader_that_makes_no_mistakes_encodes(quantiser: Quantiser) -> None:
    latent = torch.randn(5, 8, FINEST)
    reading = Reader(quantiser, 0.0)(latent, torch.Generator())
    assert all(map(torch.equal, reading.seen, quantiser.encode(latent)))
    assert all(map(torch.equal, reading.right, reading.seen))


def test_neighbours_are_the_nearest_others() -> None:
    codes = torch.randn(64, 8, generator=torch.Generator().manual_seed(0))
    near, distances = neighbours(codes), torch.cdist(codes, codes)
    assert near.shape == (64, NEAREST) and not (near == torch.arange(64)[:, None]).any()
    for code in range(64):
        others = [other for other in range(64) if other != code and other not in near[code]]
        assert distances[code, near[code]].max() <= distances[code, others].min()
    assert neighbours(torch.eye(3)).shape == (3, 2)
