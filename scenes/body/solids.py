"""Shapes of which robots' files build links, as triangles."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from scenes.body.capsules import sample_surface
from scenes.errors import UserError
from scenes.mesh.content import joined
from scenes.mesh.mesh import Mesh
from scenes.mesh.surface import Surface

Solid = tuple[np.ndarray, np.ndarray]
"""Vertices ``[V, 3]`` (m) and faces ``[F, 3]``."""
_APART = 0.01
"""Metres beyond collision shapes that are told: a voxel of the finest room grids; simplified shapes differ by less."""
_POINTS = 5000
"""Points at which a visual shape is compared with collision shapes: 2 cm apart on a square metre."""
SOLIDS = {"box": 3, "sphere": 1, "ellipsoid": 3, "cylinder": 2, "capsule": 2}
"""How many sizes each shape has."""


def solid(kind: str, sizes: Sequence[float]) -> Solid:
    """Triangles around the middle, long axes along z, of a key of `SOLIDS`.

    Args:
        kind: which shape.
        sizes: metres: edges of a box, the radius of a sphere, semi-axes of an ellipsoid, radius and length of a
            cylinder or of a capsule (between the middles of its caps).
    """
    import trimesh

    if kind == "box":
        found = trimesh.creation.box(extents=sizes)
    elif kind == "sphere":
        found = trimesh.creation.icosphere(subdivisions=3, radius=sizes[0])
    elif kind == "ellipsoid":
        found = trimesh.creation.icosphere(subdivisions=3).apply_scale(sizes)
    elif kind == "cylinder":
        found = trimesh.creation.cylinder(radius=sizes[0], height=sizes[1], sections=48)
    else:
        found = trimesh.creation.capsule(radius=sizes[0], height=sizes[1], count=(24, 24))
    return np.asarray(found.vertices - found.bounds.mean(axis=0)), np.asarray(found.faces, dtype=np.int64)


@dataclass(frozen=True)
class Uncovered:
    """Visual shapes of a link that reach beyond its collision shapes.

    Attributes:
        what: these shapes, as a sentence names them.
        link: whose.
        reach: how far the farthest does, metres.
        at: where that is in the link's frame, metres.
    """

    what: str
    link: str
    reach: float
    at: tuple[float, ...]


def uncovered(link: str, shown: Sequence[tuple[str, Solid]], collides: Sequence[Solid]) -> Uncovered | str | None:
    """Visual shapes, by name, that reach beyond the collision shapes of their link; a sentence where nobody can tell.

    Args:
        link: its name.
        shown, collides: one or more shapes that are seen and that collide, in the link's frame.
    """
    try:
        surface = Surface.of(Mesh(*joined(collides)))
        reaches = [_beyond(surface, *seen) for _, seen in shown]
    except UserError as error:  # nobody needs what is only seen
        return f"visual shapes of link '{link}' were not compared with its collision shapes: the file {error}"
    out = [index for index, (reach, _) in enumerate(reaches) if reach > _APART]
    if not out:
        return None
    names = ", ".join(shown[index][0] for index in out)
    reach, at = max((reaches[index] for index in out), key=lambda found: found[0])
    what = f"{len(out)} of {len(shown)} visual shapes of link '{link}' ({names})"
    return Uncovered(what, link, reach, tuple(at.tolist()))


def sentences(found: Iterable[Uncovered | str | None]) -> tuple[str, ...]:
    """What `uncovered` found of all links of a robot; links of which several reach out share a sentence."""
    found = [one for one in found if one]
    others, out = [one for one in found if isinstance(one, str)], [one for one in found if isinstance(one, Uncovered)]
    if not out:
        return tuple(others)
    worst = max(out, key=lambda one: one.reach)
    place = f"({', '.join(f'{x:.2f}' for x in worst.at)}) m in the link's frame"
    rest = [f"'{one.link}' {one.reach:.2f} m" for one in out if one is not worst]
    more = f", and those of {', '.join(rest)}" if rest else ""
    told = (
        f"{worst.what} reach up to {worst.reach:.2f} m beyond its collision shapes, farthest at {place}{more}; "
        "capsules leave that out, so add collision shapes there if it can be touched"
    )
    return (*others, told)


def _beyond(surface: Surface, vertices: np.ndarray, faces: np.ndarray) -> tuple[float, np.ndarray]:
    """How far (m) a shape reaches out of a surface, and where."""
    points = np.concatenate([vertices[:: 1 + len(vertices) // _POINTS], sample_surface(vertices, faces, _POINTS)])
    outside = points[np.abs(surface.winding_fast(points)) < 0.5]
    if not len(outside):
        return 0.0, points[0]
    distance = surface.unsigned_distance(outside)
    return float(distance.max()), outside[distance.argmax()]
