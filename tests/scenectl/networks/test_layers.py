"""Layers that networks share."""

from __future__ import annotations

import torch

from scenectl.networks.layers import Dropout


def test_dropout_zeroes_its_share_and_keeps_the_mean() -> None:
    torch.manual_seed(0)
    layer, x = Dropout(0.1), torch.ones(100, 1003)
    y = layer(x)
    kept = y != 0
    assert abs(float((~kept).float().mean()) - 0.1) < 0.005 and abs(float(y.mean()) - 1) < 0.005
    assert len(y[kept].unique()) == 1
    by_column = (~kept).float().mean(0)
    assert by_column.max() < 0.3 and abs(float(by_column.view(17, 59).mean(0).std())) < 0.02  # every byte of a draw
    assert torch.equal(layer.eval()(x), x) and torch.equal(Dropout(0.0)(x), x)
    torch.manual_seed(0)
    assert torch.equal(layer.train()(x), y)


def test_what_dropout_zeroes_has_no_gradient() -> None:
    x = torch.ones(64, requires_grad=True)
    y = Dropout(0.5)(x)
    y.sum().backward()
    assert x.grad is not None and torch.equal(x.grad, y.detach())
