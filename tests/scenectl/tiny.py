"""A generator small enough for tests: a statue that can be moved over the floor, frame by frame."""

from __future__ import annotations

from dataclasses import dataclass

import torch
from jaxtyping import Float
from torch import Tensor

from scenectl.generators.base import Draft, Guide, Price, Progress
from scenectl.generators.conditions import Conditions
from scenectl.generators.prompts import Prompts
from scenectl.generators.spec import Spec, check_samples
from scenes.motion.motion import Motion, Pose2D
from scenes.motion.skeleton import HUMANML3D


def statue() -> Float[Tensor, "22 3"]:
    """A person at rest, lowest joint at y = 0."""
    joints = torch.zeros(22, 3)
    for j, parent in enumerate(HUMANML3D.parents):
        joints[j] = (joints[parent] if parent >= 0 else 0.0) + torch.tensor(HUMANML3D.offsets[j])
    joints[[10, 11], 1] -= 0.047
    joints[:, 1] -= joints[:, 1].min()
    return joints


@dataclass
class TinyStep:
    """Its value is where the statue stands in the canonical frame, x and z at every frame."""

    value: Float[Tensor, "S T 2"]
    start: Pose2D

    def decode(self, value: Float[Tensor, "S T 2"]) -> Motion:
        x, z = value.unbind(-1)
        offset = torch.stack([x, torch.zeros_like(x), z], dim=-1)
        return Motion(self.start.apply(statue() + offset[..., None, :]))

    def at(self, value: Float[Tensor, "S T 2"]) -> TinyStep:
        return TinyStep(value, self.start)

    @property
    def motion(self) -> Motion:
        return self.decode(self.value)

    @property
    def price(self) -> Price:
        return Price(product=1.0, row=1.0)

    @property
    def unit(self) -> float:
        return 1.0

    def jvp(self, tangent: Float[Tensor, "S T 2"]) -> Float[Tensor, "S T J 3"]:
        return torch.func.jvp(lambda value: self.decode(value).joints, (self.value,), (tangent,))[1]

    def vjp(self, cotangent: Float[Tensor, "S T J 3"]) -> Float[Tensor, "S T 2"]:
        return torch.func.vjp(lambda value: self.decode(value).joints, self.value)[1](cotangent)[0]

    def vjps(self, cotangents: Float[Tensor, "R S T J 3"]) -> Float[Tensor, "R S T 2"]:
        return torch.stack([self.vjp(each) for each in cotangents])


class TinyGenerator:
    """Statues that slide ahead at 0.5 m/s, sample s a little more to the left."""

    name, licence, spec = "tiny", "CC0-1.0", Spec(fps=20.0, shortest=0.5, longest=60.0, window=9.8)

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
        prompt, frames, fps = Prompts.of(prompts).single(self.name), self.spec.frames(seconds), self.spec.fps
        draw = torch.Generator().manual_seed(seed)
        ahead = 0.5 * torch.arange(frames) / fps
        left = torch.rand(check_samples(samples), 1, generator=draw) * 0.2
        value = torch.stack([left.expand(samples, frames), ahead.expand(samples, frames)], dim=-1)
        step = TinyStep(value, start)
        guided = {} if guide is None else {"tilt": torch.zeros(3), "nan": float("nan")}
        return Draft(step.motion, step, {"prompt": prompt, **guided})
