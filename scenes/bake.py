"""From triangles to a grid of signed distances, with an explicit rule for which space is free.

Unsigned distances are exact at every node. The sign comes from the generalised winding number w (Jacobson et al.,
"Robust inside-outside segmentation using generalized winding numbers", 2013): space is free where w lies in the
interval that `free_space` decided on. Where no surface passes between neighbouring nodes the sign cannot change, so w
is evaluated once per connected region there and node by node only in the thin layer around the surface.
"""

from __future__ import annotations

import hashlib
import math
import os
import warnings
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal, TypeAlias

import numpy as np
import torch

from scenes.errors import UserError, did_you_mean
from scenes.files import atomic_write
from scenes.grid import SdfGrid
from scenes.lattice import Lattice
from scenes.mesh import Mesh
from scenes.surface import Surface

FORMAT = 3
"""Version of the bake and of its file; raised whenever either changes, so that old caches are not trusted."""

_EXACT_BAND = 2.5
"""Voxels within which distances are measured in double precision: goals, signs and accuracy claims live there."""

FreeSpace: TypeAlias = str | Sequence[float | int]
"""`"auto"`, `"outside"`, or a point x, y, z in the air (m, world)."""


@dataclass(frozen=True)
class Rule:
    """Which space is free, in terms of the winding number w.

    Attributes:
        name: "outside", "inside" (of an inward-facing room) or "seed".
        low, high: free is ``low <= w <= high``.
        message: one sentence saying what was decided and why.
        inward: the mesh's front sides face the inside of a room.
    """

    name: str
    low: float
    high: float
    message: str
    inward: bool = False

    def free(self, winding: np.ndarray) -> np.ndarray:
        """True where space with these winding numbers is free."""
        result: np.ndarray = (winding >= self.low) & (winding <= self.high)
        return result

    def margin(self, winding: np.ndarray) -> np.ndarray:
        """How far each winding number lies from where the answer changes."""
        result: np.ndarray = np.minimum(np.abs(winding - self.low), np.abs(winding - self.high))
        return result

    @property
    def beyond(self) -> float:
        """Sign of the distance far away from the mesh, where w is 0."""
        return 1.0 if self.low <= 0.0 <= self.high else -1.0


@dataclass(frozen=True, eq=False)
class Bake:
    """A baked grid, and what was decided on the way.

    Attributes:
        grid: the signed distances.
        rule: "outside", "inside" or "seed": where space is free.
        closed: the mesh has no unmatched edge.
        boundary_edges: number of unmatched edges.
        inward: the triangles face into a room.
        message: what was decided, one sentence.
        free: space is free where the winding number lies between these two.
    """

    grid: SdfGrid
    rule: str
    closed: bool
    boundary_edges: int
    inward: bool
    message: str
    free: tuple[float, float] = (-0.5, 0.5)


def default_cache() -> Path:
    """Folder of cached bakes: ``$SCENECTL_CACHE``, or the platform's cache folder."""
    if stated := os.environ.get("SCENECTL_CACHE"):
        return Path(stated).expanduser() / "bakes"
    from platformdirs import user_cache_path

    return user_cache_path("scenectl") / "bakes"


def bake(
    mesh: Mesh,
    resolution: int = 256,
    padding: float | int = 0.1,
    free_space: FreeSpace = "auto",
    cache: Path | Literal["default"] | None = "default",
    lattice: Lattice | None = None,
) -> Bake:
    """Signed distance grid of a mesh, positive in free space.

    Args:
        mesh: any triangles: closed solids, rooms scanned from inside, or loose polygons.
        resolution: nodes along the longest padded side, 8 to 512; voxels are cubes.
        padding: metres added to the bounds on each side, 0 to 100.
        free_space: "outside": what the mesh encloses is solid, whichever way it faces. "auto": the same, unless the
            triangles face into a room, and then the room's air is free and all else solid. A point (x, y, z) in the
            air (m, world): space that is enclosed as that point is.
        cache: folder of earlier bakes; "default" for `default_cache`, None for none.
        lattice: the nodes themselves, instead of those that `resolution` and `padding` give.

    Raises:
        UserError: resolution or padding out of range, an unknown rule, a mesh without area, or a seed point outside
            the padded bounds or on a surface.
    """
    check_resolution(resolution)
    if not (math.isfinite(padding) and 0 <= padding <= 100):
        raise UserError(f"bake padding is {padding} m; give 0 to 100 m")
    free_space = check_free_space(free_space)
    folder = default_cache() if cache == "default" else cache
    lattice = lattice or Lattice.around(mesh.bounds, resolution, padding)
    key = _key(mesh, lattice, free_space)
    path = None if folder is None else Path(folder) / f"{key}.npz"
    if path is not None and (found := _load(path, key)) is not None:
        return found
    surface = Surface.of(mesh)
    rule = decide(surface, free_space, lattice.bounds, mesh.name)
    distance = _unsigned(surface, lattice)
    distance[~_free(surface, rule, lattice, distance)] *= -1
    origin = torch.tensor(lattice.origin, dtype=torch.float64)
    grid = SdfGrid(torch.from_numpy(distance), origin, lattice.spacing, rule.beyond)
    result = Bake(
        grid, rule.name, surface.closed, surface.boundary_edges, rule.inward, rule.message, (rule.low, rule.high)
    )
    if path is not None:
        _store(path, key, result)
    return result


# ---------------------------------------------------------------------------------------------- which space is free


def decide(surface: Surface, free_space: FreeSpace, bounds: np.ndarray, name: str) -> Rule:
    """The free-space rule for a surface.

    Args:
        surface: the cleaned mesh.
        free_space: as `bake` takes it.
        bounds: padded bounds ``[2, 3]`` (m) that a seed point must lie in.
        name: of the mesh, for the message.

    Raises:
        UserError: a seed point outside `bounds` or within 1 mm of a surface.
    """
    kind = _kind(surface)
    if free_space == "outside":
        return _outside(surface, f"mesh '{name}' ({kind}): free space is outside, as stated")
    if not isinstance(free_space, str):
        return _from_seed(surface, free_space, bounds, name, kind)
    facing = _winding_in_front(surface)
    # In front of a room's walls w is -1; in front of an object's it is 0. A sheet alone gives -1/2, a floor with two
    # walls about -0.7: only what is enclosed for the most part counts as a room.
    if facing < (-0.5 if surface.nearly_closed else -0.75):
        message = f"mesh '{name}' ({kind}) faces inward (winding number {facing:.2f} in front of its triangles), so"
        return Rule("inside", -math.inf, -0.5, f"{message} the space it encloses is free and all else solid", True)
    message = f"mesh '{name}' ({kind}) does not face inward (winding number {facing:.2f} in front of its triangles)"
    return _outside(surface, f"{message}, so free space is outside")


def _kind(surface: Surface) -> str:
    if surface.closed:
        return "closed"
    return f"{'nearly closed' if surface.nearly_closed else 'open'}, {surface.boundary_edges} boundary edges"


def _outside(surface: Surface, message: str) -> Rule:
    if surface.nearly_closed:  # a closed part is solid whichever way it faces
        return Rule("outside", -0.5, 0.5, message)
    # Loose sheets have |w| up to 1 on the side they face; only what they enclose from behind is solid.
    return Rule("outside", -math.inf, 0.5, f"{message} and only what has winding number over 0.5 is solid")


def _from_seed(surface: Surface, seed: Sequence[float], bounds: np.ndarray, name: str, kind: str) -> Rule:
    point = np.array([seed])
    text = f"({seed[0]:g}, {seed[1]:g}, {seed[2]:g})"
    if (point < bounds[0]).any() or (point > bounds[1]).any():
        low, high = (np.array2string(corner, precision=2, separator=", ") for corner in bounds)
        raise UserError(
            f"free-space seed {text} lies outside mesh '{name}', whose padded bounds run from {low} to {high} m;"
            " give a point in the air"
        )
    if surface.unsigned_distance(point)[0] < 1e-3:
        raise UserError(f"free-space seed {text} lies on a surface of mesh '{name}'; give a point in the air")
    w = float(surface.winding(point)[0])
    message = f"mesh '{name}' ({kind}): free space is that of the seed {text}, where the winding number is {w:.2f}"
    if w < -0.5:
        return Rule("seed", -math.inf, -0.5, message, True)
    if w <= 0.5:
        outside = _outside(surface, message)
        return Rule("seed", outside.low, outside.high, outside.message)
    return Rule("seed", round(w) - 0.5, round(w) + 0.5, message)


def _winding_in_front(surface: Surface, samples: int = 2000) -> float:
    """Median winding number just in front of points spread evenly over the surface."""
    corners = surface.vertices[surface.faces]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    areas = np.linalg.norm(normals, axis=1)
    rng = np.random.default_rng(0)
    chosen = rng.choice(len(areas), size=samples, p=areas / areas.sum())
    weights = rng.dirichlet(np.ones(3), size=samples)
    points = np.einsum("nk,nkc->nc", weights, corners[chosen])
    step = 1e-4 * float(np.ptp(surface.vertices, axis=0).max())
    points += step * normals[chosen] / areas[chosen, None]
    return float(np.median(surface.winding_fast(points + surface.centre)))


def check_resolution(resolution: int) -> None:
    """Raise UserError unless `resolution` is a whole number of nodes from 8 to 512."""
    if isinstance(resolution, bool) or not isinstance(resolution, int) or not 8 <= resolution <= 512:
        raise UserError(f"bake resolution is {resolution}; give a whole number of nodes from 8 to 512")


def check_free_space(free_space: Any) -> FreeSpace:
    """The rule as given, a point as a tuple of floats; raises UserError for anything that is no rule."""
    if isinstance(free_space, str):
        if free_space not in ("auto", "outside"):
            hint = did_you_mean(free_space, ("auto", "outside"))
            raise UserError(f"unknown free-space rule '{free_space}'{hint}, or give a point [x, y, z] in the air")
        return free_space
    try:
        x, y, z = (float(number) for number in free_space)
    except (TypeError, ValueError) as error:
        raise UserError(f"free-space seed is {free_space!r}; give three numbers x, y, z in metres") from error
    if not all(math.isfinite(number) for number in (x, y, z)):
        raise UserError(f"free-space seed is ({x}, {y}, {z}); give three finite numbers in metres")
    return (x, y, z)


# -------------------------------------------------------------------------------------------------- values and signs


def _slabs(lattice: Lattice, nodes: int = 1 << 20) -> Iterator[tuple[slice, np.ndarray]]:
    """Slices along x with the world positions ``[x, Y, Z, 3]`` of their nodes, about `nodes` at a time."""
    thick = max(1, nodes // (lattice.shape[1] * lattice.shape[2]))
    axes = [lattice.origin[i] + lattice.spacing * np.arange(lattice.shape[i]) for i in range(3)]
    for start in range(0, lattice.shape[0], thick):
        part = slice(start, min(start + thick, lattice.shape[0]))
        yield part, np.stack(np.meshgrid(axes[0][part], axes[1], axes[2], indexing="ij"), axis=-1)


def _unsigned(surface: Surface, lattice: Lattice) -> np.ndarray:
    """Distance (m, float32) from every node to the nearest triangle.

    Open3D's tree (Embree) is fast but single precision: on long thin triangles it is wrong by millimetres. So within
    `_EXACT_BAND` voxels, where goals and signs look, libigl measures again in double precision.
    """
    import open3d as o3d

    tensor: Any = o3d.core.Tensor  # its stubs miss the constructor that takes arrays
    scene = o3d.t.geometry.RaycastingScene()
    scene.add_triangles(tensor(surface.vertices.astype(np.float32)), tensor(surface.faces.astype(np.uint32)))
    distance = np.empty(lattice.shape, dtype=np.float32)
    for part, nodes in _slabs(lattice):
        local = np.ascontiguousarray(nodes - surface.centre, dtype=np.float32)
        distance[part] = scene.compute_distance(tensor(local)).numpy()
    near = np.flatnonzero(distance < _EXACT_BAND * lattice.spacing)
    for chunk in np.array_split(near, max(1, len(near) >> 20)):
        distance.reshape(-1)[chunk] = surface.unsigned_distance(lattice.nodes_at(chunk))
    return distance


def _free(surface: Surface, rule: Rule, lattice: Lattice, distance: np.ndarray) -> np.ndarray:
    """True at the nodes in free space."""
    from scipy import ndimage

    free = np.zeros(lattice.shape, dtype=bool)
    open_nodes = np.ones(lattice.shape, dtype=bool)  # those whose sign is not known yet
    # A segment between neighbours that are both farther than half a voxel from the surface cannot cross it, so
    # connected regions of such nodes have one sign on a closed mesh. Through a hole in a mesh a region reaches both
    # sides: there, thicker layers are set aside first, which shuts the holes that are narrower than they are.
    for layer in (0.5,) if surface.closed else (8.0, 4.0, 2.0, 1.0, 0.5):
        labels, _ = ndimage.label(open_nodes & (distance > layer * lattice.spacing))
        sizes = np.bincount(labels.reshape(-1))
        sizes[0] = 0
        for region in np.argsort(sizes)[::-1][:64]:
            if sizes[region] < 1000:  # cheaper node by node
                break
            members = np.flatnonzero(labels == region)
            votes = rule.free(surface.winding_fast(lattice.nodes_at(members[:: max(1, len(members) // 500)])))
            if surface.closed or votes.all() or not votes.any():
                free.reshape(-1)[members] = votes.mean() > 0.5
                open_nodes.reshape(-1)[members] = False
        del labels
    rest = np.flatnonzero(open_nodes)
    for chunk in np.array_split(rest, max(1, len(rest) >> 20)):
        free.reshape(-1)[chunk] = is_free(surface, rule, lattice.nodes_at(chunk))
    return free


def is_free(surface: Surface, rule: Rule, points: np.ndarray) -> np.ndarray:
    """True at those of ``[n, 3]`` world points (m) that lie in free space.

    The fast winding number is within about 0.01; wherever that could change the answer, the exact one decides.
    """
    winding = surface.winding_fast(points)
    doubtful = np.flatnonzero(rule.margin(winding) < 0.02)
    winding[doubtful] = surface.winding(points[doubtful])
    return rule.free(winding)


# ------------------------------------------------------------------------------------------------------------- cache


def _key(mesh: Mesh, lattice: Lattice, free_space: FreeSpace) -> str:
    # The name is part of the message that is stored, so it is part of the key.
    text = repr((FORMAT, mesh.digest, mesh.name, lattice, free_space))
    return hashlib.sha256(text.encode()).hexdigest()


def _store(path: Path, key: str, result: Bake) -> None:
    facts = {
        "key": np.array(key),
        "rule": np.array(result.rule),
        "message": np.array(result.message),
        "closed": np.array(result.closed),
        "inward": np.array(result.inward),
        "boundary_edges": np.array(result.boundary_edges),
        "free": np.array(result.free),
    }
    try:
        with atomic_write(path) as file:
            np.savez(file, allow_pickle=False, **facts, **result.grid.arrays())
    except (OSError, UserError) as error:  # a full or read-only disk costs time, not the result
        warnings.warn(f"the bake could not be cached: {error}", stacklevel=3)


def _load(path: Path, key: str) -> Bake | None:
    """A cached bake, or None when there is none or its file is damaged (then it is baked again and replaced)."""
    try:
        with np.load(path, allow_pickle=False) as data:  # reading an array checks its CRC
            if str(data["key"]) != key:
                return None
            return Bake(
                SdfGrid.from_arrays(data),
                rule=str(data["rule"]),
                closed=bool(data["closed"]),
                boundary_edges=int(data["boundary_edges"]),
                inward=bool(data["inward"]),
                message=str(data["message"]),
                free=(float(data["free"][0]), float(data["free"][1])),
            )
    except Exception:  # zipfile, numpy and our own checks raise many kinds; all mean "bake it again"
        return None
