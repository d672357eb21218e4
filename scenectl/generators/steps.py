"""Steps that can be guided: by a function alone, or through a decoder whose linearisation is known."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import cached_property

import torch
from jaxtyping import Float
from torch import Tensor

from scenectl.data.features import POSITIONS
from scenectl.generators.mscot.networks.tokenizer import Tokenizer
from scenectl.networks.linearised import LinearisedDecoder
from scenes.motion.motion import Motion

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
        rough: precision of many gradients at once, which solvers use as a model only; by default the value's own.
        records: of the affine map, by the number of gradients of all samples and whether they are rough;
            kept from value to value.
    """

    value: Float[Tensor, "S *v"]
    tokenizer: Tokenizer
    latent: Callable[[Tensor], Tensor]
    place: Callable[[Tensor], Motion]
    rough: torch.dtype | None = None
    records: dict[tuple[int, bool], tuple[Tensor, Tensor]] = field(default_factory=dict, compare=False, repr=False)

    def decode(self, value: Float[Tensor, "S *v"]) -> Motion:
        return self.place(self.tokenizer.decode_latent(self.latent(value)))

    def at(self, value: Float[Tensor, "S *v"]) -> LatentStep:
        return replace(self, value=value)

    @cached_property
    @torch.no_grad()
    def motion(self) -> Motion:
        """The step's own value, decoded."""
        return self.place(self._features)

    def jvp(self, tangent: Float[Tensor, "S *v"]) -> Float[Tensor, "S T J 3"]:
        moved = self.latent(tangent) - self.latent(torch.zeros_like(tangent))
        features = self._decoder.jvp(moved[None])[0].transpose(1, 2) * self.tokenizer.std[:_READ]
        dummy, pulled = self._pullback
        (joints,) = torch.autograd.grad(pulled, dummy, features, retain_graph=True)
        return joints

    def vjp(self, cotangent: Float[Tensor, "S T J 3"]) -> Float[Tensor, "S *v"]:
        return self._vjps(cotangent[None], self.value.dtype)[0]

    def vjps(self, cotangents: Float[Tensor, "R S T J 3"]) -> Float[Tensor, "R S *v"]:
        return self._vjps(cotangents, self.rough or self.value.dtype)

    def _vjps(self, cotangents: Float[Tensor, "R S T J 3"], precision: torch.dtype) -> Float[Tensor, "R S *v"]:
        count = len(cotangents)  # as so many motions, not by vmap, whose first use takes seconds to import
        features = self._features.repeat(count, 1, 1).requires_grad_(True)
        with torch.enable_grad():
            joints = self.place(features).joints
        (rows,) = torch.autograd.grad(joints, features, cotangents.flatten(0, 1))
        normal = (rows * self.tokenizer.std[:_READ]).unflatten(0, (count, -1)).transpose(-1, -2)
        return self._pulled_back(self._decoder.vjp(normal.to(precision)), precision)

    def _pulled_back(self, latent: Float[Tensor, "R S d L"], precision: torch.dtype) -> Float[Tensor, "R S *v"]:
        """The adjoint of the affine map's linear part, of all R at once; autograd's record of it serves every value."""
        count, rough = len(latent) * len(self.value), precision is not self.value.dtype
        if (count, rough) not in self.records:
            value = self.value.new_zeros(count, *self.value.shape[1:]).requires_grad_(True)
            with torch.enable_grad(), torch.autocast(value.device.type, torch.bfloat16, enabled=rough):
                self.records[count, rough] = value, self.latent(value)
        value, image = self.records[count, rough]
        (gradient,) = torch.autograd.grad(image, value, latent.flatten(0, 1).to(image), retain_graph=True)
        return gradient.unflatten(0, (len(latent), -1))

    @cached_property
    def _decoder(self) -> LinearisedDecoder:
        with torch.no_grad():
            return LinearisedDecoder(self.tokenizer.decoder.net, self.latent(self.value), _READ)

    @cached_property
    def _features(self) -> Float[Tensor, "S T c"]:
        return self._decoder.output.transpose(1, 2) * self.tokenizer.std[:_READ] + self.tokenizer.mean[:_READ]

    @cached_property
    def _pullback(self) -> tuple[Tensor, Tensor]:
        """A gradient in the joints and the features' for it, linear in it: differentiating that leads forward."""
        features = self._features.detach().requires_grad_(True)
        with torch.enable_grad():
            joints = self.place(features).joints
            dummy = torch.zeros_like(joints).requires_grad_(True)
            (pulled,) = torch.autograd.grad(joints, features, dummy, create_graph=True)
        return dummy, pulled
