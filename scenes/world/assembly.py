"""A scene of named objects on one lattice that is baked again only where an edit changes it.

The field is the minimum of the objects' own: each is baked with signs by its own rule in a window around its bounds,
and measures beyond its window to the triangle of its nearest seed, as `scenes.sdf.distances` does beyond the band. So
every node is exact within `BAND` voxels of the nearest object, and too far by at most `FAR_ERROR` voxels elsewhere.

A node's distance to an object depends on the object and the node alone, to the bit, and the minimum on no order. The
grid is therefore the same whatever was edited before, how often and in which order.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from itertools import count
from typing import TypeAlias

import numpy as np
import torch

from scenes.errors import UserError, did_you_mean
from scenes.kernels import parts, union
from scenes.mesh.mesh import Mesh, hull
from scenes.mesh.surface import Surface
from scenes.motion.frames import transform
from scenes.sdf.bake import bake
from scenes.sdf.distances import Seeds, Soup
from scenes.sdf.grid import SdfGrid
from scenes.sdf.lattice import Lattice
from scenes.sdf.settings import Cache, FreeSpace, check_free_space

TILE = 16
"""Edge (nodes) of the cubes in which is decided whether an object can be nearest."""

MARGIN = 4
"""Nodes between an object's bounds and the end of its window: the band, and one more."""

Box: TypeAlias = tuple[np.ndarray, np.ndarray]
"""First node of a box of the lattice and the one after its last, 3 integers each."""


@dataclass(frozen=True, eq=False)
class _Part:
    """An object where it stands, baked in its window.

    Attributes:
        mesh: as it was added.
        placed: where it stands.
        pose: from the one to the other.
        values: distances in the window, ``[X, Y, Z]``, metres.
        corner: the window's first node on the assembly's lattice.
        window: the window as a lattice.
        beyond: sign of distances outside the window.
        number: which it is among the objects, from 1.
        threads: at most so many.
    """

    mesh: Mesh
    placed: Mesh
    pose: np.ndarray
    values: np.ndarray
    corner: np.ndarray
    window: Lattice
    beyond: float
    number: int
    threads: int | None

    @cached_property
    def seeds(self) -> Seeds:
        """What distances beyond the window are measured to: made when first asked for, a room never needs it."""
        return Seeds.of(Soup.of(Surface.of(self.placed), self.window), self.threads)


class Assembly:
    """Named objects and the signed distances of their union, kept up to date.

    Attributes:
        lattice: the nodes of the grid; objects may reach beyond it.
    """

    def __init__(
        self,
        objects: Mapping[str, Mesh],
        lattice: Lattice | int = 256,
        free_space: FreeSpace = "auto",
        cache: Cache = None,
        threads: int | None = None,
    ) -> None:
        """Bake every object and put them together.

        Args:
            objects: meshes by name, at least one; each has the pose that its vertices give it.
            lattice: the nodes, or how many along the longest side of the objects' bounds with 0.1 m around them.
            free_space: the rule of `scenes.sdf.bake.bake`. A point applies to those objects whose bounds hold it.
            cache: folder of bakes of single objects, "default", or None.
            threads: at most so many; default, all processors. They do not change the result.

        Raises:
            UserError: no objects, or what `bake` and `Lattice` refuse.
        """
        if not objects:
            raise UserError("an assembly has no objects; give at least one mesh")
        if isinstance(lattice, int):
            lattice = Lattice.around(hull([mesh.bounds for mesh in objects.values()]), lattice, padding=0.1)
        self.lattice = lattice
        self.free_space = check_free_space(free_space)
        self.cache: Cache = cache
        self.threads = threads
        self._parts: dict[str, _Part] = {}
        self._values = np.full(lattice.shape, np.inf, dtype=np.float32)
        self._owner = np.zeros(lattice.shape, dtype=np.uint16)
        self._top = np.full([-(-n // TILE) for n in lattice.shape], np.inf, dtype=np.float32)
        self._reach: dict[int, Box] = {}
        self._handed_out = False
        for name, mesh in objects.items():
            self._parts[name] = self._part(name, mesh, np.eye(4))
        self._fill(self._everywhere)

    # ----------------------------------------------------------------------------------------------------- questions

    @property
    def names(self) -> tuple[str, ...]:
        """The objects."""
        return tuple(self._parts)

    def mesh(self, name: str) -> Mesh:
        """An object's mesh where it stands; raises UserError for an unknown name."""
        return self._named(name).placed

    def pose(self, name: str) -> np.ndarray:
        """From an object's mesh as it was added to where it stands, ``[4, 4]``."""
        return self._named(name).pose.copy()

    @property
    def grid(self) -> SdfGrid:
        """The signed distances as they are now; later edits leave a grid that was handed out as it is."""
        self._handed_out = True
        beyond = min(part.beyond for part in self._parts.values())
        origin = torch.tensor(self.lattice.origin, dtype=torch.float64)
        return SdfGrid(torch.from_numpy(self._values), origin, self.lattice.spacing, beyond)

    def full(self) -> Assembly:
        """The same objects baked from nothing: what every edit equals, bit for bit."""
        placed = {name: part.placed for name, part in self._parts.items()}
        return Assembly(placed, self.lattice, self.free_space, None, self.threads)

    # --------------------------------------------------------------------------------------------------------- edits

    def add(self, name: str, mesh: Mesh, pose: np.ndarray | None = None) -> Box:
        """Put a new object into the scene.

        Args:
            name: none of `names`.
            mesh: in metres.
            pose: rigid, ``[4, 4]``, from the mesh's frame to the world; default, as it is.

        Returns:
            The box of nodes outside which nothing changed.

        Raises:
            UserError: a name in use, a pose that is not rigid, or a mesh that cannot be baked; nothing changed then.
        """
        if name in self._parts:
            raise UserError(f"the assembly already has an object '{name}'; move it, or choose another name")
        part = self._part(name, mesh, np.eye(4) if pose is None else pose)
        self._keep_handed_out()
        self._parts[name] = part
        return self._lower(part, self._everywhere)

    def remove(self, name: str) -> Box:
        """Take an object out; returns as `add`. Raises UserError for an unknown name and for the last object."""
        part = self._named(name)
        if len(self._parts) == 1:
            raise UserError(f"'{name}' is the assembly's last object; add another before it goes")
        self._keep_handed_out()
        del self._parts[name]
        return self._vacate(part)

    def move(self, name: str, pose: np.ndarray) -> Box:
        """Give an object another pose, from its mesh as it was added to the world; returns and raises as `add`."""
        old = self._named(name)
        new = self._part(name, old.mesh, pose)
        self._keep_handed_out()
        self._parts[name] = new
        left = self._vacate(old)
        return _hull(left, self._lower(new, self._everywhere))

    # ------------------------------------------------------------------------------------------------------- objects

    def _named(self, name: str) -> _Part:
        if name not in self._parts:
            raise UserError(f"the assembly has no object '{name}'{did_you_mean(name, self._parts)}")
        return self._parts[name]

    def _part(self, name: str, mesh: Mesh, pose: np.ndarray) -> _Part:
        """An object baked where it stands; changes nothing."""
        pose = _rigid(name, pose)
        placed = mesh
        if not np.array_equal(pose, np.eye(4)):
            placed = Mesh(transform(pose, mesh.vertices), mesh.faces, mesh.name, mesh.source)
        corner, window = self._window(placed)
        rule = self.free_space
        if not isinstance(rule, str):
            low, high = placed.bounds
            rule = rule if (low <= rule).all() and (rule <= high).all() else "outside"
        grid = bake(placed, free_space=rule, cache=self.cache, lattice=window, threads=self.threads).grid
        taken = self._reach.keys() | {part.number for part in self._parts.values()}
        number = next(number for number in count(1) if number not in taken)
        if number > np.iinfo(self._owner.dtype).max:
            raise UserError(f"an assembly holds at most {number - 1} objects; merge some meshes")
        return _Part(mesh, placed, pose, grid.values.numpy(), corner, window, grid.beyond, number, self.threads)

    def _window(self, mesh: Mesh) -> tuple[np.ndarray, Lattice]:
        """The nodes around a mesh: all, if it is as long as half the lattice, as rooms are."""
        low, high = self._voxels(mesh)
        first, last = np.floor(low).astype(int) - MARGIN, np.ceil(high).astype(int) + MARGIN
        if (high - low).max() > max(self.lattice.shape) / 2:
            first, last = np.minimum(first, 0), np.maximum(last, np.array(self.lattice.shape) - 1)
        x, y, z = (float(o) for o in self.lattice.nodes(first))
        nx, ny, nz = (int(n) for n in last - first + 1)
        return first, Lattice((x, y, z), self.lattice.spacing, (nx, ny, nz))

    def _voxels(self, mesh: Mesh) -> np.ndarray:
        """Bounds of a mesh in nodes of the lattice, ``[2, 3]``."""
        bounds: np.ndarray = (mesh.bounds - np.array(self.lattice.origin)) / self.lattice.spacing
        return bounds

    # ---------------------------------------------------------------------------------------------------- the minimum

    @property
    def _everywhere(self) -> Box:
        return np.zeros(3, dtype=int), np.array(self.lattice.shape)

    def _keep_handed_out(self) -> None:
        """Copy values that are handed out."""
        if self._handed_out:
            self._values = self._values.copy()
            self._handed_out = False

    def _vacate(self, part: _Part) -> Box:
        """Fill an object's nodes from those that are left; returns the box that they lie in."""
        box = self._extent(part, self._reach.pop(part.number, self._nowhere))
        if (box[0] < box[1]).all():
            union.released(part.number, self._values[_slices(box)], self._owner[_slices(box)])
            self._measure_tiles(box)
            self._fill(box)
        return box

    def _fill(self, box: Box) -> None:
        """Lower a box to every object: near and large ones first, so that the others are soon known to be too far."""
        rank = {name: (float(self._least(part, *box)), -part.values.size) for name, part in self._parts.items()}
        for name in sorted(rank, key=rank.__getitem__):
            self._lower(self._parts[name], box)

    def _least(self, part: _Part, low: np.ndarray, high: np.ndarray) -> np.ndarray:
        """Metres from an object's bounds to boxes of nodes ``low <= node < high``, ``[*b, 3]``."""
        first, last = self._voxels(part.placed)
        gap = np.maximum(np.maximum(first - (high - 1), low - last), 0)
        metres = np.asarray(np.linalg.norm(gap, axis=-1) * self.lattice.spacing)
        return metres

    def _lower(self, part: _Part, box: Box) -> Box:
        """Lower a box to an object, where it can be nearest; returns the box of nodes that are now its own."""
        if (reach := self._contested(part, box)) is None:
            return self._nowhere
        self._lower_within(part, reach)
        self._lower_beyond(part, reach)
        own = self._extent(part, reach)
        self._measure_tiles(own)
        self._reach[part.number] = _hull(own, self._reach.get(part.number, self._nowhere))
        return own

    def _extent(self, part: _Part, box: Box) -> Box:
        """The box of an object's nodes within a box."""
        low, high = union.extent(part.number, self._owner[_slices(box)])
        return (low + box[0], high + box[0]) if (low < high).all() else self._nowhere

    def _contested(self, part: _Part, box: Box) -> Box | None:
        """The part of a box outside which an object is certainly not nearest."""
        first, after = box[0] // TILE, -(-box[1] // TILE)
        tile = np.stack(np.meshgrid(*map(np.arange, first, after), indexing="ij"), axis=-1)
        low, high = tile * TILE, np.minimum((tile + 1) * TILE, self.lattice.shape)
        inside = (low < part.corner + part.values.shape).all(axis=-1) & (high > part.corner).all(axis=-1)
        # A little less than the bound itself: distances are single precision.
        least = self._least(part, low, high) * (1 - 1e-5) - 1e-3 * self.lattice.spacing
        open_to = inside | (least < self._top[_slices((first, after))]) | (part.beyond < 0)
        if not open_to.any():
            return None
        return np.maximum(low[open_to].min(axis=0), box[0]), np.minimum(high[open_to].max(axis=0), box[1])

    def _lower_within(self, part: _Part, box: Box) -> None:
        low, high = np.maximum(box[0], part.corner), np.minimum(box[1], part.corner + part.values.shape)
        if (low >= high).any():
            return
        own = part.values[_slices((low - part.corner, high - part.corner))]
        values, owner = self._values[_slices((low, high))], self._owner[_slices((low, high))]

        def slab(i: int) -> None:
            planes = slice(i * TILE, (i + 1) * TILE)
            union.merged(own[planes], part.number, values[planes], owner[planes])

        parts(slab, -(-len(own) // TILE), self.threads)

    def _lower_beyond(self, part: _Part, box: Box) -> None:
        low, high = box[0] - part.corner, box[1] - part.corner  # in the window's frame
        if (low >= 0).all() and (high <= part.values.shape).all():
            return
        seeds, (_, ny, nz) = part.seeds, (int(n) for n in high - low)
        along = np.empty((*part.values.shape[:2], nz), dtype=np.int32)
        near = np.empty((part.values.shape[0], ny, nz), dtype=np.int32)

        def plane(x: int) -> None:
            union.along_rows(seeds.number, x, low[2], along)
            union.in_planes(along, seeds.place, x, low[1], low[2], near)

        parts(plane, len(near), self.threads)
        record = seeds.record.reshape(-1)
        scale = part.beyond * self.lattice.spacing
        values, owner = self._values[_slices(box)], self._owner[_slices(box)]

        def across(y: int) -> None:
            union.lowered(
                near, seeds.place, seeds.triangle, record, y, low, np.array(part.values.shape), scale, part.number,
                values, owner,
            )  # fmt: skip

        parts(across, ny, self.threads)

    def _measure_tiles(self, box: Box) -> None:
        """Note the highest value in every tile that a box touches."""
        if (box[0] >= box[1]).any():
            return
        first, after = box[0] // TILE, -(-box[1] // TILE)
        within = tuple(slice(a * TILE, b * TILE) for a, b in zip(first, after, strict=True))
        values, top = self._values[within], self._top[_slices((first, after))]
        parts(lambda x: union.highest(values, TILE, x, top), len(top), self.threads)

    @property
    def _nowhere(self) -> Box:
        return np.array(self.lattice.shape), np.zeros(3, dtype=int)


def _slices(box: Box) -> tuple[slice, slice, slice]:
    x, y, z = (slice(int(low), int(high)) for low, high in zip(*box, strict=True))
    return x, y, z


def _hull(a: Box, b: Box) -> Box:
    return np.minimum(a[0], b[0]), np.maximum(a[1], b[1])


def _rigid(name: str, pose: np.ndarray) -> np.ndarray:
    """A pose as an array; raises UserError unless it turns and shifts and does nothing else."""
    matrix = np.array(pose, dtype=np.float64)
    if matrix.shape != (4, 4) or not np.isfinite(matrix).all():
        raise UserError(f"the pose of '{name}' has shape {matrix.shape}; give 4 x 4 finite numbers")
    turn = matrix[:3, :3]
    unit = np.abs(turn @ turn.T - np.eye(3)).max() < 1e-6 and np.linalg.det(turn) > 0
    if not unit or not np.array_equal(matrix[3], [0, 0, 0, 1]):
        raise UserError(f"the pose of '{name}' scales, shears or mirrors; give a rotation and a translation in metres")
    return matrix
