"""The connected pieces of a surface: which are closed, and how they lie in each other."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from scenes.kernels import weld
from scenes.mesh.surface import Faults, Surface
from scenes.mesh.winding import Dipoles

MANY = 1024
"""Closed pieces of which is asked what lies in them: the largest."""

SPREAD = 64
"""Corners, and other points, by which is told whether a piece lies in another wholly."""

FLAT = 1e-6
"""Volume over area to the power 3/2 up to which a closed piece encloses nothing: a sheet with two sides. A ball has
0.094, a slab of 2 x 2 m and 0.1 mm thickness 2e-5."""


@dataclass(frozen=True, eq=False)
class Pieces:
    """Connected pieces of a surface.

    Attributes:
        surface: the whole.
        of_face: piece of each triangle, those of no area after the others, ``[F + S]``.
        closed: no unmatched edge, and encloses something, ``[P]``.
        volume: that a closed piece encloses, negative where it faces inward, m³, ``[P]``.
        area: m², ``[P]``.
    """

    surface: Surface
    of_face: np.ndarray
    closed: np.ndarray
    volume: np.ndarray
    area: np.ndarray

    @classmethod
    def of(cls, surface: Surface) -> Pieces:
        """The pieces of a surface. Solids that touch at corners, edges or faces are pieces of their own."""
        every, vertices = np.concatenate([surface.faces, surface.slivers]), len(surface.vertices)
        keys = weld.edge_keys(every, vertices)
        order = np.argsort(keys)
        patch, count = weld.patched(keys, order)
        of_face, torn = patch.astype(np.int64), weld.torn(keys, order, patch, count)
        if torn.any() and (loose := np.flatnonzero(torn[of_face])).size:
            # patches that end where others do may bound solids together
            whole, together = weld.connected(every[loose], vertices)
            ends = Faults.of(every[loose], vertices).unmatched
            open_ = np.bincount(whole[ends[:, 0]], minlength=together) > 0
            group = whole[every[loose, 0]]
            closed = ~open_[group]
            of_face[loose] = count + group
            if closed.any():
                of_face[loose[closed]] = count + together + _split(surface.vertices, every[loose[closed]])
            torn = np.concatenate([torn, open_, np.zeros(len(closed), dtype=bool)])
            used, of_face = np.unique(of_face, return_inverse=True)
            torn = torn[used]
        a, b, c = np.moveaxis(surface.vertices[surface.faces], 1, 0)
        piece, count = of_face[: len(surface.faces)], len(torn)
        area = np.bincount(piece, weld.areas(surface.vertices, surface.faces), count)
        volume = np.bincount(piece, (a * np.cross(b, c)).sum(axis=1) / 6, count)
        closed = ~torn & (np.abs(volume) > FLAT * area**1.5)
        return cls(surface, of_face, closed, volume, area)

    def part(self, pieces: np.ndarray) -> Surface | None:
        """The pieces that are True in ``[P]`` as a surface of their own; None where there are none."""
        if not pieces.any():
            return None
        chosen, count = pieces[self.of_face], len(self.surface.faces)
        every = self.surface.faces[chosen[:count]], self.surface.slivers[chosen[count:]]
        return self.surface.part(*every)

    def triangles(self, piece: int) -> np.ndarray:
        """Those of a piece, with those of no area, ``[n, 3]``."""
        every, order, starts = self._sorted
        return np.asarray(every[order[starts[piece] : starts[piece + 1]]])

    @cached_property
    def _sorted(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """All triangles, their order by pieces, and where in it each piece begins."""
        starts = np.searchsorted(
            self.of_face, np.arange(len(self.closed) + 1), sorter=(order := np.argsort(self.of_face))
        )
        return np.concatenate([self.surface.faces, self.surface.slivers]), order, starts

    @cached_property
    def boxes(self) -> np.ndarray:
        """Lowest and highest corner of each piece, relative to the surface's centre, ``[P, 2, 3]`` metres."""
        every = np.concatenate([self.surface.faces, self.surface.slivers])
        return np.asarray(weld.boxes(self.surface.vertices, every, self.of_face, len(self.closed)))

    @cached_property
    def holders(self) -> dict[int, list[int]]:
        """For each closed piece the closed ones that it lies in wholly, the smallest first; large pieces come first."""
        size = np.prod(self.boxes[:, 1] - self.boxes[:, 0], axis=1)
        order = np.flatnonzero(self.closed)
        order = order[np.argsort(-size[order], kind="stable")]
        found: dict[int, list[int]] = {int(piece): [] for piece in order}
        for place, outer in enumerate(order[:MANY]):
            box, rest = self.boxes[outer], order[place + 1 :]
            slack = 1e-9 * (box[1] - box[0]).max()
            within = (self.boxes[rest, 0] >= box[0] - slack) & (self.boxes[rest, 1] <= box[1] + slack)
            some = rest[within.all(axis=1)]
            if len(some) == 0:
                continue
            own = self._dipoles(int(outer))
            held = some[_within(own, self.probes[some].reshape(-1, 3)).reshape(-1, 2).all(axis=1)]
            for inner in held:
                if len(held) > MANY or _within(own, self.spread(int(inner))).all():
                    found[int(inner)].insert(0, int(outer))
        return found

    def spread(self, piece: int) -> np.ndarray:
        """Corners and other points of a piece, drawn in by a little so that none lies on a piece that it touches."""
        own = self.surface.part(self.triangles(piece), faults=self.surface.faults)
        rng = np.random.default_rng(0)
        corners = own.vertices[np.unique(own.faces)]
        points = np.concatenate([corners[:: -(-len(corners) // SPREAD)], own.points_on(own.by_area(SPREAD, rng), rng)])
        middle = self.boxes[piece].mean(axis=0)
        return np.asarray(middle + (1 - 1e-5) * (points - middle))

    @cached_property
    def probes(self) -> np.ndarray:
        """Two points just inside each closed piece, under its largest triangles, ``[P, 2, 3]``, as `boxes`."""
        faces, count = self.surface.faces, len(self.surface.faces)
        some = np.flatnonzero(self.closed[self.of_face[:count]])
        order = some[np.lexsort((-weld.areas(self.surface.vertices, faces[some]), self.of_face[some]))]
        piece, first = np.unique(self.of_face[order], return_index=True)
        pair = np.stack([first, np.minimum(first + 1, np.append(first[1:], len(order)) - 1)], axis=1)
        a, b, c = np.moveaxis(self.surface.vertices[faces[order[pair]]], 2, 0)
        normal = np.cross(b - a, c - a)
        normal /= np.linalg.norm(normal, axis=-1, keepdims=True)
        depth = 1e-5 * (self.boxes[piece, 1] - self.boxes[piece, 0]).max(axis=1) * np.sign(self.volume[piece])
        points = np.zeros((len(self.closed), 2, 3))
        points[piece] = (a + b + c) / 3 - depth[:, None, None] * normal
        return points

    def around(self, point: np.ndarray) -> list[int]:
        """Closed pieces that hold a point ``[3]`` (m, as `boxes`), whichever way they face, the smallest first."""
        near = np.all((self.boxes[:, 0] <= point) & (point <= self.boxes[:, 1]), axis=1)
        return [i for i in list(self.holders)[::-1] if near[i] and _within(self._dipoles(i), point[None])[0]]

    def hold(self, piece: int, points: np.ndarray) -> np.ndarray:
        """True at those of ``[n, 3]`` points (m, as `boxes`) that a closed piece encloses, whichever way it faces."""
        return _within(self._dipoles(piece), points)

    def _dipoles(self, piece: int) -> Dipoles:
        used, own = np.unique(self.triangles(piece), return_inverse=True)
        return Dipoles.of(self.surface.vertices[used], own.reshape(-1, 3).astype(np.int32))


def _within(piece: Dipoles, points: np.ndarray) -> np.ndarray:
    return np.asarray(np.abs(piece.at(points)) > 0.5)


def _split(vertices: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """Number of the solid that each of some closed triangles ``[F, 3]`` bounds, where several touch along edges.

    Around such an edge a triangle goes on with the one that bounds the same matter, which is the next on the side that
    it does not face; at a plain seam there is but one.
    """
    from scipy.sparse import coo_matrix
    from scipy.sparse.csgraph import connected_components

    start, end = faces.reshape(-1), np.roll(faces, -1, axis=1).reshape(-1)
    along = start < end
    a, b = vertices[np.minimum(start, end)], vertices[np.maximum(start, end)]
    axis = (b - a) / np.linalg.norm(b - a, axis=1, keepdims=True)
    reference = np.eye(3)[np.abs(axis).argmin(axis=1)]
    u = np.cross(axis, reference)
    v, to = np.cross(axis, u), vertices[np.roll(faces, -2, axis=1).reshape(-1)] - a
    angle = np.arctan2((to * v).sum(axis=1), (to * u).sum(axis=1))
    angle = angle.round(9)  # of triangles on each other it differs by rounding
    edge = np.minimum(start, end).astype(np.int64) * len(vertices) + np.maximum(start, end)
    order = np.lexsort((~along, angle, edge))  # of two on each other, first the one whose matter lies before
    first = np.flatnonzero(np.append(True, np.diff(edge[order]) != 0))
    last = np.append(first[1:], len(order)) - 1
    before = np.arange(len(order)) - 1
    before[first] = last
    ahead = along[order]
    one, other = order[ahead] // 3, order[before[ahead]] // 3
    graph = coo_matrix((np.ones(len(one), dtype=bool), (one, other)), shape=(len(faces), len(faces)))
    return np.asarray(connected_components(graph, directed=False)[1])
