"""Where the shapes of a robot's bodies are."""

from __future__ import annotations

from collections.abc import Collection
from typing import Any

import numpy as np
from jaxtyping import Float

from scenes.body.mjcf import geom_solid, geoms_of


def corners(model: Any, data: Any, bodies: Collection[int]) -> Float[np.ndarray, "n 3"]:
    """Corners (m, world) of the shapes of some bodies: those that collide, or all where none of the bodies' does."""
    geoms = [geoms_of(model, body) for body in bodies]
    hard = any(collides for collides, _ in geoms)
    points = [np.zeros((0, 3))]
    for body, (collides, seen) in zip(bodies, geoms, strict=True):
        for geom in collides if hard else seen:
            turn = data.xmat[body].reshape(3, 3)
            points.append(data.xpos[body] + geom_solid(model, geom)[0] @ turn.T)
    return np.concatenate(points)
