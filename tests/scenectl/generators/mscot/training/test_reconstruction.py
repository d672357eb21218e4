"""Tokens that are misread on purpose: a share of them, in half of the windows, by the nearest codes alone."""

from __future__ import annotations

import torch

from scenectl.generators.mscot.training.reconstruction import NEAREST, _misread, _neighbours


def test_misread_tokens_are_neighbours() -> None:
    draw = torch.Generator().manual_seed(0)
    codes = torch.randn(64, 8, generator=draw)
    near = _neighbours(codes)
    assert near.shape == (64, NEAREST) and not (near == torch.arange(64)[:, None]).any()
    distances = torch.cdist(codes, codes)
    for code in range(64):
        rest = [other for other in range(64) if other != code and other not in near[code]]
        assert distances[code, near[code]].max() <= distances[code, rest].min()
    tokens = torch.randint(64, (40, 50), generator=draw)
    read = _misread(tokens, near, 0.25, draw)
    wrong = read != tokens
    assert not wrong[::2].any()
    assert abs(float(wrong[1::2].float().mean()) - 0.25) < 0.04
    assert all(read[i, j] in near[tokens[i, j]] for i, j in wrong.nonzero().tolist())


def test_few_codes_have_few_neighbours() -> None:
    assert _neighbours(torch.eye(3)).shape == (3, 2)
