"""Objectives as a guide: goals and scene on one side, a generator's steps on the other."""

from __future__ import annotations

import torch
from jaxtyping import Float
from torch import Tensor

from objectives import Context, Objective
from scenectl.control.figure import Figure
from scenectl.control.rise import Rise
from scenectl.control.settings import GuidanceSettings
from scenectl.control.start import FreeStart
from scenectl.generators.base import Step
from scenes.motion.motion import Motion


class ObjectiveGuide:
    """Steers any generator towards an objective in a context; it answers and holds no state."""

    def __init__(
        self,
        objective: Objective,
        context: Context,
        guidance: GuidanceSettings | None = None,
        start: FreeStart | None = None,
        on_ground: bool = False,
        figure: Figure | None = None,
    ) -> None:
        """Make a guide.

        Args:
            objective: the goals.
            context: scene and body.
            guidance: settings.
            start: where motions begin, if that shall be solved for: each step is seen from where it suits the goals.
            on_ground: motions follow the ground already, as those of edits do, and are not lifted onto their path's.
            figure: of the body, where the steps' motions are another's.
        """
        self.objective, self.context, self.start, self.figure = objective, context, start, figure
        self.guidance = guidance or GuidanceSettings()
        self._rise = None if on_ground else Rise.of(objective)

    def log_prob(self, step: Step) -> Float[Tensor, " S"]:
        """Minus the objective's cost (Eq. 40), times the guidance scale."""
        return -self.guidance.scale * self._cost(self._begun(step.decode(step.value)))

    def gradient(self, step: Step) -> Float[Tensor, "S *v"]:
        """Gradient of `log_prob` in the step's value; samples are independent, so one backward pass serves all."""
        value = step.value.detach().requires_grad_(True)
        with torch.enable_grad():
            motion = step.decode(value)
            motion.joints.register_hook(_numbers)  # one frame that is not a number must not silence the whole tilt
            cost = self._cost(self._begun(motion))
            (gradient,) = torch.autograd.grad(cost.sum(), value)
        return -self.guidance.scale * _numbers(gradient)

    def _begun(self, motion: Motion) -> Motion:
        """The body's motion on the ground of its path, from the start that suits the goals best, if that is free."""
        motion = motion if self.figure is None else self.figure.of(motion)
        motion = motion if self._rise is None else self._rise.under(motion)
        if self.start is None:
            return motion
        return self.start.moved(motion, self.start.fit(motion, self.objective, self.context))

    def _cost(self, motion: Motion) -> Float[Tensor, " S"]:
        return self.objective.cost(motion, self.context)


def _numbers(gradient: Tensor) -> Tensor:
    return torch.nan_to_num(gradient, 0.0, 0.0, 0.0)
