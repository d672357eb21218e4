"""Products with the decoder's Jacobian, beside torch.func's and autograd's."""

from __future__ import annotations

import pytest
import torch
from torch import Tensor, nn

from scenectl.generators.mscot.config import TokenizerConfig
from scenectl.generators.mscot.networks.tokenizer import Decoder
from scenectl.networks.linearised import LinearisedDecoder

CONFIG = TokenizerConfig(width=12, code_dim=8, codes=16)


def decoder(shortcut: bool = True) -> Decoder:
    torch.manual_seed(3)
    return Decoder(CONFIG.model_copy(update={"shortcut": shortcut})).double()


def latent() -> Tensor:
    return torch.randn(2, 8, 7, dtype=torch.float64, generator=torch.Generator().manual_seed(1))


@pytest.mark.parametrize("channels", [None, 67])
@pytest.mark.parametrize("shortcut", [True, False])
def test_output_and_products_are_autograds(shortcut: bool, channels: int | None) -> None:
    net, z = decoder(shortcut), latent()
    linear = LinearisedDecoder(net, z, channels)
    torch.testing.assert_close(linear.output, net(z)[:, :channels])
    tangents = torch.randn(3, *z.shape, dtype=z.dtype)
    cotangents = torch.randn(4, *linear.output.shape, dtype=z.dtype)
    for tangent, image in zip(tangents, linear.jvp(tangents), strict=True):
        torch.testing.assert_close(image, torch.func.jvp(net, (z,), (tangent,))[1][:, :channels])
    x = z.clone().requires_grad_(True)
    out = net(x)[:, :channels]
    for cotangent, gradient in zip(cotangents, linear.vjp(cotangents), strict=True):
        torch.testing.assert_close(gradient, torch.autograd.grad(out, x, cotangent, retain_graph=True)[0])


def test_products_are_adjoint() -> None:
    linear = LinearisedDecoder(decoder(), latent())
    tangent = torch.randn(1, 2, 8, 7, dtype=torch.float64)
    cotangent = torch.randn(1, *linear.output.shape, dtype=torch.float64)
    left, right = (linear.jvp(tangent) * cotangent).sum(), (tangent * linear.vjp(cotangent)).sum()
    torch.testing.assert_close(left, right)


def test_the_linearisation_is_exact_until_a_unit_switches() -> None:
    net, z = decoder(), latent()
    linear = LinearisedDecoder(net, z)
    small = 1e-9 * torch.randn_like(z)
    torch.testing.assert_close(net(z + small), linear.output + linear.jvp(small[None])[0], rtol=0, atol=1e-12)


def test_modules_that_are_not_understood_are_refused() -> None:
    net = decoder()
    net.net.insert(1, nn.GELU())
    with pytest.raises(TypeError, match="GELU"):
        LinearisedDecoder(net, latent())


def test_rough_products_are_nearly_the_exact_ones() -> None:
    net, z = decoder().float(), latent().float()
    linear = LinearisedDecoder(net, z)
    cotangent = torch.randn(3, *linear.output.shape)
    exact, rough = linear.vjp(cotangent), linear.vjp(cotangent.bfloat16())
    assert rough.dtype is torch.bfloat16
    assert float((rough.float() - exact).norm() / exact.norm()) < 0.02
