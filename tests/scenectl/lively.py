"""A family without tokens or weights, on a clock of its own: a person who sways along smooth random curves.

It proves that tasks, goals, refinement and benches ask nothing of a generator but the protocol.
"""

from __future__ import annotations

import math
from typing import Any

import torch
from jaxtyping import Bool, Float
from pydantic import BaseModel, ConfigDict, Field
from torch import Tensor

from scenectl.generators.base import Draft, Guide, Progress
from scenectl.generators.conditions import Conditions
from scenectl.generators.prompts import Prompts
from scenectl.generators.registry import Family
from scenectl.generators.spec import Spec, check_request
from scenectl.generators.steps import DecodedStep
from scenes.errors import UserError
from scenes.motion.motion import Motion, Pose2D
from tests.scenectl.tiny import statue

SPEC = Spec(fps=30.0, shortest=1.0, longest=20.0, window=12.0, abilities=frozenset({"edit"}))
WAVES = 9
"""Cosines over the length of a motion, from none to four periods."""


class Swaying(BaseModel):
    """Settings: how far joints and body sway (m)."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    sway: float = Field(default=0.03, ge=0)


class Lively:
    """Cosines with random amplitudes, added to a body at rest; a guide pulls on the amplitudes while they are drawn."""

    name, licence, spec = "lively", "CC0-1.0", SPEC

    def __init__(self, settings: Swaying | None = None) -> None:
        self.settings = settings or Swaying()

    def generate(
        self,
        prompts: Prompts | str,
        seconds: float,
        start: Pose2D,
        *,
        conditions: Conditions | None = None,
        guide: Guide | None = None,
        samples: int = 1,
        seed: int = 0,
        progress: Progress | None = None,
    ) -> Draft:
        told, frames = check_request(self.name, SPEC, prompts, seconds, start, samples)
        moves = self._moves(samples, len(str(told)) + 1000 * seed)
        base = statue().expand(frames, 22, 3)

        def decode(value: Float[Tensor, "S W J 3"]) -> Motion:
            return Motion(base + _waves(frames, value), fps=SPEC.fps).placed(start)

        return self._steered(DecodedStep(moves, decode), guide)

    def edit(
        self,
        motion: Motion,
        regenerate: Bool[Tensor, " T"],
        prompts: Prompts | str,
        *,
        guide: Guide | None = None,
        samples: int = 1,
        seed: int = 0,
        progress: Progress | None = None,
    ) -> Draft:
        check_request(self.name, SPEC, prompts, motion.seconds, Pose2D(), samples)
        if regenerate.all() or not regenerate.any():
            raise UserError("an edit keeps some frames and makes others anew; this one has only one kind")
        base, share = motion.joints, regenerate.to(motion.joints)[:, None, None]

        def decode(value: Float[Tensor, "S W J 3"]) -> Motion:
            return Motion(base + share * _waves(motion.frames, value), fps=SPEC.fps)

        return self._steered(DecodedStep(self._moves(samples, seed), decode), guide)

    def _moves(self, samples: int, seed: int) -> Float[Tensor, "S W J 3"]:
        draw = torch.Generator().manual_seed(seed)
        body, joints = (
            torch.randn(samples, WAVES, 1, 3, generator=draw),
            torch.randn(samples, WAVES, 22, 3, generator=draw),
        )
        return self.settings.sway * (body * torch.tensor([1.0, 0.0, 1.0]) + 0.2 * joints)

    def _steered(self, step: DecodedStep, guide: Guide | None) -> Draft:
        if guide is not None:
            pull = guide.gradient(step)
            size = pull.flatten(1).norm(dim=1).clamp_min(1.0)[:, None, None, None]
            step = step.at(step.value + self.settings.sway * pull / size)
        return Draft(step.motion, step)


def _waves(frames: int, value: Float[Tensor, "S W J 3"]) -> Float[Tensor, "S T J 3"]:
    at = (torch.arange(frames) + 0.5) / frames
    waves = torch.cos(math.pi * at[:, None] * torch.arange(value.shape[1])).to(value)
    return torch.einsum("tw,swjc->stjc", waves, value)


def _open(weights: Any, settings: Swaying) -> Lively:
    return Lively(settings)


FAMILY = Family("lively", SPEC, Swaying, _open, weights=None)
