"""Steps that can be guided: by a function alone, or through a decoder whose linearisation is known."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property

import torch
from jaxtyping import Float
from torch import Tensor

from scenectl.data.features import POSITIONS
from scenectl.models.linearised import LinearisedDecoder
from scenectl.models.tokenizer import Tokenizer
from scenes.motion import Motion

_READ = POSITIONS.stop
"""Features from which joints are recovered: the first so many."""


@dataclass(frozen=True)
class DecodedStep:
    """A `Step` given by its value and a differentiable decoder; the products come from autograd."""

    value: Float[Tensor, "S *v"]
    decoder: Callable[[Tensor], Motion]

    def decode(self, value: Float[Tensor, "S *v"]) -> Motion:
        return self.decoder(value)

    def at(self, value: Float[Tensor, "S *v"]) -> DecodedStep:
        return replace(self, value=value)

    @property
    @torch.no_grad()
    def motion(self) -> Motion:
        return self.decoder(self.value)

    def jvp(self, tangent: Float[Tensor, "S *v"]) -> Float[Tensor, "S T J 3"]:
        out: Tensor = torch.func.jvp(lambda v: self.decoder(v).joints, (self.value,), (tangent,))[1]
        return out

    def vjp(self, cotangent: Float[Tensor, "S T J 3"]) -> Float[Tensor, "S *v"]:
        return self.vjps(cotangent[None])[0]

    def vjps(self, cotangents: Float[Tensor, "R S T J 3"]) -> Float[Tensor, "R S *v"]:
        value = self.value.detach().requires_grad_(True)
        with torch.enable_grad():
            joints = self.decoder(value).joints
        rows = [torch.autograd.grad(joints, value, each, retain_graph=True)[0] for each in cotangents]
        return torch.stack(rows)


@dataclass(frozen=True)
class LatentStep:
    """A `Step` whose value leads to a tokenizer's latent by an affine map, and from there to joints.

    Attributes:
        value: embeddings of one or of all scales.
        tokenizer: whose decoder it is.
        latent: affine map from values to latents ``[S, d, L]``.
        place: joints in the world, of the features ``[S, T, c]`` of 4 L frames.
    """

    value: Float[Tensor, "S *v"]
    tokenizer: Tokenizer
    latent: Callable[[Tensor], Tensor]
    place: Callable[[Tensor], Motion]

    def decode(self, value: Float[Tensor, "S *v"]) -> Motion:
        return self.place(self.tokenizer.decode_latent(self.latent(value)))

    def at(self, value: Float[Tensor, "S *v"]) -> LatentStep:
        return replace(self, value=value)

    @cached_property
    def motion(self) -> Motion:
        """The step's own value, decoded."""
        return replace(self._joints[1], joints=self._joints[1].joints.detach())

    def jvp(self, tangent: Float[Tensor, "S *v"]) -> Float[Tensor, "S T J 3"]:
        moved = self.latent(tangent) - self.latent(torch.zeros_like(tangent))
        features = self._decoder.jvp(moved[None])[0].transpose(1, 2) * self.tokenizer.std[:_READ]
        out: Tensor = torch.func.jvp(lambda f: self.place(f).joints, (self._features,), (features,))[1]
        return out

    def vjp(self, cotangent: Float[Tensor, "S T J 3"]) -> Float[Tensor, "S *v"]:
        return self.vjps(cotangent[None])[0]

    def vjps(self, cotangents: Float[Tensor, "R S T J 3"]) -> Float[Tensor, "R S *v"]:
        features, motion = self._joints
        rows = [torch.autograd.grad(motion.joints, features, each, retain_graph=True)[0] for each in cotangents]
        normal = (torch.stack(rows) * self.tokenizer.std[:_READ]).transpose(-1, -2)
        return self._pulled_back(self._decoder.vjp(normal))

    def _pulled_back(self, latent: Float[Tensor, "R S d L"]) -> Float[Tensor, "R S *v"]:
        """The adjoint of the affine map's linear part, of all R at once."""
        count = len(latent)
        value = self.value.new_zeros(count * len(self.value), *self.value.shape[1:]).requires_grad_(True)
        with torch.enable_grad():
            image = self.latent(value)
        (gradient,) = torch.autograd.grad(image, value, latent.flatten(0, 1))
        return gradient.unflatten(0, (count, -1))

    @cached_property
    def _decoder(self) -> LinearisedDecoder:
        with torch.no_grad():
            return LinearisedDecoder(self.tokenizer.decoder, self.latent(self.value), _READ)

    @cached_property
    def _features(self) -> Float[Tensor, "S T c"]:
        return self._decoder.output.transpose(1, 2) * self.tokenizer.std[:_READ] + self.tokenizer.mean[:_READ]

    @cached_property
    def _joints(self) -> tuple[Tensor, Motion]:
        """Features, and the motion that autograd knows to be made of them."""
        features = self._features.detach().requires_grad_(True)
        with torch.enable_grad():
            return features, self.place(features)
