"""What several closed pieces enclose together: where they overlap or touch, no surface lies between them."""

from __future__ import annotations

from collections.abc import Sequence
from functools import reduce
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from manifold3d import Manifold

Triangles = tuple[np.ndarray, np.ndarray]
"""Vertices ``[V, 3]`` and faces ``[F, 3]``."""

SAME = 1e-9
"""Share of its area by which a union may differ from its parts and still be nothing but these."""


def united(vertices: np.ndarray, solids: Sequence[np.ndarray]) -> tuple[list[np.ndarray], list[Triangles]]:
    """Solids that overlap or touch, as their unions, through manifold3d.

    Args:
        vertices: of all, ``[V, 3]``.
        solids: triangles of each, closed and facing outward, ``[F, 3]``.

    Returns:
        The solids that stay as they are, among them those that manifold3d refuses, and the unions of the others.
    """
    kept: list[np.ndarray] = []
    unions: list[Triangles] = []
    for group in _groups(vertices, solids):
        known = {i: solid for i in group if len(group) > 1 and (solid := manifold(vertices, solids[i])) is not None}
        whole = reduce(lambda a, b: a + b, known.values()) if len(known) > 1 else None
        if whole is None or _same(whole.surface_area(), sum(solid.surface_area() for solid in known.values())):
            kept += [solids[i] for i in group]
            continue
        kept += [solids[i] for i in group if i not in known]
        unions.append(triangles(whole))
    return kept, unions


def carved(vertices: np.ndarray, rooms: Sequence[np.ndarray], solids: Sequence[Manifold]) -> list[Triangles]:
    """The air of rooms less solids, where any of these touches or crosses a wall; nothing where none does.

    Rooms are closed triangles that face outward, and so is what is returned. A room that manifold3d refuses stays.
    """
    known = [room for own in rooms if (room := manifold(vertices, own)) is not None]
    if len(known) < len(rooms) or not solids:
        return []
    airs = [reduce(lambda a, b: a - b, solids, room) for room in known]
    parts = sum(part.surface_area() for part in (*known, *solids))
    if _same(sum(air.surface_area() for air in airs), parts):
        return []
    return [triangles(air) for air in airs if not air.is_empty()]


def manifold(vertices: np.ndarray, faces: np.ndarray) -> Manifold | None:
    """Closed triangles that face outward as manifold3d takes them; None where it refuses them."""
    import manifold3d

    used, own = np.unique(faces, return_inverse=True)
    mesh = manifold3d.Mesh64(vertices[used], own.reshape(-1, 3).astype(np.uint64))
    solid = manifold3d.Manifold(mesh)
    return solid if solid.status() == manifold3d.Error.NoError and solid.volume() > 0 else None


def triangles(solid: Manifold) -> Triangles:
    """The surface of a solid."""
    mesh = solid.to_mesh64()
    return np.asarray(mesh.vert_properties)[:, :3], np.asarray(mesh.tri_verts).astype(np.int32)


def _same(area: float, parts: float) -> bool:
    return abs(area - parts) <= SAME * parts


def _groups(vertices: np.ndarray, solids: Sequence[np.ndarray]) -> list[list[int]]:
    """Solids whose bounds meet, directly or through others."""
    if not solids:
        return []
    low, high = (np.array([edge(vertices[s.reshape(-1)], axis=0) for s in solids]) for edge in (np.min, np.max))
    order = np.argsort(low[:, 0])
    after = np.searchsorted(low[order, 0], high[order, 0], side="right")
    pairs = [np.zeros((0, 2), dtype=int)]
    for place, i in enumerate(order):  # those that begin, along x, before this one ends
        others = order[place + 1 : after[place]]
        meet = others[((low[others] <= high[i]) & (low[i] <= high[others])).all(axis=1)]
        pairs.append(np.stack([np.full(len(meet), i), meet], axis=1))
    ends = np.concatenate(pairs)
    if len(ends) == 0:
        return [[i] for i in range(len(solids))]
    from scipy.sparse import coo_matrix
    from scipy.sparse.csgraph import connected_components

    graph = coo_matrix((np.ones(len(ends), dtype=bool), tuple(ends.T)), shape=(len(solids), len(solids)))
    number = connected_components(graph, directed=False)[1]
    by_group = np.argsort(number, kind="stable")
    starts = np.searchsorted(number[by_group], np.arange(int(number.max()) + 2))
    return [by_group[a:b].tolist() for a, b in zip(starts[:-1], starts[1:], strict=True)]
