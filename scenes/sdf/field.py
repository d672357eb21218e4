"""What every distance field offers, dense grid or analytic shape."""

from __future__ import annotations

from typing import Protocol, runtime_checkable

from jaxtyping import Float
from torch import Tensor


@runtime_checkable
class DistanceField(Protocol):
    """Signed distance at points and a time: metres, positive in free space, differentiable, defined everywhere."""

    def distance(self, points: Float[Tensor, "*b 3"], time: Tensor | None = None) -> Float[Tensor, "*b"]:
        """Distance (m) at `points` (m, world); `time` (s, task clock) must broadcast to ``points[..., 0]``."""
        ...
