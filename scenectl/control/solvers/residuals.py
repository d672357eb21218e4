"""An objective as least squares in a step's value: rows, and products with their Jacobian."""

from __future__ import annotations

from dataclasses import replace
from functools import cached_property
from typing import Protocol, runtime_checkable

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from objectives import Assessed, Context
from scenectl.generators.base import Step
from scenes.motion.motion import Motion


@runtime_checkable
class Assessable(Protocol):
    """What an objective and all that stands in for one can be asked."""

    def assess(self, motion: Motion, context: Context) -> Assessed: ...


class Residuals:
    """Rows of an objective at one value of a step (a `Linearisation`).

    Goals are differentiated in the joints, by autograd; from there on the step's own products lead to its value.
    """

    def __init__(self, objective: Assessable, context: Context, step: Step) -> None:
        self._step, self._shape = step, step.value.shape
        motion = step.motion
        self._joints = motion.joints.detach().requires_grad_(True)
        seen = replace(motion, joints=self._joints)
        with torch.enable_grad():
            found = objective.assess(seen, context)
            self._rows = torch.cat([block.flatten(1) for block in found.rows], dim=1)
        self.rows, self.cost, self.met = self._rows.detach(), found.cost, found.met

    def vjp(self, cotangent: Float[Tensor, "S R"]) -> Float[Tensor, "S n"]:
        return self._step.vjp(self._joint_gradient(cotangent)).flatten(1)

    def jvp(self, tangent: Float[Tensor, "S n"]) -> Float[Tensor, "S R"]:
        joints = self._step.jvp(tangent.unflatten(1, self._shape[1:]))
        dummy, pulled = self._pullback
        (rows,) = torch.autograd.grad(pulled, dummy, joints, retain_graph=True)
        return rows

    def jacobian(self, rows: Bool[Tensor, " R"]) -> Float[Tensor, "S r n"]:
        chosen = rows.nonzero()[:, 0].tolist()
        if not chosen:
            return self.rows.new_zeros(len(self.rows), 0, self._shape[1:].numel())
        cotangents = []
        for i in chosen:
            cotangent = torch.zeros_like(self.rows)
            cotangent[:, i] = 1.0
            cotangents.append(self._joint_gradient(cotangent))
        return self._step.vjps(torch.stack(cotangents)).flatten(2).transpose(0, 1)

    def _joint_gradient(self, cotangent: Tensor) -> Tensor:
        (gradient,) = torch.autograd.grad(self._rows, self._joints, cotangent, retain_graph=True)
        return torch.nan_to_num(gradient, 0.0, 0.0, 0.0)

    @cached_property
    def _pullback(self) -> tuple[Tensor, Tensor]:
        """A cotangent and its gradient in the joints, which is linear in it: differentiating that gives J itself."""
        with torch.enable_grad():
            dummy = torch.zeros_like(self.rows).requires_grad_(True)
            (pulled,) = torch.autograd.grad(self._rows, self._joints, dummy, create_graph=True)
        return dummy, pulled
