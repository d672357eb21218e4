"""Polygons cut into triangles between their own corners."""

from __future__ import annotations

import numpy as np

_FLAT = 1e-9
"""Share of a polygon's area under which a triangle of it counts as none: corners in a line, up to rounding."""


def triangulated(vertices: np.ndarray, corners: np.ndarray, counts: np.ndarray) -> np.ndarray:
    """Triangles of polygons, which may be concave and bent a little, and have corners in a line or bridges to holes.

    A polygon is cut as a fan from its first corner where all triangles of the fan face its way, as those of every
    convex one do; else in the plane of its Newell normal, by manifold3d, whose triangles use every corner, so that
    neighbours still meet edge to edge. Polygons of fewer than three corners have none.

    Args:
        vertices: ``[V, 3]``.
        corners: vertex indices of all polygons, one after another, ``[sum(counts)]``.
        counts: corners of each polygon, ``[P]``.

    Returns:
        Faces ``[F, 3]`` int64, wound as the polygons are: triangles first, then quadrangles, then larger ones.

    Raises:
        ValueError: corners name vertices that are not there.
    """
    corners, counts = np.asarray(corners, dtype=np.int64), np.asarray(counts, dtype=np.int64)
    if len(corners) and (corners.min() < 0 or corners.max() >= len(vertices)):
        raise ValueError(f"faces name vertices beyond the {len(vertices)} of the file")
    starts = np.cumsum(counts) - counts
    faces = [np.zeros((0, 3), dtype=np.int64)]
    for count in np.unique(counts[counts >= 3]):
        rings = corners[starts[counts == count][:, None] + np.arange(count)]
        faces.append(rings if count == 3 else _cut(vertices, rings))
    return np.concatenate(faces)


def _cut(vertices: np.ndarray, rings: np.ndarray) -> np.ndarray:
    """Triangles of polygons with the same number of corners, four or more; ``[P, n]`` to ``[P (n - 2), 3]``."""
    count = rings.shape[1]
    fan = np.array([[0, k, k + 1] for k in range(1, count - 1)])
    if count == 4:
        fan[1] = [2, 3, 0]
    faces = rings[:, fan]
    a, b, c = np.moveaxis(vertices[faces], 2, 0)
    areas = np.cross(b - a, c - a)  # twice, as vectors; their sum is Newell's normal
    normals = areas.sum(axis=1)
    square = (normals**2).sum(axis=1)
    faces_its_way = ((areas * normals[:, None]).sum(axis=2) > _FLAT * square[:, None]).all(axis=1)
    for polygon in np.flatnonzero(~faces_its_way & np.isfinite(square) & (square > 0)):
        cut = _in_plane(vertices[rings[polygon]], normals[polygon])
        if len(cut) == count - 2:
            faces[polygon] = rings[polygon][cut]
    return faces.swapaxes(0, 1).reshape(-1, 3) if count == 4 else faces.reshape(-1, 3)


def _in_plane(ring: np.ndarray, normal: np.ndarray) -> np.ndarray:
    """Triangles of one polygon seen along its normal, as numbers of its corners."""
    import manifold3d

    normal = normal / np.linalg.norm(normal)
    u = np.cross(np.eye(3)[np.abs(normal).argmin()], normal)
    flat = (ring - ring[0]) @ np.stack([u, np.cross(normal, u)], axis=1)
    return np.asarray(manifold3d.triangulate([flat / np.abs(flat).max()]))
