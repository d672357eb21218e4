"""Where the nodes of a grid lie."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from scenes.errors import UserError

LARGEST = 2**30
"""Nodes of the largest lattice: 4 GiB of distances."""


@dataclass(frozen=True)
class Lattice:
    """Nodes on a cubic lattice: ``[i, j, k]`` lies exactly at ``origin + spacing * (i, j, k)``.

    Attributes:
        origin: position of node ``[0, 0, 0]``, metres, world.
        spacing: edge of a voxel, metres.
        shape: nodes along x, y and z, 2 or more each.

    Raises:
        UserError: a spacing that is not positive, numbers that are not finite, or too few or too many nodes.
    """

    origin: tuple[float, float, float]
    spacing: float
    shape: tuple[int, int, int]

    def __post_init__(self) -> None:
        if len(self.origin) != 3 or len(self.shape) != 3:
            raise UserError(f"a lattice has an origin {self.origin} and a shape {self.shape}; give three numbers each")
        if not (np.isfinite(self.origin).all() and np.isfinite(self.spacing) and self.spacing > 0):
            raise UserError(f"a lattice at {self.origin} with spacing {self.spacing} m; give finite metres")
        if min(self.shape) < 2 or int(np.prod(self.shape, dtype=object)) > LARGEST:
            raise UserError(f"a lattice of {self.shape} nodes; give at least 2 along each axis and at most 2^30 in all")
        object.__setattr__(self, "origin", tuple(float(x) for x in self.origin))
        object.__setattr__(self, "shape", tuple(int(n) for n in self.shape))

    @classmethod
    def around(cls, bounds: np.ndarray, resolution: int, padding: float | int = 0.0) -> Lattice:
        """The lattice centred on `bounds` ``[2, 3]`` (m) with `resolution` nodes along the longest padded side."""
        return cls.spaced(bounds, _spacing(padded(bounds, padding), resolution), padding)

    @classmethod
    def cube(cls, bounds: np.ndarray, resolution: int, padding: float | int = 0.0) -> Lattice:
        """`resolution` nodes along every axis, centred on `bounds` ``[2, 3]`` (m): what tools bake to be compared."""
        box = padded(bounds, padding)
        return cls._centred(box, _spacing(box, resolution), np.full(3, resolution))

    @classmethod
    def spaced(cls, bounds: np.ndarray, spacing: float, padding: float | int = 0.0, whole: int = 1) -> Lattice:
        """The lattice centred on `bounds` ``[2, 3]`` (m) with a stated spacing (m); `whole` divides its cells."""
        box = padded(bounds, padding)
        shape = np.maximum(np.ceil((box[1] - box[0]) / (spacing * whole) - 1e-6).astype(int), 1) * whole + 1
        return cls._centred(box, spacing, shape)

    @classmethod
    def _centred(cls, box: np.ndarray, spacing: float, shape: np.ndarray) -> Lattice:
        origin = (box[0] + box[1]) / 2 - (shape - 1) / 2 * spacing
        x, y, z = (float(o) for o in origin)
        return cls((x, y, z), spacing, (int(shape[0]), int(shape[1]), int(shape[2])))

    @property
    def bounds(self) -> np.ndarray:
        """First and last node, ``[2, 3]``, metres."""
        low = np.array(self.origin)
        return np.stack([low, low + self.spacing * (np.array(self.shape) - 1)])

    def margin(self, bounds: np.ndarray) -> float:
        """Metres between its own bounds and `bounds` ``[2, 3]`` within, where they are least; 0 where they cross."""
        own = self.bounds
        return float(min((bounds[0] - own[0]).min(), (own[1] - bounds[1]).min()).clip(0.0))

    def nodes(self, index: np.ndarray) -> np.ndarray:
        """World positions ``[..., 3]`` (m, float64) of the nodes with integer indices ``[..., 3]``."""
        positions: np.ndarray = np.array(self.origin) + self.spacing * index
        return positions

    def nodes_at(self, flat: np.ndarray) -> np.ndarray:
        """World positions ``[n, 3]`` (m, float64) of the nodes with flat indices ``[n]``."""
        return self.nodes(np.stack(np.unravel_index(flat, self.shape), axis=-1))


def padded(bounds: np.ndarray, padding: float | int) -> np.ndarray:
    """Bounds ``[2, 3]`` (m) with so many metres more on each side."""
    box: np.ndarray = np.asarray(bounds, dtype=np.float64) + np.array([[-padding], [padding]])
    return box


def _spacing(box: np.ndarray, resolution: int) -> float:
    return float((box[1] - box[0]).max()) / (resolution - 1)
