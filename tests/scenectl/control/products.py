"""What the products of any step must be."""

from __future__ import annotations

import torch

from scenectl.generators.base import Step


def assert_derivatives_and_adjoint(s: Step) -> None:
    """Its motion is that of its value, its jvp the decoder's derivative, its vjps the adjoint of that."""
    assert isinstance(s, Step)
    torch.testing.assert_close(s.motion.joints, s.decode(s.value).joints)
    tangent, h = torch.randn_like(s.value), 1e-6
    numeric = (s.decode(s.value + h * tangent).joints - s.decode(s.value - h * tangent).joints) / (2 * h)
    torch.testing.assert_close(s.jvp(tangent), numeric, rtol=1e-5, atol=1e-6)
    cotangents = torch.randn(3, *numeric.shape, dtype=numeric.dtype)
    rows = s.vjps(cotangents)
    torch.testing.assert_close(rows[1], s.vjp(cotangents[1]))
    ahead = (cotangents * s.jvp(tangent)).flatten(2).sum(2)
    torch.testing.assert_close((rows * tangent).flatten(2).sum(2), ahead)
