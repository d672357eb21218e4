"""Which nodes of a lattice are in free space, and how sure that is.

On a closed mesh the crossings of one ray give the winding number at every node, exactly. On any other mesh rays along
three axes vote, each only where its line leaves the lattice as it came in. Nodes between which no surface can pass form
regions with one sign, which a region's votes decide nearly always. Where they are divided, space leaks through a hole:
there the generalised winding number marks what is clearly free or solid, and both grow from wide places to narrow ones
until they meet where the hole is narrowest. A part that hangs together with its surroundings through more air than it
is bounded by triangles is no part.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from scenes.kernels import parts, rays, regions as grow
from scenes.sdf.distances import Soup
from scenes.sdf.free_space import Sides

DIVIDED = 0.05
"""Share of contrary votes from which on a region is divided."""

UNCERTAIN = 50
"""Percent of agreeing evidence up to which a node counts as uncertain."""

_CLEAR = 0.2  # distance of a winding number from the rule's limits that marks a node
_CLEAR_CUT_AWAY = 0.03  # the same where the winding number falls off to 0 before an opening
_STEPS = np.uint16(4095)  # quarters of a voxel from which on places are equally wide
_MARKS = 32  # along the longest side; the lattice's outer faces are marked too, as padding may be thin


@dataclass(frozen=True, eq=False)
class Signs:
    """How sure the signs of a bake are.

    Attributes:
        kind: "closed", "nearly closed" or "open".
        boundary_edges: edges whose uses in the two directions differ; 0 where closed.
        confidence: percent of the evidence that agrees with each node's sign, ``[X, Y, Z]`` uint8, or None where all
            of it does everywhere.
    """

    kind: str
    boundary_edges: int
    confidence: np.ndarray | None = None

    @property
    def uncertain(self) -> np.ndarray | None:
        """True at the nodes of which at most half of the evidence agrees, ``[X, Y, Z]``; None where there are none."""
        return None if self.confidence is None else self.confidence <= UNCERTAIN

    @property
    def summary(self) -> str:
        """For example ``"closed"``, or ``"nearly closed, 12 boundary edges, 0.02 % of voxels uncertain"``."""
        if self.kind == "closed":
            return "closed"
        share = 0.0 if self.uncertain is None else 100.0 * float(self.uncertain.mean())
        text = "no voxel" if share == 0 else f"{share:.2g} % of voxels"
        return f"{self.kind}, {self.boundary_edges} boundary edges, {text} uncertain"


def sign(distance: np.ndarray, soup: Soup, sides: Sides, spacing: float, threads: int | None = None) -> Signs:
    """Turn distances in voxels into signed distances in metres, in place.

    Args:
        distance: of `scenes.sdf.distances.unsigned`, ``[X, Y, Z]`` float32.
        soup: the triangles in the lattice's coordinates.
        sides: the same in metres, and which winding numbers are free.
        spacing: metres a voxel.
        threads: at most so many; default, all processors.
    """
    scale = np.float32(spacing)
    if sides.sheets is None:
        _from_one_ray(distance, soup, sides, scale, threads)
        return Signs("closed", 0)
    sheets = soup if sides.solids is None else Soup.of(sides.sheets, soup.lattice)
    votes, crossed = _votes(sheets, sides, threads)
    confidence = None
    if sides.seed is not None or not ((votes == 3) | (votes == 48)).all():  # all three axes alike
        confidence = _from_regions(distance, sheets, sides, votes, crossed)
    rays.turned(votes.reshape(-1), scale, distance.reshape(-1))
    if sides.solids is not None:
        _from_one_ray(distance, Soup.of(sides.solids, soup.lattice), sides, None, threads)
    return Signs(sides.sheets.kind, sides.sheets.boundary_edges, confidence)


def _from_one_ray(
    distance: np.ndarray, soup: Soup, sides: Sides, scale: np.float32 | None, threads: int | None
) -> None:
    """Sign distances about closed pieces, or where there is no `scale` make those in solids negative."""
    bits = rays.fraction_bits(max(distance.shape))
    none = np.zeros((0, 0, 0), dtype=np.uint8)

    def slab(i: int) -> None:
        begin, end = soup.planes(i)
        counts = np.zeros((end - begin, *distance.shape[1:]), dtype=np.int16)
        members = soup.members(i)
        rays.crossings(soup.vertices, soup.faces, members, (0, 1, 2), bits, begin, end, 0, counts, none, 0)
        if scale is None:
            rays.sunk(counts, *sides.rule.solids, distance[begin:end])
        else:
            rays.signed(counts, *sides.rule.solids, scale, distance[begin:end])

    parts(slab, soup.slabs, threads)


def _votes(soup: Soup, sides: Sides, threads: int | None) -> tuple[np.ndarray, np.ndarray]:
    """Votes of the rays along z, y and x, and which edges towards -z, -y and -x cross a triangle; uint8 both."""
    shape = soup.lattice.shape
    bits = rays.fraction_bits(max(shape))
    votes, crossed = np.zeros(shape, dtype=np.uint8), np.zeros(shape, dtype=np.uint8)
    along_x = np.zeros(shape, dtype=np.int16)

    def slab(i: int) -> None:
        begin, end = soup.planes(i)
        mesh = (soup.vertices, soup.faces, soup.members(i))
        for axes, flag in (((0, 1, 2), 1), ((0, 2, 1), 2)):
            order = (0, axes[1], axes[2])
            counts = np.zeros((end - begin, *shape[1:]), dtype=np.int16)
            marks = crossed[begin:end].transpose(order)
            rays.crossings(*mesh, axes, bits, begin, end, 0, counts.transpose(order), marks, flag)
            for x in range(end - begin):
                lines = (counts[x].T, votes[begin + x].T) if flag == 1 else (counts[x], votes[begin + x])
                rays.vote(lines[0], *sides.rule.sheets, lines[1])
        order = (1, 2, 0)
        rays.crossings(*mesh, order, bits, begin, end, 1, along_x.transpose(order), crossed.transpose(order), 4)

    parts(slab, soup.slabs, threads)
    parts(lambda y: rays.vote(along_x[:, y], *sides.rule.sheets, votes[:, y]), shape[1], threads)
    return votes, crossed


def _from_regions(distance: np.ndarray, soup: Soup, sides: Sides, votes: np.ndarray, crossed: np.ndarray) -> np.ndarray:
    """Settle `votes` in place; returns the confidence in them, ``[X, Y, Z]``."""
    shape = distance.shape
    d, v, edges = distance.reshape(-1), votes.reshape(-1), crossed.reshape(-1)
    region = np.empty(d.size, dtype=np.int32)
    count = grow.regions(d, edges, shape, region)
    for_free, for_solid, deepest = grow.tally(region, v, d, count)
    total = for_free + for_solid
    solid = for_solid > for_free
    silent = np.flatnonzero(total == 0)
    solid[silent] = ~sides.before_sheets(_winding(soup, sides, deepest[silent]))
    divided = np.minimum(for_free, for_solid) > DIVIDED * np.maximum(total, 1)
    divided &= np.minimum(for_free, for_solid) >= 24
    purity = np.where(total > 0, np.maximum(for_free, for_solid) / np.maximum(total, 1), 0.6)
    purity[divided] = 0.5
    free = ~solid[region]
    if divided.any():
        _cut(free, d, edges, shape, divided[region], soup, sides)
    free[_around_seed(soup, sides, d)] = True
    confidence = np.empty(d.size, dtype=np.uint8)
    grow.weighed(region, purity, v, free, confidence)
    np.copyto(v, np.where(free, np.uint8(3), np.uint8(48)))
    return confidence.reshape(shape)


def _around_seed(soup: Soup, sides: Sides, distance: np.ndarray) -> np.ndarray:
    """The nodes between which and the seed no surface can lie, and at least the widest beside it; flat, empty without.

    A node is as near to the seed as the nearest surface is to the node.
    """
    if sides.seed is None:
        return np.zeros(0, dtype=np.int64)
    place = (sides.seed - soup.lattice.origin) / soup.lattice.spacing
    reach = float(sides.surface.unsigned_distance(sides.seed[None])[0]) / soup.lattice.spacing
    low, high = np.floor(place - reach).astype(int), np.ceil(place + reach).astype(int) + 1
    rows = [np.arange(max(a, 0), min(b + 1, n)) for a, b, n in zip(low, high, soup.lattice.shape, strict=True)]
    near = np.stack(np.meshgrid(*rows, indexing="ij"), axis=-1).reshape(-1, 3)
    away = np.linalg.norm(near - place, axis=1)
    flat = np.ravel_multi_index(tuple(near.T), soup.lattice.shape)
    beside = away < 2
    return np.append(flat[away < reach], flat[beside][distance[flat[beside]].argmax()])


def _winding(soup: Soup, sides: Sides, nodes: np.ndarray, reach: float = 2.5) -> np.ndarray:
    """Winding number about the sheets at nodes given by flat index; `reach` as `Dipoles.at` takes it."""
    if len(nodes) == 0 or sides.sheets is None:
        return np.zeros(0)
    return sides.sheets.dipoles.at(soup.lattice.nodes_at(nodes) - sides.sheets.centre, reach=reach)


def _cut(
    free: np.ndarray,
    distance: np.ndarray,
    crossed: np.ndarray,
    shape: tuple[int, ...],
    torn: np.ndarray,
    soup: Soup,
    sides: Sides,
) -> None:
    """Decide the nodes of divided regions, in place in `free`: marked by winding numbers, cut at the narrowest.

    A room that is cut open has no narrowest place: there each node goes with the nearest mark.
    """
    label = np.zeros(shape, dtype=np.int8)
    coarse = np.flatnonzero(_spread(shape) & torn)
    w = _winding(soup, sides, coarse, reach=1.2)  # within 0.1, far less than what makes a mark clear
    clear = _CLEAR_CUT_AWAY if sides.cut_away else _CLEAR
    label.reshape(-1)[coarse] = np.where(sides.margin(w) > clear, np.where(sides.before_sheets(w), 1, 2), 0)
    label = label.reshape(-1)
    label[_around_seed(soup, sides, distance)] = 1
    if sides.cut_away:
        grow.nearest(crossed, shape, torn, label)
        free[torn & (label > 0)] = label[torn & (label > 0)] == 1
        return
    parent = grown(
        distance, crossed, shape, torn, label, lambda nodes: sides.before_sheets(_winding(soup, sides, nodes))
    )
    root = np.where(torn, parent, 0)
    sizes = np.bincount(parent[torn], minlength=len(parent))
    sort = np.where(torn, label[root], 0).astype(np.int8)
    for _ in range(4):  # a part that falls to its surroundings may free the next
        air, wall = np.zeros(len(parent), np.int32), np.zeros(len(parent), np.int32)
        grow.borders(distance, crossed, shape, parent, sort, air, wall)
        hanging = (air > wall) & (np.arange(len(parent)) != sizes.argmax())
        hanging[parent[_around_seed(soup, sides, distance)]] = False
        if not hanging.any():
            break
        turned = torn & hanging[root]
        sort[turned] = 3 - sort[turned]
    free[torn] = sort[torn] == 1


def grown(
    distance: np.ndarray,
    crossed: np.ndarray,
    shape: tuple[int, ...],
    torn: np.ndarray,
    label: np.ndarray,
    is_free: Callable[[np.ndarray], np.ndarray],
) -> np.ndarray:
    """Grow labels (1 free, 2 solid) over the nodes `torn`, from wide places to narrow ones; all arrays are flat.

    Sets that no label reaches are asked for: `is_free` takes flat indices. Returns the root of each node's set, -1
    where not `torn`; afterwards `label` is right at the roots.
    """
    nodes = np.flatnonzero(torn).astype(np.int32)
    narrow = _STEPS - np.minimum(4 * distance[nodes], _STEPS).astype(np.uint16)  # in quarters of a voxel
    order = nodes[np.argsort(narrow, kind="stable")]
    parent = np.full(len(distance), -1, dtype=np.int32)
    grow.flood(order, distance, crossed, shape, label, parent)
    unknown = np.unique(parent[torn & (label[np.where(torn, parent, 0)] == 0)])
    label[unknown] = np.where(is_free(unknown), 1, 2)
    return parent


def _spread(shape: tuple[int, ...]) -> np.ndarray:
    """True at nodes spread evenly through the lattice, and over its outer faces; flat."""
    stride = -(-max(shape) // _MARKS)
    rows = [np.arange(stride // 2, n, stride) for n in shape]
    mask = np.zeros(shape, dtype=bool)
    for axis in range(3):
        across = [
            np.append(row, [0, n - 1]) if i == axis else row for i, (row, n) in enumerate(zip(rows, shape, strict=True))
        ]
        mask[np.ix_(*across)] = True
    return mask.reshape(-1)
