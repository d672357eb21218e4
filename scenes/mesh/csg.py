"""Solids cut from other solids."""

from __future__ import annotations

from functools import reduce
from typing import Any

import numpy as np

from scenes.errors import UserError, did_you_mean
from scenes.mesh.mesh import Mesh
from scenes.mesh.primitives import Plane, Primitive
from scenes.mesh.surface import clean


def csg(op: str, *parts: Primitive | Mesh) -> Mesh:
    """Combine solids into one closed mesh, through manifold3d.

    Args:
        op: "union", "difference" (the first minus all others) or "intersection".
        parts: closed meshes facing outward, or primitives (their meshes at 0 s); at least one, no planes.

    Raises:
        UserError: unknown op, no parts, a part that is not a closed solid, or nothing left.
    """
    import manifold3d

    symbols = {"union": lambda a, b: a + b, "difference": lambda a, b: a - b, "intersection": lambda a, b: a ^ b}
    if op not in symbols:
        raise UserError(f"unknown CSG operation '{op}'{did_you_mean(op, symbols)}")
    if not parts:
        raise UserError(f"CSG {op} of nothing; give at least one solid")
    result = reduce(symbols[op], [_solid(part, index, manifold3d) for index, part in enumerate(parts)])
    mesh = result.to_mesh64()
    if len(mesh.tri_verts) == 0:
        raise UserError(f"CSG {op} leaves nothing; check the places and sizes of its {len(parts)} parts")
    return Mesh(np.asarray(mesh.vert_properties)[:, :3], np.asarray(mesh.tri_verts), op, f"csg {op}")


def _solid(part: Primitive | Mesh, index: int, manifold3d: Any) -> Any:
    if isinstance(part, Plane):
        raise UserError(f"CSG part {index} is a plane, which has no volume; use a large box")
    mesh = part if isinstance(part, Mesh) else part.mesh()
    vertices, faces, _ = clean(mesh.vertices, mesh.faces)
    solid = manifold3d.Manifold(manifold3d.Mesh64(vertices, faces.astype(np.uint64)))
    if solid.status() != manifold3d.Error.NoError or solid.volume() <= 0:
        raise UserError(
            f"CSG part {index} ('{mesh.name}') is not a closed solid facing outward ({solid.status().name}); repair it"
        )
    return solid
