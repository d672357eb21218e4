"""From triangles to a grid of signed distances, with an explicit rule for which space is free.

Distances come from `scenes.sdf.distances`, signs from `scenes.sdf.signs`, the rule from `scenes.sdf.free_space`; here
they are put together, thin walls are given a thickness where the user wants one, and results are cached.
"""

from __future__ import annotations

import hashlib
import os
import warnings
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Generic, TypeVar

import numpy as np
import torch

from scenes.archive import load_npz
from scenes.errors import Remark, UserError
from scenes.files import atomic_write, sweep, unreadable
from scenes.mesh.mesh import Mesh
from scenes.mesh.surface import Surface, thin_walls
from scenes.sdf.blocks import SdfBlocks
from scenes.sdf.distances import Soup, unsigned
from scenes.sdf.doubts import doubts_about
from scenes.sdf.free_space import Sides, decide
from scenes.sdf.grid import SdfGrid
from scenes.sdf.lattice import LARGEST, Lattice
from scenes.sdf.settings import BakeSettings, Cache, FreeSpace
from scenes.sdf.signs import Signs, sign
from scenes.sdf.thin import thin_doubts

FORMAT = 8
"""Version of the bake and of its file; raised whenever either changes, so that old caches are not read."""


Grid = TypeVar("Grid", SdfGrid, SdfBlocks)


@dataclass(frozen=True, eq=False)
class Bake(Generic[Grid]):
    """A baked grid, and what was decided on the way.

    Attributes:
        grid: the signed distances.
        rule: "outside", "inside" or "seed": where space is free.
        signs: what kind of mesh it is, and how sure the sign of every voxel is.
        inward: the triangles face into a room.
        message: what was decided, one sentence.
        doubts: evidence against what was decided, one sentence each.
    """

    grid: Grid
    rule: str
    signs: Signs
    inward: bool
    message: str
    doubts: tuple[str, ...] = ()

    @property
    def closed(self) -> bool:
        """The mesh has no unmatched edge."""
        return self.signs.kind == "closed"

    @property
    def boundary_edges(self) -> int:
        """Number of unmatched edges."""
        return self.signs.boundary_edges

    @property
    def summary(self) -> str:
        """The decision, and how sure the signs are."""
        return f"{self.message}; signs: {self.signs.summary}"


def default_cache() -> Path:
    """Folder of cached bakes: ``$SCENECTL_CACHE``, or the platform's cache folder.

    Raises:
        UserError: the variable names the home of a user who does not exist.
    """
    if stated := os.environ.get("SCENECTL_CACHE"):
        try:
            return Path(stated).expanduser() / "bakes"
        except RuntimeError:
            raise UserError(f"SCENECTL_CACHE is '{stated}': there is no such user; name a folder") from None
    from platformdirs import user_cache_path

    return user_cache_path("scenectl") / "bakes"


def bake(
    mesh: Mesh,
    resolution: int = 256,
    padding: float | int = 0.1,
    free_space: FreeSpace = "auto",
    cache: Cache = "default",
    lattice: Lattice | None = None,
    thickness: float | int = 0.0,
    threads: int | None = None,
) -> Bake[SdfGrid]:
    """Signed distance grid of a mesh, positive in free space.

    Args:
        mesh: any triangles: closed solids, rooms scanned from inside, or loose polygons.
        resolution, padding, free_space, cache, thickness: as in `scenes.sdf.settings.BakeSettings`.
        lattice: the nodes themselves, instead of those that `resolution` and `padding` give; must hold the mesh.
        threads: at most so many; default, all processors. They do not change the result.

    Raises:
        UserError: resolution, padding or thickness out of range, an unknown rule, a mesh without area or outside the
            lattice, or a seed point outside the padded bounds or on a surface.
    """
    asked = BakeSettings(resolution=resolution, free_space=free_space, thickness=thickness, padding=padding)
    lattice = lattice or Lattice.around(mesh.bounds, asked.resolution, asked.padding)
    rule, thick = asked.free_space, float(asked.thickness)
    return cached(cache, _key(mesh, lattice, rule, thick), SdfGrid, lambda: _baked(mesh, lattice, rule, thick, threads))


def _baked(mesh: Mesh, lattice: Lattice, free_space: FreeSpace, thickness: float, threads: int | None) -> Bake[SdfGrid]:
    sides = sided(mesh, free_space, lattice)
    soup = Soup.of(sides.surface, lattice)
    distance = unsigned(soup, threads)
    signs = sign(distance, soup, sides, lattice.spacing, threads)
    if (thin := thin_walls(sides.surface, thickness)) is not None:
        walls = unsigned(Soup.of(thin, lattice), threads)
        walls *= np.float32(lattice.spacing)
        walls -= np.float32(thickness / 2)
        np.minimum(distance, walls, out=distance)
    margin = max(lattice.margin(sides.surface.bounds) - (thickness / 2 if thin is not None else 0.0), 0.0)
    origin = torch.tensor(lattice.origin, dtype=torch.float64)
    grid = SdfGrid(torch.from_numpy(distance), origin, lattice.spacing, sides.beyond, margin)
    walls_lost = () if thickness >= lattice.spacing else thin_doubts(sides, grid.near, lattice.spacing, mesh.name)
    rule = sides.rule
    doubts = doubts_about(distance, signs, sides, lattice, mesh.name, walls_lost)
    return Bake(grid, rule.name, signs, rule.inward, rule.message, doubts)


def sided(mesh: Mesh, free_space: FreeSpace, lattice: Lattice) -> Sides:
    """The sides of a mesh's surface; raises UserError where the lattice does not hold it."""
    surface = Surface.of(mesh)
    low, high = surface.bounds
    slack = 1e-6 * lattice.spacing
    if (low < lattice.bounds[0] - slack).any() or (high > lattice.bounds[1] + slack).any():
        raise UserError(f"mesh '{mesh.name}' reaches beyond the lattice {lattice.bounds.tolist()} m; give a larger one")
    return decide(surface, free_space, lattice.bounds, mesh.name)


# ------------------------------------------------------------------------------------------------------------- cache


def _key(mesh: Mesh, lattice: Lattice, free_space: FreeSpace, thickness: float) -> str:
    # The name is part of the message that is stored, so it is part of the key.
    text = repr((FORMAT, mesh.digest, mesh.name, lattice, free_space, thickness))
    return hashlib.sha256(text.encode()).hexdigest()


def cached(cache: Cache, key: str, kind: type[Grid], make: Callable[[], Bake[Grid]]) -> Bake[Grid]:
    """The bake that a folder keeps under a key, or else made and kept there; `kind` is its grid's class."""
    folder = default_cache() if cache == "default" else cache
    if folder is not None:
        sweep(folder)
    path = None if folder is None else Path(folder) / f"{key}.npz"
    if path is not None and (found := _load(path, key, kind)) is not None:
        return found
    result = make()
    if path is not None:
        _store(path, key, result)
    return result


def _store(path: Path, key: str, result: Bake[Grid]) -> None:
    facts = {
        "key": np.array(key),
        "rule": np.array(result.rule),
        "message": np.array(result.message),
        "kind": np.array(result.signs.kind),
        "confidence": np.zeros(0, np.uint8) if result.signs.confidence is None else result.signs.confidence,
        "inward": np.array(result.inward),
        "boundary_edges": np.array(result.boundary_edges),
        "doubts": np.array(result.doubts, dtype=np.str_),
    }
    try:
        with atomic_write(path) as file:
            np.savez(file, allow_pickle=False, **facts, **result.grid.arrays())
    except (OSError, UserError) as error:  # a full or read-only disk costs time, not the result
        warnings.warn(f"the bake could not be cached: {error}", Remark, stacklevel=3)


_KINDS = {
    "key": "U", "rule": "U", "message": "U", "kind": "U", "confidence": "u", "inward": "b", "boundary_edges": "i",
    "doubts": "U",
}  # fmt: skip
"""Kinds of arrays in which a cached bake keeps what is no grid."""


def _load(path: Path, key: str, kind: type[Grid]) -> Bake[Grid] | None:
    """A cached bake, or None when there is none or its file is damaged (then it is baked again and replaced)."""
    if unreadable(path):
        return None
    try:
        data = load_npz(path, most_bytes=5 * LARGEST)  # a distance and its confidence; reading checks CRCs
        facts = {name: data[name] for name in _KINDS}
        if {name: fact.dtype.kind for name, fact in facts.items()} != _KINDS or str(facts["key"]) != key:
            return None
        grid, confidence = kind.from_arrays(data), facts["confidence"]
        if confidence.size and confidence.shape != grid.shape:
            return None
        return Bake(
            grid,
            rule=str(facts["rule"]),
            signs=Signs(str(facts["kind"]), int(facts["boundary_edges"]), confidence if confidence.size else None),
            inward=bool(facts["inward"]),
            message=str(facts["message"]),
            doubts=tuple(str(doubt) for doubt in facts["doubts"]),
        )
    except Exception:  # zipfile, numpy and our own checks raise many kinds; all mean "bake it again"
        return None
