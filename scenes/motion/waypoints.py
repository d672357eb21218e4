"""Positions at times."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
import torch
from jaxtyping import Float, Int
from torch import Tensor

from scenes.errors import UserError
from scenes.motion.frames import shifted
from scenes.numbers import finite, vector

Number: TypeAlias = float | int
Vector: TypeAlias = Sequence[Number]
"""Three numbers x, y, z; stored as a tuple of floats."""


@dataclass(frozen=True)
class Waypoints:
    """Positions at times: straight lines between them, held before the first and after the last.

    Attributes:
        times: seconds on the task's clock, ``[K]``, strictly increasing.
        positions: metres, world, ``[K, 3]``.
    """

    times: Sequence[Number]
    positions: Sequence[Vector]

    def __post_init__(self) -> None:
        times = tuple(finite(time, f"waypoint time {i}") for i, time in enumerate(self.times))
        positions = tuple(vector(p, f"waypoint {i}") for i, p in enumerate(self.positions))
        if len(times) == 0 or len(times) != len(positions):
            raise UserError(f"waypoints have {len(times)} times and {len(positions)} positions; give as many of each")
        if any(b <= a for a, b in zip(times, times[1:], strict=False)):
            raise UserError(f"waypoint times are {list(times)}; give seconds, each later than the one before")
        object.__setattr__(self, "times", times)
        object.__setattr__(self, "positions", positions)

    def moved(self, by: Vector) -> Waypoints:
        """The same way elsewhere, by so much (m)."""
        return Waypoints(self.times, [shifted(place, by) for place in self.positions])

    def at(self, time: Float[Tensor, "*t"]) -> Float[Tensor, "*t 3"]:
        """Position (m) at each time (s), differentiable in time."""
        leg, share = self.leg(time)
        steps = np.diff(self.positions, axis=0) if len(self.times) > 1 else np.zeros((1, 3))
        return time.new_tensor(self.positions)[leg] + share.unsqueeze(-1) * time.new_tensor(steps)[leg]

    def leg(self, time: Float[Tensor, "*t"]) -> tuple[Int[Tensor, "*t"], Float[Tensor, "*t"]]:
        """Which of the K - 1 legs each time (s) belongs to, and the share of it that has passed, 0 to 1.

        A single waypoint counts as one leg, of which nothing ever passes.
        """
        if len(self.times) == 1:
            return torch.zeros_like(time, dtype=torch.long), torch.zeros_like(time)
        times = time.new_tensor(self.times)
        leg = (torch.bucketize(time.detach(), times) - 1).clamp(0, len(self.times) - 2)
        return leg, ((time - times[leg]) / (times[leg + 1] - times[leg])).clamp(0.0, 1.0)

    def offset(self, time: Tensor | None, like: Tensor) -> Tensor:
        """Position at `time`, or at 0 s when no time is given, with the type and device of `like`."""
        return self.at(clock(time, like))


def clock(time: Tensor | None, like: Tensor) -> Tensor:
    """A time (s) with the type and device of `like`; 0 s when none is given."""
    return like.new_zeros(()) if time is None else torch.as_tensor(time).to(like)


def moment(time: Number) -> Float[Tensor, ""]:
    """One time (s) in double precision."""
    return torch.tensor(time, dtype=torch.float64)
