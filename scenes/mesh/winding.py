"""Winding numbers of many points, quickly: within a few hundredths, for signs and never for distances."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from scenes.kernels import spans
from scenes.kernels.opposite import opposite
from scenes.kernels.winding import LEAF, clusters, morton, winding

_CHUNK = 256


@dataclass(frozen=True, eq=False)
class Dipoles:
    """A tree of triangle clusters, each of which looks like a dipole from afar.

    Barill et al., "Fast winding numbers for soups and clouds", 2018, first order.

    Attributes:
        vertices: ``[V, 3]``, any unit.
        faces: ``[F, 3]`` int32.
        order: triangles along a Morton curve, ``[F]``.
        tree: rows of `scenes.kernels.winding.clusters`.
    """

    vertices: np.ndarray
    faces: np.ndarray
    order: np.ndarray
    tree: np.ndarray

    @classmethod
    def of(cls, vertices: np.ndarray, faces: np.ndarray) -> Dipoles:
        """Build the tree over triangles."""
        low, extent = vertices.min(axis=0), float(np.ptp(vertices, axis=0).max())
        codes = morton(vertices, faces, low, 1023.0 / extent if extent > 0 else 0.0)
        order = np.argsort(codes, kind="stable").astype(np.int32)
        leaves = 1 << max(0, (-(-len(faces) // LEAF) - 1).bit_length())
        return cls(vertices, faces, order, clusters(vertices, faces, order, leaves))

    def opposite(
        self, triangles: np.ndarray, points: np.ndarray, length: float, threads: int | None = None
    ) -> np.ndarray:
        """How far the surface turns its back to points on it: in front of each and behind, ``[n, 2]``.

        Args:
            triangles: the one that each point lies on, ``[n]``.
            points: ``[n, 3]`` in the unit and frame of the vertices.
            length: as far as this along the triangle's normal both ways; infinite where nothing is met.
        """
        out = np.empty((len(points), 2))
        tree = (self.vertices, self.faces, self.order, self.tree)
        spans(
            lambda begin, end: opposite(*tree, triangles, points, length, begin, end, out), len(points), _CHUNK, threads
        )
        return out

    def at(self, points: np.ndarray, threads: int | None = None, reach: float = 2.5) -> np.ndarray:
        """Winding number at ``[n, 3]`` points in the unit and frame of the vertices.

        A cluster counts as a dipole from `reach` of its radii on.
        """
        points = np.ascontiguousarray(points, dtype=np.float64)
        out = np.empty(len(points))
        tree = (self.vertices, self.faces, self.order, self.tree, reach)
        spans(lambda begin, end: winding(*tree, points, begin, end, out), len(points), _CHUNK, threads)
        return out
