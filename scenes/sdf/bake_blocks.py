"""From triangles to `SdfBlocks`, without ever holding the dense grid.

The coarse nodes are baked like any grid. Then bricks of 8 x 8 x 8 coarse cells are taken column by column: exact
distances on the fine nodes of the cells near surfaces, signs, and for each cell the coarsest division that is true to
them. Large plain walls need no block at all; edges, stairs, furniture, thin walls and curved surfaces do.
"""

from __future__ import annotations

import hashlib
from dataclasses import dataclass, field
from functools import partial

import numpy as np

from scenes.errors import UserError
from scenes.kernels import blocks as kernels, parts, rays, regions, spans
from scenes.kernels.blocks import BRICK, CELL, LEVELS, SIDE
from scenes.mesh.mesh import Mesh
from scenes.sdf.bake import FORMAT, Bake, cached, sided
from scenes.sdf.blocks import SdfBlocks
from scenes.sdf.distances import Soup, unsigned
from scenes.sdf.doubts import doubts_about
from scenes.sdf.free_space import Sides
from scenes.sdf.lattice import Lattice
from scenes.sdf.settings import BakeSettings, Cache, FreeSpace
from scenes.sdf.signs import grown, sign
from scenes.sdf.thin import thin_doubts

BAND = 2.0
"""Fine voxels from the surface within which cells are divided where that is needed."""

TOLERANCE = 0.2
"""Fine voxels by which a cell's interpolant may err near the surface."""

SLOPE = 0.5
"""Error that it may have as a share of the distance, where that is more."""

_CHUNK = 1 << 14  # blocks that one thread takes

LARGEST = 2**27
"""Coarse nodes of the largest scene: 1 GB, and 4 GB while it is baked."""


def bake_blocks(
    mesh: Mesh,
    spacing: float | int,
    padding: float | int = 0.1,
    free_space: FreeSpace = "auto",
    cache: Cache = "default",
    threads: int | None = None,
    tolerance: float | int = TOLERANCE,
    slope: float | int = SLOPE,
) -> Bake[SdfBlocks]:
    """Signed distances of a mesh, positive in free space, fine near surfaces and coarse elsewhere.

    Within `BAND` fine voxels of the surface the interpolant differs from exact distances at the fine nodes by at most
    `tolerance` voxels, or `slope` times the distance where that is more; farther away it is that of a grid with eight
    times the spacing.

    Args:
        mesh: any triangles, as `scenes.sdf.bake.bake` takes them.
        spacing: metres between the finest nodes.
        padding: metres added to the bounds on each side, 0 to 100.
        free_space: the rule of `scenes.sdf.bake.bake`.
        cache: folder of earlier bakes; "default" for `default_cache`, None for none.
        threads: at most so many; default, all processors. They do not change the result.
        tolerance: fine voxels, 0 to 1; with `slope` 0 too every cell within the band is divided in 8.
        slope: 0 to 1.

    Raises:
        UserError: numbers out of range, an unknown rule, a mesh without area or too large for its spacing, or a seed
            point outside the padded bounds or on a surface.
    """
    asked = BakeSettings(free_space=free_space, padding=padding, spacing=spacing)
    for what, number in (("tolerance", tolerance), ("slope", slope)):
        if not 0 <= number <= 1:
            raise UserError(f"bake {what} is {number}; give 0 to 1")
    lattice, rule = coarse_lattice(mesh, float(spacing), float(padding)), asked.free_space
    how = (float(tolerance), float(slope))
    facts = (FORMAT, "blocks", mesh.digest, mesh.name, lattice, rule, *how)
    key = hashlib.sha256(repr(facts).encode()).hexdigest()
    return cached(cache, key, SdfBlocks, lambda: _baked(mesh, lattice, rule, *how, threads))


def coarse_lattice(mesh: Mesh, spacing: float, padding: float) -> Lattice:
    """The coarse nodes around a mesh; raises UserError where there would be too many."""
    size = np.ptp(mesh.bounds, axis=0) + 2 * padding
    nodes = float(np.prod(np.ceil(size / (CELL * spacing)) + 1))
    if nodes > LARGEST:
        enough = spacing * (nodes / LARGEST) ** (1 / 3)
        extent = " x ".join(f"{length:.4g}" for length in size)
        raise UserError(
            f"bake spacing is {spacing:g} m, for which mesh '{mesh.name}' of {extent} m needs {nodes * 8 / 1e9:.3g} GB"
            f" without its details; give {float(f'{1.05 * enough:.2g}'):g} m or more"
        )
    return Lattice.spaced(mesh.bounds, CELL * spacing, padding, BRICK)


def _baked(
    mesh: Mesh, lattice: Lattice, free_space: FreeSpace, tolerance: float, slope: float, threads: int | None
) -> Bake[SdfBlocks]:
    sides = sided(mesh, free_space, lattice)
    rule, soup = sides.rule, Soup.of(sides.surface, lattice)
    coarse = unsigned(soup, threads)
    signs = sign(coarse, soup, sides, lattice.spacing, threads)
    grid = _Builder(sides, soup, lattice, coarse, tolerance, slope, threads).built()
    walls_lost = thin_doubts(sides, grid.near, grid.spacing, mesh.name)
    doubts = doubts_about(coarse, signs, sides, lattice, mesh.name, walls_lost)
    return Bake(grid, rule.name, signs, rule.inward, rule.message, doubts)


@dataclass
class _Found:
    """What one column of bricks gives: blocks of each level and the coarse cells that they divide."""

    cells: list[list[np.ndarray]] = field(default_factory=lambda: [[] for _ in range(LEVELS)])
    values: list[list[np.ndarray]] = field(default_factory=lambda: [[] for _ in range(LEVELS)])


@dataclass(eq=False)
class _Builder:
    """Bricks over a coarse lattice, and the triangles in the coordinates of the fine one."""

    sides: Sides
    soup: Soup
    lattice: Lattice
    coarse: np.ndarray
    tolerance: float
    slope: float
    threads: int | None

    def __post_init__(self) -> None:
        self.spacing = self.lattice.spacing / CELL
        self.cells = tuple(n - 1 for n in self.lattice.shape)
        self.bricks = tuple(n // BRICK for n in self.cells)
        self.vertices, self.faces = CELL * self.soup.vertices, self.soup.faces
        self.closed = self.sides.sheets is None
        self.bits = rays.fraction_bits(CELL * max(self.lattice.shape))
        # The nearest triangle of a point in a cell within the band is no farther from its brick than this.
        reach = BAND + 1.5 * np.sqrt(3.0) * CELL
        self.near = kernels.near_bricks(self.vertices, self.faces, self.bricks, reach)
        if self.closed:
            self.over = kernels.over_columns(self.vertices, self.faces, self.bricks[0], self.bricks[2])

    def built(self) -> SdfBlocks:
        """All columns, put together."""
        found = parts(self._column, self.bricks[0] * self.bricks[2], self.threads)
        index = np.full(self.cells, -1, dtype=np.int32)
        cells, blocks = [], []
        for level in range(LEVELS):
            pieces = [piece for column in found for piece in column.cells[level]]
            cells.append(np.concatenate(pieces) if pieces else np.empty((0, 3), dtype=np.int32))
            blocks.append(self._put_together(found, level, len(cells[level])))
            index[tuple(cells[level].T)] = LEVELS * np.arange(len(cells[level])) + level
        if not self.closed:
            for level in range(LEVELS):
                kernels.adopted(index, cells[level], level + 1, tuple(blocks), blocks[level])
        for level in range(LEVELS):
            join = partial(kernels.joined, index, cells[level], level + 1, blocks[level])
            spans(join, len(blocks[level]), _CHUNK, self.threads)
        origin = np.array(self.lattice.origin)
        margin = self.lattice.margin(self.sides.surface.bounds)
        return SdfBlocks(self.coarse, index, tuple(blocks), origin, self.spacing, self.sides.beyond, margin)

    def _put_together(self, found: list[_Found], level: int, count: int) -> np.ndarray:
        """The blocks of one level; columns free theirs on the way."""
        nodes = (2 << level) + 1
        values, at = np.empty((count, nodes, nodes, nodes), dtype=np.int16), 0
        for column in found:
            for piece in column.values[level]:
                values[at : at + len(piece)] = piece
                at += len(piece)
            column.values[level].clear()
        return values

    def _column(self, column: int) -> _Found:
        """The bricks with the same x and z."""
        i, k = divmod(column, self.bricks[2])
        found = _Found()
        distance = np.empty((SIDE + 1,) * 3, dtype=np.float32)
        near, level = np.empty((BRICK,) * 3, dtype=np.uint8), np.empty((BRICK,) * 3, dtype=np.uint8)
        winding = None
        for j in range(self.bricks[1]):
            brick, corner = (i * self.bricks[1] + j) * self.bricks[2] + k, (SIDE * i, SIDE * j, SIDE * k)
            members = self.near[1][self.near[0][brick] : self.near[0][brick + 1]]
            if len(members) == 0:
                continue
            distance[:] = np.inf
            if not kernels.brick_distances(self.vertices, self.faces, members, corner, BAND, distance, near):
                continue
            x, y, z = BRICK * i, BRICK * j, BRICK * k
            coarse = self.coarse[x : x + BRICK + 1, y : y + BRICK + 1, z : z + BRICK + 1]
            if self.closed:
                winding = self._winding(i, k) if winding is None else winding
                kernels.signed_by_rays(winding, SIDE * j, *self.sides.rule.solids, distance)
            else:
                self._sign_by_regions(members, corner, coarse, distance)
            kernels.settled(np.float32(self.spacing), near, distance, coarse, not self.closed)
            counts = kernels.chosen(distance, near, self.tolerance, self.slope, level)
            for n in np.flatnonzero(counts[1:]):
                nodes = (2 << int(n)) + 1
                cells = np.empty((counts[n + 1], 3), dtype=np.int32)
                values = np.empty((counts[n + 1], nodes, nodes, nodes), dtype=np.int16)
                kernels.gathered(distance, level, n + 1, cells, values)
                found.cells[n].append(cells + np.array([x, y, z], dtype=np.int32))
                found.values[n].append(values)
        return found

    def _winding(self, i: int, k: int) -> np.ndarray:
        """Winding numbers on all fine nodes of a column of bricks of a closed mesh, ``[x, z, y]``."""
        column = i * self.bricks[2] + k
        members = self.over[1][self.over[0][column] : self.over[0][column + 1]]
        counts = np.zeros((SIDE + 1, SIDE + 1, SIDE * self.bricks[1] + 1), dtype=np.int16)
        none = np.zeros((0, 0, 0), dtype=np.uint8)
        corners, faces = self._apart(members, (SIDE * i, 0, SIDE * k))
        rays.crossings(corners, faces, np.arange(len(faces)), (0, 2, 1), self.bits, 0, SIDE + 1, 0, counts, none, 0)
        kernels.summed(counts)
        return counts

    def _apart(self, members: np.ndarray, corner: tuple[int, int, int]) -> tuple[np.ndarray, np.ndarray]:
        """Some triangles as vertices and faces of their own, in coordinates that begin at a fine node."""
        vertices = self.vertices[self.faces[members]].reshape(-1, 3) - np.array(corner, dtype=np.float64)
        return vertices, np.arange(len(vertices), dtype=np.int32).reshape(-1, 3)

    def _sign_by_regions(
        self, members: np.ndarray, corner: tuple[int, int, int], coarse: np.ndarray, distance: np.ndarray
    ) -> None:
        """Carry the signs of the coarse nodes to the nodes between which no surface passes, in place.

        What no coarse node lies in, such as the inside of a thin wall, asks for its winding number.
        """
        side = SIDE + 1
        kernels.filled(np.abs(coarse) / np.float32(self.spacing), distance)
        vertices, faces = self._apart(members, corner)
        all_of_them = np.arange(len(faces))
        crossed = np.zeros((side + 1,) * 3, dtype=np.uint8)  # the last nodes collect what lies beyond the brick
        for axes, flag in (((0, 1, 2), 1), ((0, 2, 1), 2), ((1, 2, 0), 4)):
            counts = np.zeros(crossed.shape, dtype=np.int16)
            marks = crossed.transpose(axes)
            rays.crossings(vertices, faces, all_of_them, axes, self.bits, 0, side + 1, 0, counts, marks, flag)
        edges = np.ascontiguousarray(crossed[:side, :side, :side]).reshape(-1)
        free = self._free(distance, edges, coarse, np.array(corner))
        distance.reshape(-1)[~free] *= -1

    def _free(self, distance: np.ndarray, edges: np.ndarray, coarse: np.ndarray, corner: np.ndarray) -> np.ndarray:
        """Which nodes of a brick are free, flat: by regions, and where a region leaks by growing from coarse nodes."""
        flat, shape = distance.reshape(-1), distance.shape
        region = np.empty(flat.size, dtype=np.int32)
        count = regions.regions(flat, edges, shape, region)
        votes = np.zeros(shape, dtype=np.uint8)  # of the coarse nodes alone, as `scenes.sdf.signs` writes them
        votes[::CELL, ::CELL, ::CELL] = np.where(coarse < 0, 16, 1)
        for_free, for_solid, deepest = regions.tally(region, votes.reshape(-1), flat, count)
        free = for_free > 0
        silent = np.flatnonzero(for_free + for_solid == 0)
        free[silent] = self._asked(deepest[silent], shape, corner)
        free = free[region]
        torn = ((for_free > 0) & (for_solid > 0))[region]
        if torn.any():
            label = np.where(torn, votes.reshape(-1).clip(max=2), 0).astype(np.int8)
            parent = grown(flat, edges, shape, torn, label, lambda nodes: self._asked(nodes, shape, corner))
            free[torn] = label[parent[torn]] == 1
        return free

    def _asked(self, nodes: np.ndarray, shape: tuple[int, ...], corner: np.ndarray) -> np.ndarray:
        """Whether space is free at nodes of a brick (flat indices), by their winding numbers."""
        index = np.stack(np.unravel_index(nodes, shape), axis=-1) + corner
        points = np.array(self.lattice.origin) + self.spacing * index
        return self.sides.by_winding(points, threads=1)
