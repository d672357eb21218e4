"""A generator small enough for tests: a statue that can be moved over the floor, frame by frame."""

from __future__ import annotations

from dataclasses import dataclass

import torch
from jaxtyping import Float, Int
from torch import Tensor

from scenectl.generators.base import Draft, Guide, Price, Progress
from scenectl.generators.conditions import Conditions
from scenectl.generators.prompts import Prompts
from scenectl.generators.spec import Spec, check_request
from scenes.motion.bones import standing_pose
from scenes.motion.motion import Motion, Pose2D
from scenes.motion.skeleton import HUMANML3D


def statue() -> Float[Tensor, "22 3"]:
    """A person at rest, lowest joint at y = 0."""
    joints = standing_pose(HUMANML3D).float()
    joints[:, 1] -= joints[:, 1].min()
    return joints


CHEAP = Price(product=0.1, row=0.1)


@dataclass
class TinyStep:
    """Its value is where the statue stands in the canonical frame, x and z at every frame."""

    value: Float[Tensor, "S T 2"]
    start: Pose2D
    price: Price = CHEAP
    unit: float = 1.0

    def decode(self, value: Float[Tensor, "S T 2"]) -> Motion:
        x, z = value.unbind(-1)
        offset = torch.stack([x, torch.zeros_like(x), z], dim=-1)
        return Motion(self.start.apply(statue() + offset[..., None, :]))

    def at(self, value: Float[Tensor, "S T 2"]) -> TinyStep:
        return TinyStep(value, self.start)

    def take(self, samples: Int[Tensor, " s"]) -> TinyStep:
        return TinyStep(self.value[samples], self.start)

    @property
    def motion(self) -> Motion:
        return self.decode(self.value)

    def jvp(self, tangent: Float[Tensor, "S T 2"]) -> Float[Tensor, "S T J 3"]:
        return torch.func.jvp(lambda value: self.decode(value).joints, (self.value,), (tangent,))[1]

    def vjp(self, cotangent: Float[Tensor, "S T J 3"]) -> Float[Tensor, "S T 2"]:
        return torch.func.vjp(lambda value: self.decode(value).joints, self.value)[1](cotangent)[0]

    def vjps(self, cotangents: Float[Tensor, "R S T J 3"]) -> Float[Tensor, "R S T 2"]:
        return torch.stack([self.vjp(each) for each in cotangents])


class TinyGenerator:
    """Statues that slide ahead at 0.5 m/s, sample s a little more to the left."""

    name, licence = "tiny", "CC0-1.0"
    spec = Spec(fps=20.0, shortest=0.5, longest=60.0, window=9.8)

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
        text, frames = check_request(self.name, self.spec, prompts, seconds, start, samples)
        draw = torch.Generator().manual_seed(seed)
        ahead = 0.5 * torch.arange(frames) / self.spec.fps
        left = torch.rand(samples, 1, generator=draw) * 0.2
        value = torch.stack([left.expand(samples, frames), ahead.expand(samples, frames)], dim=-1)
        step = TinyStep(value, start)
        return Draft(step.motion, step, {"prompt": text, "tilt": torch.zeros(3), "nan": float("nan")})
