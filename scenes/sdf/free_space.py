"""Which space is free: an explicit rule on the generalised winding number, reported and open to overruling.

Jacobson et al., "Robust inside-outside segmentation using generalized winding numbers", 2013.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from scenes.errors import UserError
from scenes.mesh.surface import Surface
from scenes.sdf.settings import FreeSpace


@dataclass(frozen=True)
class Rule:
    """Which space is free, in terms of the winding number w.

    Attributes:
        name: "outside", "inside" (of an inward-facing room) or "seed".
        low, high: free is ``low <= w <= high``.
        message: one sentence saying what was decided and why.
        inward: the mesh's front sides face the inside of a room.
    """

    name: str
    low: float
    high: float
    message: str
    inward: bool = False

    def free(self, winding: np.ndarray) -> np.ndarray:
        """True where space with these winding numbers is free."""
        result: np.ndarray = (winding >= self.low) & (winding <= self.high)
        return result

    def margin(self, winding: np.ndarray) -> np.ndarray:
        """How far each winding number lies from where the answer changes."""
        result: np.ndarray = np.minimum(np.abs(winding - self.low), np.abs(winding - self.high))
        return result

    @property
    def beyond(self) -> float:
        """Sign of the distance far away from the mesh, where w is 0."""
        return 1.0 if self.low <= 0.0 <= self.high else -1.0


def decide(surface: Surface, free_space: FreeSpace, bounds: np.ndarray, name: str) -> Rule:
    """The free-space rule for a surface.

    Args:
        surface: the cleaned mesh.
        free_space: as `bake` takes it.
        bounds: padded bounds ``[2, 3]`` (m) that a seed point must lie in.
        name: of the mesh, for the message.

    Raises:
        UserError: a seed point outside `bounds` or within 1 mm of a surface.
    """
    kind = _kind(surface)
    if free_space == "outside":
        return _outside(surface, f"mesh '{name}' ({kind}): free space is outside, as stated")
    if not isinstance(free_space, str):
        return _from_seed(surface, free_space, bounds, name, kind)
    facing = _winding_in_front(surface)
    # In front of a room's walls w is -1; in front of an object's it is 0. A sheet alone gives -1/2, a floor with two
    # walls about -0.7: only what is enclosed for the most part counts as a room.
    if facing < (-0.5 if surface.nearly_closed else -0.75):
        message = f"mesh '{name}' ({kind}) faces inward (winding number {facing:.2f} in front of its triangles), so"
        return Rule("inside", -math.inf, -0.5, f"{message} the space it encloses is free and all else solid", True)
    message = f"mesh '{name}' ({kind}) does not face inward (winding number {facing:.2f} in front of its triangles)"
    return _outside(surface, f"{message}, so free space is outside")


def _kind(surface: Surface) -> str:
    return surface.kind if surface.closed else f"{surface.kind}, {surface.boundary_edges} boundary edges"


def _outside(surface: Surface, message: str) -> Rule:
    if surface.nearly_closed:  # a closed part is solid whichever way it faces
        return Rule("outside", -0.5, 0.5, message)
    # Loose sheets have |w| up to 1 on the side they face; only what they enclose from behind is solid.
    return Rule("outside", -math.inf, 0.5, f"{message} and only what has winding number over 0.5 is solid")


def _from_seed(surface: Surface, seed: Sequence[float], bounds: np.ndarray, name: str, kind: str) -> Rule:
    point = np.array([seed])
    text = f"({seed[0]:g}, {seed[1]:g}, {seed[2]:g})"
    if (point < bounds[0]).any() or (point > bounds[1]).any():
        low, high = (np.array2string(corner, precision=2, separator=", ") for corner in bounds)
        raise UserError(
            f"free-space seed {text} lies outside mesh '{name}', whose padded bounds run from {low} to {high} m;"
            " give a point in the air"
        )
    if surface.unsigned_distance(point)[0] < 1e-3:
        raise UserError(f"free-space seed {text} lies on a surface of mesh '{name}'; give a point in the air")
    w = float(surface.winding(point)[0])
    message = f"mesh '{name}' ({kind}): free space is that of the seed {text}, where the winding number is {w:.2f}"
    if w < -0.5:
        return Rule("seed", -math.inf, -0.5, message, True)
    if w <= 0.5:
        outside = _outside(surface, message)
        return Rule("seed", outside.low, outside.high, outside.message)
    return Rule("seed", round(w) - 0.5, round(w) + 0.5, message)


def _winding_in_front(surface: Surface, samples: int = 512) -> float:
    """Median winding number just in front of points spread evenly over the surface."""
    rng = np.random.default_rng(0)
    chosen = surface.by_area(samples, rng)
    corners = surface.vertices[surface.faces[chosen]]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    step = 1e-4 * float(np.ptp(surface.bounds, axis=0).max())
    return float(np.median(surface.dipoles.at(surface.points_on(chosen, rng) + step * normals)))


def is_free(surface: Surface, rule: Rule, points: np.ndarray) -> np.ndarray:
    """True at those of ``[n, 3]`` world points (m) that lie in free space.

    The fast winding number is within about 0.01; wherever that could change the answer, the exact one decides.
    """
    winding = surface.winding_fast(points)
    doubtful = np.flatnonzero(rule.margin(winding) < 0.02)
    winding[doubtful] = surface.winding(points[doubtful])
    return rule.free(winding)


def signed_distance(surface: Surface, rule: Rule, points: np.ndarray) -> np.ndarray:
    """Exact distance (m) of ``[n, 3]`` world points (m) to the triangles, positive in free space: the oracle."""
    unsigned = surface.unsigned_distance(points)
    return np.where(is_free(surface, rule, points), unsigned, -unsigned)
