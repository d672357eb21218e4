"""Shapes of which robots' files build links, as triangles."""

from __future__ import annotations

from collections.abc import Sequence

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


def uncovered(where: str, shown: Sequence[tuple[str, Solid]], collides: Sequence[Solid]) -> str:
    """A sentence on visual shapes, by name, that reach beyond the collision shapes of their link; "" where none does.

    Args:
        where: the link, as the sentence names it.
        shown, collides: one or more shapes that are seen and that collide, in the link's frame.
    """
    try:
        surface = Surface.of(Mesh(*joined(collides)))
        reaches = [_beyond(surface, *seen) for _, seen in shown]
    except UserError as error:  # nobody needs what is only seen
        return f"visual shapes of {where} were not compared with its collision shapes: the file {error}"
    out = [index for index, (reach, _) in enumerate(reaches) if reach > _APART]
    if not out:
        return ""
    names = ", ".join(shown[index][0] for index in out)
    reach, at = max((reaches[index] for index in out), key=lambda found: found[0])
    return (
        f"{len(out)} of {len(shown)} visual shapes of {where} ({names}) reach up to {reach:.2f} m beyond its "
        f"collision shapes, farthest at ({', '.join(f'{x:.2f}' for x in at)}) m in the link's frame; capsules leave "
        "that out, so add collision shapes there if it can be touched"
    )


def _beyond(surface: Surface, vertices: np.ndarray, faces: np.ndarray) -> tuple[float, np.ndarray]:
    """How far (m) a shape reaches out of a surface, and where."""
    points = np.concatenate([vertices[:: 1 + len(vertices) // _POINTS], sample_surface(vertices, faces, _POINTS)])
    outside = points[np.abs(surface.winding_fast(points)) < 0.5]
    if not len(outside):
        return 0.0, points[0]
    distance = surface.unsigned_distance(outside)
    return float(distance.max()), outside[distance.argmax()]
