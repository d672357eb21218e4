"""How far every node of a lattice is from the nearest triangle.

Within `BAND` voxels of a surface distances are exact: triangles are splatted into the nodes around them. Beyond, a node
measures to the triangle of the surface node that is nearest to it (a feature transform). Every point of a surface has
a surface node within sqrt(3) / 2 voxels, and such a node has its triangle within as much, so what is found is never too
small, and too large by at most sqrt(3) voxels: d(p) <= |p - s| + sqrt(3) / 2 <= exact + sqrt(3).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from scenes.kernels import parts, spans
from scenes.kernels.feature import SEED, measured, nearest_triangles, numbered, records, seeds_in_plane
from scenes.kernels.splat import binned, splat
from scenes.mesh.surface import Surface
from scenes.sdf.lattice import Lattice

BAND = 2.0
"""Voxels within which distances are exact."""

FAR_ERROR = float(np.sqrt(3.0))
"""Voxels by which a distance beyond the band may be too large."""

SLAB = 4
"""Planes of nodes that one piece of work splats: fixed, so that results do not depend on the number of threads."""


@dataclass(frozen=True, eq=False)
class Soup:
    """Triangles in the coordinates of a lattice: nodes are at whole numbers.

    Attributes:
        vertices: ``[V, 3]`` float64, voxels.
        faces: ``[F, 3]`` int32, slivers included: they close seams, and distances to them are as good as any.
        lattice: whose voxels.
    """

    vertices: np.ndarray
    faces: np.ndarray
    lattice: Lattice

    @classmethod
    def of(cls, surface: Surface, lattice: Lattice) -> Soup:
        """A surface seen from a lattice."""
        offset = surface.centre - np.array(lattice.origin)
        faces = np.concatenate([surface.faces, surface.slivers]).astype(np.int32)
        return cls((surface.vertices + offset) / lattice.spacing, faces, lattice)

    @property
    def slabs(self) -> int:
        """Number of slabs of `SLAB` planes."""
        return -(-self.lattice.shape[0] // SLAB)

    @cached_property
    def _bins(self) -> tuple[np.ndarray, np.ndarray]:
        offsets, members = binned(self.vertices, self.faces, 0, BAND, SLAB, self.slabs)
        return offsets, members

    def members(self, slab: int) -> np.ndarray:
        """Triangles that come within `BAND` of a slab, ascending."""
        offsets, members = self._bins
        return members[offsets[slab] : offsets[slab + 1]]

    def planes(self, slab: int) -> tuple[int, int]:
        """First plane of a slab, and the one after its last."""
        return SLAB * slab, min(SLAB * (slab + 1), self.lattice.shape[0])


def unsigned(soup: Soup, threads: int | None = None) -> np.ndarray:
    """Distance (voxels) from every node to the nearest triangle, ``[X, Y, Z]`` float32."""
    shape = soup.lattice.shape
    squared, nearest = _band(soup, threads)
    place, triangle, record = _seeds(soup, squared, nearest)
    parts(lambda x: seeds_in_plane(squared, x, nearest), shape[0], threads)

    def beyond(y: int) -> None:
        far = np.empty((shape[0], shape[2]), dtype=np.int32)
        nearest_triangles(nearest, place, triangle, y, far)
        measured(record.reshape(-1), y, np.float32(BAND * BAND), far, squared)

    parts(beyond, shape[1], threads)
    spans(lambda begin, end: np.sqrt(squared[begin:end], out=squared[begin:end]), shape[0], SLAB, threads)
    return squared


def _band(soup: Soup, threads: int | None) -> tuple[np.ndarray, np.ndarray]:
    """Squared distances (voxels²) within the band, infinite beyond, and the nearest triangles."""
    squared = np.empty(soup.lattice.shape, dtype=np.float32)
    nearest = np.empty(soup.lattice.shape, dtype=np.int32)

    def slab(i: int) -> None:
        begin, end = soup.planes(i)
        squared[begin:end] = np.inf
        splat(soup.vertices, soup.faces, soup.members(i), BAND, begin, end, squared, nearest)

    parts(slab, soup.slabs, threads)
    return squared, nearest


def _seeds(soup: Soup, squared: np.ndarray, nearest: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Number the seeds in `nearest`; returns place and triangle of each, and the triangles' records."""
    place, triangle, used = numbered(squared, nearest, len(soup.faces))
    record = np.empty((len(used), 16), dtype=np.float32)
    records(soup.vertices, soup.faces, used, record)
    return place, triangle, record


@dataclass(frozen=True, eq=False)
class Seeds:
    """The nodes beside a surface, to whose triangles all others measure.

    Attributes:
        number: which seed a node is, ``[X, Y, Z]`` int32; -1 where it is none.
        place, triangle, record: of `scenes.kernels.feature`.
    """

    number: np.ndarray
    place: np.ndarray
    triangle: np.ndarray
    record: np.ndarray

    @classmethod
    def of(cls, soup: Soup, threads: int | None = None) -> Seeds:
        """The seeds of a surface; its lattice must hold the surface and the band around it."""
        squared, nearest = _band(soup, threads)
        place, triangle, record = _seeds(soup, squared, nearest)
        return cls(np.where(squared <= SEED, nearest, np.int32(-1)), place, triangle, record)
