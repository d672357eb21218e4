"""Steps that can be guided: by a function alone, or through a decoder whose linearisation is known.

What either decodes to goes through `scenes.motion.rigid`, so that goals only ever see bodies with rigid bones.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Protocol, runtime_checkable

import torch
from jaxtyping import Float, Int
from torch import Tensor, nn

from scenectl.generators.base import Price, Step
from scenectl.networks.linearised import LinearisedDecoder
from scenes.motion.motion import Motion
from scenes.motion.rigid import rigid

AUTOGRAD = Price(product=1.3, row=0.5)
"""Products through autograd's record: a jvp of 1.4 to 2 passes, a vjp of 1, rows one by one but of one record.

Measured by `scenectl bench prices --threads 1` (row "refined, by autograd").
"""

LINEARISED = Price(product=0.6, row=0.15)
"""Products of a linearised decoder, of which many go through in one batch: a jvp of 0.5 to 0.75, a vjp of 0.4 to 0.6.

Measured by `scenectl bench prices --threads 1` (rows "guided" and "refined").
"""


class AroundStep:
    """A step made of another one, whose products cost what that one's do and whose values have its scale."""

    inner: Step

    @property
    def price(self) -> Price:
        return self.inner.price

    @property
    def unit(self) -> float:
        return self.inner.unit


@dataclass(frozen=True)
class MappedStep(AroundStep):
    """A step whose motion goes through a further map of joints, sample by sample: another body's bones, rising ground.

    Attributes:
        inner: the step as its generator made it.
        mapped: differentiable, of motions of any number of samples.
    """

    inner: Step
    mapped: Callable[[Motion], Motion]

    @property
    def value(self) -> Float[Tensor, "S *v"]:
        return self.inner.value

    def decode(self, value: Float[Tensor, "S *v"]) -> Motion:
        return self.mapped(self.inner.decode(value))

    def at(self, value: Float[Tensor, "S *v"]) -> MappedStep:
        return replace(self, inner=self.inner.at(value))

    def take(self, samples: Int[Tensor, " s"]) -> MappedStep:
        return replace(self, inner=self.inner.take(samples))

    @cached_property
    def motion(self) -> Motion:
        with torch.no_grad():
            return self.mapped(self.inner.motion)

    def jvp(self, tangent: Float[Tensor, "S *v"]) -> Float[Tensor, "S T J 3"]:
        dummy, pulled = self._pullback
        (joints,) = torch.autograd.grad(pulled, dummy, self.inner.jvp(tangent), retain_graph=True)
        return joints

    def vjp(self, cotangent: Float[Tensor, "S T J 3"]) -> Float[Tensor, "S *v"]:
        return self.inner.vjp(self._pulled(cotangent[None])[0])

    def vjps(self, cotangents: Float[Tensor, "R S T J 3"]) -> Float[Tensor, "R S *v"]:
        return self.inner.vjps(self._pulled(cotangents))

    def _joints(self, joints: Float[Tensor, "*b T J 3"]) -> Float[Tensor, "*b T J 3"]:
        before = self.inner.motion
        return self.mapped(Motion(joints, fps=before.fps, t0=before.t0, skeleton=before.skeleton)).joints

    def _pulled(self, cotangents: Float[Tensor, "R S T J 3"]) -> Float[Tensor, "R S T J 3"]:
        """Gradients in the joints before the map."""
        joints = self.inner.motion.joints.expand(cotangents.shape).detach().requires_grad_(True)
        with torch.enable_grad():
            after = self._joints(joints)
        return torch.autograd.grad(after, joints, cotangents)[0]

    @cached_property
    def _pullback(self) -> tuple[Tensor, Tensor]:
        return pullback(self._joints, self.inner.motion.joints)


@dataclass(frozen=True)
class DecodedStep:
    """A `Step` given by its value and a differentiable decoder; the products come from autograd.

    Attributes:
        value: what the generator believes.
        decoder: from values to motions in the world.
        price, unit: see `Step`.
    """

    value: Float[Tensor, "S *v"]
    decoder: Callable[[Tensor], Motion]
    price: Price = AUTOGRAD
    unit: float = 1.0

    def decode(self, value: Float[Tensor, "S *v"]) -> Motion:
        return rigid(self.decoder(value))

    def at(self, value: Float[Tensor, "S *v"]) -> DecodedStep:
        return replace(self, value=value)

    def take(self, samples: Int[Tensor, " s"]) -> DecodedStep:
        return self.at(self.value[samples])

    @property
    @torch.no_grad()
    def motion(self) -> Motion:
        return self.decode(self.value)

    @property
    @torch.no_grad()
    def loose(self) -> Motion:
        """The step's own value before its bones are made rigid."""
        return self.decoder(self.value)

    def jvp(self, tangent: Float[Tensor, "S *v"]) -> Float[Tensor, "S T J 3"]:
        try:
            out: Tensor = torch.func.jvp(lambda v: self.decode(v).joints, (self.value,), (tangent,))[1]
        except (NotImplementedError, RuntimeError):  # an operation without a forward mode
            dummy, pulled = pullback(lambda v: self.decode(v).joints, self.value)
            (out,) = torch.autograd.grad(pulled, dummy, tangent)
        return out

    def vjp(self, cotangent: Float[Tensor, "S T J 3"]) -> Float[Tensor, "S *v"]:
        return self.vjps(cotangent[None])[0]

    def vjps(self, cotangents: Float[Tensor, "R S T J 3"]) -> Float[Tensor, "R S *v"]:
        value = self.value.detach().requires_grad_(True)
        with torch.enable_grad():
            joints = self.decode(value).joints
        rows = [torch.autograd.grad(joints, value, each, retain_graph=True)[0] for each in cotangents]
        return torch.stack(rows)


@runtime_checkable
class Sampled(Protocol):
    """What differs between samples, and can be had of some."""

    def __call__(self, features: Tensor) -> Motion: ...

    def take(self, samples: Int[Tensor, " s"]) -> Callable[[Tensor], Motion]:
        """The same of some samples."""


@dataclass(frozen=True)
class LatentStep:
    """A `Step` whose value leads to a latent by an affine map, and through a piecewise linear decoder to joints.

    Attributes:
        value: embeddings of one or of all scales.
        decoder: piecewise linear, from latents ``[S, d, L]`` to normalised features ``[S, c, T]``.
        scale, offset: of the first n features, those that `place` reads, ``[n]``.
        latent: affine map from values to latents.
        place: motion in the world, of features ``[S, T, n]``; with a `take`, as steps have, where it differs
            between samples.
        rough: precision of many gradients at once, which solvers use as a model only; by default the value's own.
        price, unit: see `Step`.
        records: of the affine map, by the number of gradients of all samples and whether they are rough;
            kept from value to value.
    """

    value: Float[Tensor, "S *v"]
    decoder: nn.Module
    scale: Float[Tensor, " n"]
    offset: Float[Tensor, " n"]
    latent: Callable[[Tensor], Tensor]
    place: Callable[[Tensor], Motion]
    rough: torch.dtype | None = None
    price: Price = LINEARISED
    unit: float = 1.0
    records: dict[tuple[int, bool], tuple[Tensor, Tensor]] = field(default_factory=dict, compare=False, repr=False)

    def decode(self, value: Float[Tensor, "S *v"]) -> Motion:
        return self._body(self._raw(self.decoder(self.latent(value))[:, : len(self.scale)]))

    def at(self, value: Float[Tensor, "S *v"]) -> LatentStep:
        return replace(self, value=value)

    def take(self, samples: Int[Tensor, " s"]) -> LatentStep:
        place = self.place.take(samples) if isinstance(self.place, Sampled) else self.place
        return replace(self, value=self.value[samples], place=place)

    @cached_property
    @torch.no_grad()
    def motion(self) -> Motion:
        """The step's own value, decoded."""
        return rigid(self.loose)

    @property
    @torch.no_grad()
    def loose(self) -> Motion:
        """The same before its bones are made rigid."""
        return self.place(self._features)

    def jvp(self, tangent: Float[Tensor, "S *v"]) -> Float[Tensor, "S T J 3"]:
        moved = self.latent(tangent) - self.latent(torch.zeros_like(tangent))
        features = self._linearised.jvp(moved[None])[0].transpose(1, 2) * self.scale
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
            joints = self._body(features).joints
        (rows,) = torch.autograd.grad(joints, features, cotangents.flatten(0, 1))
        normal = (rows * self.scale).unflatten(0, (count, -1)).transpose(-1, -2)
        return self._pulled_back(self._linearised.vjp(normal.to(precision)), precision)

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

    def _body(self, features: Float[Tensor, "S T n"]) -> Motion:
        return rigid(self.place(features))

    def _raw(self, normalised: Float[Tensor, "S n T"]) -> Float[Tensor, "S T n"]:
        return normalised.transpose(1, 2) * self.scale + self.offset

    @cached_property
    def _linearised(self) -> LinearisedDecoder:
        with torch.no_grad():
            return LinearisedDecoder(self.decoder, self.latent(self.value), len(self.scale))

    @cached_property
    def _features(self) -> Float[Tensor, "S T n"]:
        return self._raw(self._linearised.output)

    @cached_property
    def _pullback(self) -> tuple[Tensor, Tensor]:
        return pullback(lambda features: self._body(features).joints, self._features)


def pullback(function: Callable[[Tensor], Tensor], at: Tensor) -> tuple[Tensor, Tensor]:
    """A cotangent of a function's output and its gradient in the input, which is linear in it.

    Differentiating the gradient in the cotangent leads forward: J itself, by two backward passes.
    """
    x = at.detach().requires_grad_(True)
    with torch.enable_grad():
        out = function(x)
        dummy = torch.zeros_like(out).requires_grad_(True)
        (pulled,) = torch.autograd.grad(out, x, dummy, create_graph=True)
    return dummy, pulled
