"""Stray triangles: a few that a scanner or an export left far from all else, which would make every grid coarse.

All else is a box that grows from where nearly all of the area is, by every piece that is not far from it. Strays are
next to nothing of the area, in pieces that are specks from there. What is far and no speck, such as a lamp post, is
kept, and a doubt says what it costs.
"""

from __future__ import annotations

import numpy as np

GAP = 0.5
"""Distance from all else, as a share of the longest side of that, from which on a piece is far: voxels grow by half."""
SPECK = 0.02
"""Size of a stray piece as a share of its distance: a lamp post of 4 m is more, even 100 m away."""
SHARE, BULK = 0.001, 0.99
"""Share of the area that strays have at most, and share that surely is none of them, along each axis."""
MANY = 10_000
"""Vertices from which on a look at deciles decides first: strays have fewer than a tenth of so many."""


def without_strays(
    vertices: np.ndarray, faces: np.ndarray, name: str
) -> tuple[np.ndarray, np.ndarray, tuple[str, ...]]:
    """A mesh without its stray triangles, and what is to be said about them.

    Args:
        vertices: ``[V, 3]`` metres.
        faces: ``[F, 3]``.
        name: of the mesh, for the sentences.

    Returns:
        Vertices and faces, those given where nothing is stray, and doubts.
    """
    if not len(faces) or not np.isfinite(vertices).all() or _compact(vertices):
        return vertices, faces, ()
    a, b, c = vertices[faces[:, 0]], vertices[faces[:, 1]], vertices[faces[:, 2]]
    area = np.linalg.norm(np.cross(b - a, c - a), axis=1)
    low, high = np.minimum(np.minimum(a, b), c), np.maximum(np.maximum(a, b), c)
    box, outside = _bulk(low, high, area)
    if not len(outside):
        return vertices, faces, ()
    piece = _pieces(vertices[faces[outside]])
    lows, highs = np.full((piece.max() + 1, 3), np.inf), np.full((piece.max() + 1, 3), -np.inf)
    np.minimum.at(lows, piece, low[outside])
    np.maximum.at(highs, piece, high[outside])
    box, strays, large = _grown(box, lows, highs)
    stray = outside[np.isin(piece, strays)]
    if area[stray].sum() > SHARE * area.sum():
        large, strays, stray = np.union1d(large, strays), strays[:0], stray[:0]
    length, full = _length(box, lows[large], highs[large]), _length(low, high)
    centres, doubts = (lows + highs) / 2, tuple[str, ...]()
    if len(stray):
        what, were, them = ("triangles", "were", "them") if len(stray) > 1 else ("triangle", "was", "it")
        doubts += (
            f"mesh '{name}': {len(stray)} stray {what} at {_named(centres[strays])}, far from all else, {were} left "
            f"out; the mesh is {length:.3g} m long, and {full:.3g} m with {them}; where something belongs there, state "
            "it as a primitive",
        )
    if len(large):
        doubts += (
            f"mesh '{name}': what lies at {_named(centres[large])} is little and far from all else, and makes the mesh "
            f"{length:.3g} m long; delete it from the file, or state a 'spacing' so that voxels stay small",
        )
    if not len(stray):
        return vertices, faces, doubts
    kept = np.delete(faces, stray, axis=0)
    used = np.zeros(len(vertices), bool)
    used[kept] = True
    return vertices[used], (used.cumsum() - 1)[kept], doubts


def _compact(vertices: np.ndarray) -> bool:
    """Whether so many vertices reach so little beyond the middle eight of ten that nothing can be far from them."""
    if len(vertices) < MANY:
        return False
    low, high = np.percentile(vertices, (10, 90), axis=0, method="nearest")
    margin = GAP * (high - low).max()
    return bool((vertices.min(axis=0) >= low - margin).all() and (vertices.max(axis=0) <= high + margin).all())


def _bulk(low: np.ndarray, high: np.ndarray, area: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Box ``[2, 3]`` of the triangles that reach into the middle `BULK` of the area, and which are wholly outside."""
    weight = area if area.any() else np.ones(len(area))
    ends = np.empty((2, 3))
    for axis in range(3):
        centres = (low[:, axis] + high[:, axis]) / 2
        order = np.argsort(centres)
        share = weight[order].cumsum() / weight.sum()
        first = np.searchsorted(share, ((1 - BULK) / 2, (1 + BULK) / 2)).clip(max=len(share) - 1)
        ends[:, axis] = centres[order[first]]
    inside = ((low <= ends[1]) & (high >= ends[0])).all(axis=1)
    box = np.stack([np.minimum(ends[0], low[inside].min(axis=0)), np.maximum(ends[1], high[inside].max(axis=0))])
    return box, np.flatnonzero(((low > box[1]) | (high < box[0])).any(axis=1))


def _length(*corners: np.ndarray) -> float:
    """Longest side (m) of the box around corners ``[n, 3]``."""
    points = np.concatenate(corners)
    return float((points.max(axis=0) - points.min(axis=0)).max())


def _pieces(triangles: np.ndarray) -> np.ndarray:
    """Number of the piece that each triangle belongs to, ``[n]``: those that share corners."""
    from scipy.sparse import coo_matrix
    from scipy.sparse.csgraph import connected_components

    _, corners = np.unique(triangles.reshape(-1, 3), axis=0, return_inverse=True)
    ends = corners.reshape(-1, 3)
    links, size = np.concatenate([ends[:, :2], ends[:, 1:]]), int(ends.max()) + 1
    graph = coo_matrix((np.ones(len(links), bool), (links[:, 0], links[:, 1])), shape=(size, size))
    piece: np.ndarray = connected_components(graph, directed=False)[1][ends[:, 0]]
    return piece


def _grown(box: np.ndarray, low: np.ndarray, high: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """A box ``[2, 3]`` and all pieces ``[P, 3]`` not far from it, those that are specks, and far ones that are not.

    What is near or no speck makes the box larger, after which others may be near.
    """
    left, large = np.arange(len(low)), [np.zeros(0, int)]
    while len(left):
        away = np.maximum(box[0] - high[left], low[left] - box[1]).max(axis=1)
        near = away < GAP * np.ptp(box, axis=0).max()
        taken = near if near.any() else (high - low)[left].max(axis=1) > SPECK * away
        if not taken.any():
            break
        if not near.any():
            large.append(left[taken])
        some = left[taken]
        box = np.stack([np.minimum(box[0], low[some].min(axis=0)), np.maximum(box[1], high[some].max(axis=0))])
        left = left[~taken]
    return box, left, np.concatenate(large)


def _named(places: np.ndarray) -> str:
    """The first places in words."""
    words = [f"[{x:.2f}, {y:.2f}, {z:.2f}]" for x, y, z in places[:3]]
    return ", ".join(words) + (f" and {len(places) - 3} more places" if len(places) > 3 else "")
