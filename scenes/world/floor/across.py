"""Ways over several sheets of the ground: from storey to storey."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from scenes.world.floor.levels import STEP
from scenes.world.floor.mapping import CLIMB
from scenes.world.floor.sheet import Walker

_WAYS = ((1, 0), (0, 1), (1, 1), (1, -1))  # to half of the eight neighbours; the others are these, backwards


def across(
    walkers: Sequence[Walker], start: tuple[np.ndarray, float], goal: tuple[np.ndarray, float]
) -> np.ndarray | None:
    """The cheapest way ``[P, 3]`` (m, world) between two places (x and z ``[2]``, and height), or None.

    Dijkstra's way over the surfaces of all sheets, which meet in those that several hold; a surface costs what it
    costs on the sheet where it is clearest. Each part of it that stays on one sheet is smoothed there.
    """
    from scipy.sparse import coo_matrix
    from scipy.sparse.csgraph import dijkstra

    ids, rows, columns, weights = _graph(walkers)
    numbers = np.unique(ids[ids >= 0])
    ends = [_node(walkers, ids, *end) for end in (start, goal)]
    if min(ends) < 0:
        return None
    first, last = np.searchsorted(numbers, ends)
    places = (np.searchsorted(numbers, rows), np.searchsorted(numbers, columns))
    kept = np.lexsort((weights, *places))  # of two sheets' edges the cheaper one
    places = (places[0][kept], places[1][kept])
    new = np.append(True, (np.diff(places[0]) != 0) | (np.diff(places[1]) != 0)) if len(kept) else kept.astype(bool)
    edges = (weights[kept][new], (places[0][new], places[1][new]))
    graph = coo_matrix(edges, shape=(len(numbers), len(numbers))).tocsr()
    total, before = dijkstra(graph, directed=False, indices=first, return_predecessors=True)
    if not np.isfinite(total[last]):
        return None
    way = [int(last)]
    while way[-1] != first:
        way.append(int(before[way[-1]]))
    return _smoothed(walkers, ids, numbers[way[::-1]], start[0], goal[0])


def _graph(walkers: Sequence[Walker]) -> tuple[np.ndarray, ...]:
    """Numbers of the surfaces that may be walked on ``[S, X, Z]`` (-1 elsewhere), and the edges between them."""
    surface = np.stack([walker.sheet.surface for walker in walkers])
    cost = np.stack([walker.cost for walker in walkers])
    count = int(surface.max()) + 1
    cells = np.arange(surface[0].size).reshape(surface[0].shape)
    ids = np.where((surface >= 0) & np.isfinite(cost), cells * count + surface, -1)
    edges = []
    for s, walker in enumerate(walkers):
        limit, heights = CLIMB if walker.climb else STEP, walker.sheet.heights
        for dx, dz in _WAYS:
            a = (slice(0, -dx or None), slice(max(-dz, 0), -dz if dz > 0 else None))
            b = (slice(dx, None), slice(max(dz, 0), dz if dz < 0 else None))
            step = (ids[s][a] >= 0) & (ids[s][b] >= 0) & (np.abs(heights[a] - heights[b]) <= limit)
            price = (cost[s][a] + cost[s][b])[step] / 2 * np.hypot(dx, dz)
            edges.append((ids[s][a][step], ids[s][b][step], price))
    rows, columns, weights = (np.concatenate(part) for part in zip(*edges, strict=True))
    return ids, rows, columns, weights


def _node(walkers: Sequence[Walker], ids: np.ndarray, xz: np.ndarray, y: float) -> int:
    """Number of the surface at a place, or -1."""
    for number, walker in zip(ids, walkers, strict=True):
        cell = walker.free_cell(xz)
        if number[cell] >= 0 and abs(walker.sheet.heights[cell] - y) <= STEP:
            return int(number[cell])
    return -1


def _smoothed(
    walkers: Sequence[Walker], ids: np.ndarray, way: np.ndarray, start: np.ndarray, goal: np.ndarray
) -> np.ndarray:
    """A way over surfaces as a line on the ground: parts as long as one sheet holds them, each smoothed there."""
    sheet = walkers[0].sheet
    count = int(max(walker.sheet.surface.max() for walker in walkers)) + 1
    cells = np.stack(np.divmod(way // count, sheet.level.shape[1]), axis=1)
    holds = ids[:, cells[:, 0], cells[:, 1]] == way
    places = np.concatenate([start[None], cells * sheet.cell + sheet.origin, goal[None]])
    holds = np.concatenate([holds[:, :1], holds, holds[:, -1:]], axis=1)
    parts: list[np.ndarray] = []
    at = 0
    while at < len(places) - 1:
        ends = [at + int(np.argmin(np.append(row[at:], False))) for row in holds]
        best = int(np.argmax(ends))
        part = walkers[best].smoothed(places[at : ends[best]])
        parts.append(part if not parts else part[1:])
        at = max(ends[best] - 1, at + 1)
    return np.concatenate(parts)
