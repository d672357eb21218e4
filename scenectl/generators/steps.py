"""A step as a function: what any generator needs to offer its beliefs for guidance."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import torch
from jaxtyping import Float
from torch import Tensor

from scenes.motion import Motion


@dataclass(frozen=True)
class DecodedStep:
    """A `Step` given by its value and a differentiable decoder; the products come from autograd."""

    value: Float[Tensor, "S *v"]
    decoder: Callable[[Tensor], Motion]

    def decode(self, value: Float[Tensor, "S *v"]) -> Motion:
        return self.decoder(value)

    def jvp(self, tangent: Float[Tensor, "S *v"]) -> Float[Tensor, "S T J 3"]:
        out: Tensor = torch.func.jvp(lambda v: self.decoder(v).joints, (self.value,), (tangent,))[1]
        return out

    def vjp(self, cotangent: Float[Tensor, "S T J 3"]) -> Float[Tensor, "S *v"]:
        value = self.value.detach().requires_grad_(True)
        with torch.enable_grad():
            joints = self.decoder(value).joints
        (gradient,) = torch.autograd.grad(joints, value, cotangent)
        return gradient
