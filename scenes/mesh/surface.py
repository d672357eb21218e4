"""A mesh made fit for questions of distance and of inside or outside, and libigl's answers to them.

These answers are slow and right: they are the oracle against which grids and motions are scored. Distances
never come from a winding number, whose approximation ruins them on soups.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from scenes.errors import UserError
from scenes.kernels import weld
from scenes.mesh.mesh import Mesh
from scenes.mesh.winding import Dipoles

NEARLY_CLOSED = 0.005
"""Share of unmatched edges up to which a mesh counts as closed with a few holes, as room scans are."""


HOLES = 0.05
"""Share of the area that its holes may have: a door and a window of a small room. Counted in edges alone, any surface
that is cut finely enough would be nearly closed."""


DOUBLED = 0.9
"""Share of the triangles of a piece that have a twin on their back from which on the piece is one with two sides."""


def clean(vertices: np.ndarray, faces: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Merge equal vertices, drop repeated and collapsed triangles.

    A triangle stored twice would count twice in the winding number. Slivers of no area are kept apart: a seam that they
    fill is no hole.

    Returns:
        vertices ``[V, 3]``, faces ``[F, 3]``, slivers ``[S, 3]``.
    """
    bits = (np.ascontiguousarray(vertices, dtype=np.float64) + 0.0).view(np.int64)  # -0 becomes 0
    index, kept = weld.welded(bits, _table(len(vertices)))
    unique = np.ascontiguousarray(vertices[kept], dtype=np.float64)
    distinct = weld.distinct(faces, index, _table(len(faces)))
    flat = weld.slivers(unique, distinct)
    return unique, distinct[~flat], distinct[flat]


@dataclass(frozen=True, eq=False)
class Faults:
    """Edges of some triangles that are no plain seams between two, as both ends, ``[n, 2]`` vertices.

    Attributes:
        unmatched: used more often in one direction than in the other; none where the triangles are closed.
        twisted: of these, those between two triangles that face opposite ways, ``[n]``.
        crowded: used more than twice.
    """

    unmatched: np.ndarray
    twisted: np.ndarray
    crowded: np.ndarray

    @classmethod
    def of(cls, faces: np.ndarray, vertices: int) -> Faults:
        """The faults of triangles ``[F, 3]`` between so many vertices."""
        keys = weld.edge_keys(faces, vertices)
        keys.sort()
        unmatched, twisted, crowded = weld.faulty(keys)
        ends, many = (np.stack(np.divmod(edges, vertices), axis=1) for edges in (unmatched, crowded))
        return cls(ends, twisted, many)


def _turned(vertices: np.ndarray, faces: np.ndarray, faults: Faults) -> np.ndarray:
    """True at triangles that face against their neighbours: in each patch the side with more area is right, ``[F]``."""
    import igl

    piece, count = weld.connected(faces, len(vertices))
    ill = np.zeros(count, dtype=bool)
    ill[piece[faults.unmatched[faults.twisted, 0]]] = True
    some = np.flatnonzero(ill[piece[faces[:, 0]]])
    consistent, patch = igl.bfs_orient(faces[some].astype(np.int64))
    against = (consistent != faces[some]).any(axis=1)
    area = weld.areas(vertices, faces[some])
    share = np.bincount(patch, area * against) / np.maximum(np.bincount(patch, area), 1e-300)
    turned = np.zeros(len(faces), dtype=bool)
    turned[some] = against != (share > 0.5)[patch]
    return turned


def _undoubled(faces: np.ndarray, crowded: np.ndarray, vertices: int) -> np.ndarray:
    """One side of the pieces whose triangles nearly all have a second side, so that what they enclose is told."""
    of_vertex, pieces = weld.connected(faces, vertices)
    piece = of_vertex[faces[:, 0]]
    size = np.bincount(piece, minlength=pieces)
    # two sides of a closed piece have three edges for each four triangles, each used four times
    some = np.bincount(of_vertex[crowded[:, 0]], minlength=pieces) >= DOUBLED / 2 * size
    own = np.flatnonzero((some & (size > 0))[piece])
    _, first, which, count = np.unique(
        np.sort(faces[own], axis=1), axis=0, return_index=True, return_inverse=True, return_counts=True
    )
    twin = count[which.reshape(-1)] > 1
    doubled = np.bincount(piece[own], twin, pieces) >= DOUBLED * size
    second = np.ones(len(own), dtype=bool)
    second[first] = False
    return np.delete(faces, own[second & twin & doubled[piece[own]]], axis=0)


def _table(entries: int) -> np.ndarray:
    """An empty hash table, at most half full."""
    return np.full(1 << (2 * entries - 1).bit_length(), -1, dtype=np.int32)


def sheets(surface: Surface, thickness: float) -> np.ndarray:
    """Triangles ``[n, 3]`` of the connected pieces that are open, or on average thinner than `thickness` (m).

    The mean thickness of a closed piece is twice its volume over its area.
    """
    faces, count = surface.faces, len(surface.vertices)
    of_vertex, pieces = weld.connected(faces, count)
    piece = of_vertex[faces[:, 0]]
    a, b, c = np.moveaxis(surface.vertices[faces], 1, 0)
    area = np.bincount(piece, np.linalg.norm(np.cross(b - a, c - a), axis=1) / 2, pieces)
    volume = np.bincount(piece, (a * np.cross(b, c)).sum(axis=1) / 6, pieces)
    thin = 2 * np.abs(volume) < thickness * area
    for which in np.flatnonzero(~thin & (area > 0)):
        own = faces[piece == which]
        thin[which] = not surface.part(own).nearly_closed
    return np.asarray(faces[thin[piece]])


def thin_walls(surface: Surface, thickness: float | int) -> Surface | None:
    """The `sheets` of a surface as one of their own; None without any, or where no thickness is wanted."""
    thin = sheets(surface, thickness) if thickness > 0 else surface.faces[:0]
    return surface.part(thin) if len(thin) else None


@dataclass(frozen=True, eq=False)
class Surface:
    """The triangles of a mesh, cleaned, around their own centre so that single precision suffices.

    Its triangles face as their neighbours do: what a file states for single ones cannot be trusted.

    Attributes:
        vertices: ``[V, 3]`` metres, relative to `centre`.
        faces: ``[F, 3]`` int32, those with an area.
        slivers: ``[S, 3]`` int32, those without.
        centre: middle of the bounds, world metres, ``[3]``.
        faults: its edges that are no plain seams.
        turned: triangles that were turned to face as their neighbours do.
    """

    vertices: np.ndarray
    faces: np.ndarray
    slivers: np.ndarray
    centre: np.ndarray
    faults: Faults
    turned: int = 0

    @classmethod
    def of(cls, mesh: Mesh) -> Surface:
        """Clean a mesh; raises UserError when no triangle with an area is left."""
        vertices, faces, slivers = clean(mesh.vertices, mesh.faces)
        if len(faces) == 0:
            raise UserError(f"mesh '{mesh.name}' has only triangles without area; export it again")
        used = np.zeros(len(vertices), dtype=bool)
        used[faces] = used[slivers] = True
        place = (np.cumsum(used) - 1).astype(np.int32)
        kept = vertices[used]
        centre = (kept.min(axis=0) + kept.max(axis=0)) / 2
        return cls.facing_alike(kept - centre, place[faces], place[slivers], centre)

    @classmethod
    def facing_alike(cls, vertices: np.ndarray, faces: np.ndarray, slivers: np.ndarray, centre: np.ndarray) -> Surface:
        """Cleaned triangles, each turned as most of its patch face; arguments as the attributes."""
        every = np.concatenate([faces, slivers])
        faults = Faults.of(every, len(vertices))
        if len(faults.crowded) and len(single := _undoubled(faces, faults.crowded, len(vertices))) < len(faces):
            faces, every = single, np.concatenate([single, slivers])
            faults = Faults.of(every, len(vertices))
        turned = np.zeros(len(every), dtype=bool)
        if faults.twisted.any():
            turned = _turned(vertices, every, faults)
            every[turned] = every[turned][:, ::-1]
            faults = Faults.of(every, len(vertices))
        kinds = every[: len(faces)], every[len(faces) :]
        return cls(vertices, *kinds, centre, faults, int(turned.sum()))

    def part(self, faces: np.ndarray, slivers: np.ndarray | None = None, faults: Faults | None = None) -> Surface:
        """Some of its triangles ``[n, 3]`` as a surface of their own; `faults` where they are known."""
        slivers = faces[:0] if slivers is None else slivers
        faults = faults or Faults.of(np.concatenate([faces, slivers]), len(self.vertices))
        return Surface(self.vertices, faces, slivers, self.centre, faults)

    def reversed(self) -> Surface:
        """The same triangles, all facing the other way."""
        return replace(self, faces=self.faces[:, ::-1].copy(), slivers=self.slivers[:, ::-1].copy())

    @cached_property
    def bounds(self) -> np.ndarray:
        """Lowest and highest corner, ``[2, 3]``, world metres."""
        return np.stack([self.vertices.min(axis=0), self.vertices.max(axis=0)]) + self.centre

    @property
    def open_edges(self) -> np.ndarray:
        """Both ends of every unmatched edge: where the surface has holes, ``[n, 2, 3]``, world metres."""
        return np.asarray(self.vertices[self.faults.unmatched] + self.centre)

    @property
    def boundary_edges(self) -> int:
        """Number of unmatched edges; 0 for a closed mesh."""
        return len(self.faults.unmatched)

    @property
    def edges(self) -> int:
        """Number of edges, each shared by two triangles."""
        return len(self.faces) * 3 // 2

    @property
    def closed(self) -> bool:
        """No unmatched edge: winding numbers are whole numbers."""
        return self.boundary_edges == 0

    @property
    def kind(self) -> str:
        """ "closed", "nearly closed" or "open"."""
        return "closed" if self.closed else "nearly closed" if self.nearly_closed else "open"

    @property
    def nearly_closed(self) -> bool:
        """Closed but for a few holes, as scans of rooms are: few edges of it end there, and small they are together."""
        return self.boundary_edges <= NEARLY_CLOSED * self.edges and self._holes <= HOLES * float(
            weld.areas(self.vertices, self.faces).sum()
        )

    @cached_property
    def _holes(self) -> float:
        """Area (m²) that the holes have at most: of each rim of length l, the circle's l² / 4π."""
        ends = self.faults.unmatched
        if len(ends) == 0:
            return 0.0
        rim = weld.connected(np.stack([ends[:, 0], *ends.T], axis=1), len(self.vertices))[0][ends[:, 0]]
        lengths = np.bincount(rim, np.linalg.norm(self.vertices[ends[:, 0]] - self.vertices[ends[:, 1]], axis=1))
        return float(np.square(lengths).sum()) / (4 * np.pi)

    def by_area(self, count: int, rng: np.random.Generator) -> np.ndarray:
        """So many triangles at random, each as often as its share of the area, ``[count]``."""
        total = np.cumsum(weld.areas(self.vertices, self.faces))
        found = np.searchsorted(total, rng.uniform(0.0, total[-1], count), side="right")
        return np.asarray(found.clip(max=len(total) - 1))

    def points_on(self, triangles: np.ndarray, rng: np.random.Generator) -> np.ndarray:
        """A random point on each of some triangles, relative to `centre`, ``[n, 3]`` metres."""
        shares = rng.dirichlet(np.ones(3), size=len(triangles))
        return np.asarray(np.einsum("nk,nkc->nc", shares, self.vertices[self.faces[triangles]]))

    def normals(self, triangles: np.ndarray) -> np.ndarray:
        """Unit normals of some triangles, ``[n, 3]``."""
        a, b, c = np.moveaxis(self.vertices[self.faces[triangles]], 1, 0)
        across = np.cross(b - a, c - a)
        return np.asarray(across / np.linalg.norm(across, axis=1, keepdims=True))

    @cached_property
    def dipoles(self) -> Dipoles:
        """Winding numbers for bakes: made in a fraction of the time that libigl's take."""
        return Dipoles.of(self.vertices, self.faces)

    @cached_property
    def _faces64(self) -> np.ndarray:
        return self.faces.astype(np.int64)

    @cached_property
    def _winding_tree(self) -> Any:
        import igl

        tree = igl.FastWindingNumberBVH()
        tree.init(self.vertices, self._faces64)
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
            self.vertices, self._faces64, np.ascontiguousarray(points - self.centre, dtype=np.float64)
        )
        return result

    def unsigned_distance(self, points: np.ndarray) -> np.ndarray:
        """Exact distance (m, double precision) from ``[n, 3]`` world points (m) to the nearest triangle."""
        return np.asarray(np.sqrt(np.maximum(self._nearest(points)[0], 0.0)))

    def closest(self, points: np.ndarray) -> np.ndarray:
        """The nearest point of the surface to each of ``[n, 3]`` world points (m)."""
        return np.asarray(self._nearest(points)[1] + self.centre)

    def _nearest(self, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Squared distances ``[n]`` and nearest points ``[n, 3]``, relative to `centre`."""
        import igl

        if len(points) == 0:
            return np.zeros(0), np.zeros((0, 3))
        squared, _, nearest = igl.point_mesh_squared_distance(
            np.ascontiguousarray(points - self.centre, dtype=np.float64), self.vertices, self._faces64
        )
        return squared, nearest
