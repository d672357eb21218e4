"""A mesh made fit for questions of distance and of inside or outside, answered by libigl.

These answers are slow and right: they decide what a bake means by free space, and they are the oracle against which
grids and motions are scored. Distances never come from a winding number, whose approximation ruins them on soups.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from scenes.errors import UserError
from scenes.mesh import Mesh

NEARLY_CLOSED = 0.005
"""Share of unmatched edges up to which a mesh counts as closed with a few holes, as room scans are."""


def clean(vertices: np.ndarray, faces: np.ndarray) -> tuple[np.ndarray, np.ndarray, int]:
    """Merge equal vertices, drop repeated and collapsed triangles, and count unmatched edges.

    A triangle stored twice would count twice in the winding number. Slivers of no area stay out of the result but
    take part in the count, because a seam that they fill is no hole.

    Returns:
        vertices ``[V, 3]``, faces ``[F, 3]``, and the number of edges whose uses in the two directions differ; 0
        means closed, and then winding numbers are whole numbers.
    """
    unique, inverse = np.unique(vertices, axis=0, return_inverse=True)
    faces = inverse.reshape(-1)[faces]
    a, b, c = faces.T
    faces = faces[(a != b) & (b != c) & (c != a)]
    # Turning each triangle to start at its smallest index makes copies equal and mirror images differ.
    first = faces.argmin(axis=1)[:, None]
    faces = np.unique(np.take_along_axis(faces, (first + np.arange(3)) % 3, axis=1), axis=0)
    boundary = _unmatched_edges(faces)
    corners = unique[faces]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    longest = np.square(corners - np.roll(corners, 1, axis=1)).sum(axis=-1).max(axis=-1, initial=0.0)
    faces = faces[np.linalg.norm(normals, axis=1) > 1e-12 * longest]
    return unique, np.ascontiguousarray(faces), boundary


def _unmatched_edges(faces: np.ndarray) -> int:
    edges = np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]])
    direction = np.where(edges[:, 0] < edges[:, 1], 1, -1)
    _, which = np.unique(np.sort(edges, axis=1), axis=0, return_inverse=True)
    return int(np.count_nonzero(np.bincount(which.reshape(-1), weights=direction)))


@dataclass(frozen=True, eq=False)
class Surface:
    """The triangles of a mesh, cleaned, around their own centre so that single precision suffices.

    Attributes:
        vertices: ``[V, 3]`` metres, relative to `centre`.
        faces: ``[F, 3]``.
        centre: middle of the bounds, world metres, ``[3]``.
        boundary_edges: unmatched edges; 0 for a closed mesh.
        edges: number of edges.
    """

    vertices: np.ndarray
    faces: np.ndarray
    centre: np.ndarray
    boundary_edges: int
    edges: int

    @classmethod
    def of(cls, mesh: Mesh) -> Surface:
        """Clean a mesh; raises UserError when no triangle with an area is left."""
        vertices, faces, boundary = clean(mesh.vertices, mesh.faces)
        if len(faces) == 0:
            raise UserError(f"mesh '{mesh.name}' has only triangles without area; export it again")
        centre = mesh.bounds.mean(axis=0)
        used, inverse = np.unique(faces, return_inverse=True)
        return cls(
            vertices[used] - centre, inverse.reshape(-1, 3).astype(np.int64), centre, boundary, len(faces) * 3 // 2
        )

    @property
    def closed(self) -> bool:
        """No unmatched edge: winding numbers are whole numbers."""
        return self.boundary_edges == 0

    @property
    def nearly_closed(self) -> bool:
        """Closed but for a few holes, as scans of rooms are."""
        return self.boundary_edges <= NEARLY_CLOSED * self.edges

    @cached_property
    def _winding_tree(self) -> Any:
        import igl

        tree = igl.FastWindingNumberBVH()
        tree.init(self.vertices, self.faces)
        return tree

    def winding_fast(self, points: np.ndarray) -> np.ndarray:
        """Winding number at ``[n, 3]`` world points (m), within about 0.01: for signs, never for distances."""
        if len(points) == 0:
            return np.zeros(0)
        result: np.ndarray = self._winding_tree.winding_number(np.ascontiguousarray(points - self.centre))
        return result

    def winding(self, points: np.ndarray) -> np.ndarray:
        """Exact generalised winding number at ``[n, 3]`` world points (m)."""
        import igl

        if len(points) == 0:
            return np.zeros(0)
        result: np.ndarray = igl.winding_number(
            self.vertices, self.faces, np.ascontiguousarray(points - self.centre, dtype=np.float64)
        )
        return result

    def unsigned_distance(self, points: np.ndarray) -> np.ndarray:
        """Exact distance (m, double precision) from ``[n, 3]`` world points (m) to the nearest triangle."""
        import igl

        if len(points) == 0:
            return np.zeros(0)
        squared, _, _ = igl.point_mesh_squared_distance(
            np.ascontiguousarray(points - self.centre, dtype=np.float64), self.vertices, self.faces
        )
        distance: np.ndarray = np.sqrt(np.maximum(squared, 0.0))
        return distance
