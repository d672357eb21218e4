"""Things in a scene by name: the nodes of its files, its meshes and its objects."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from scenes.mesh.mesh import Mesh, hull, load_parts


def named_parts(meshes: Sequence[Mesh]) -> dict[str, Mesh]:
    """Meshes by name, each where it stands: the objects of those that were read from files, and the others whole.

    A file is read again, as meshes hold no names of their triangles. Where two have the same name, the first has it.
    """
    found: dict[str, Mesh] = {}
    for mesh in meshes:
        for name, part in ({mesh.name: mesh} | _objects(mesh)).items():
            found.setdefault(name, part)
    return found


def _objects(mesh: Mesh) -> dict[str, Mesh]:
    """The objects of a mesh's file, moved as the mesh was; none where it was read from no file that still is there."""
    if not Path(mesh.source).is_file():
        return {}
    parts = load_parts(mesh.source, mesh.unit, mesh.up)
    by = mesh.bounds[0] - hull([part.bounds for part in parts.values()])[0]
    return {name: part.moved(by) if np.abs(by).max() > 0 else part for name, part in parts.items()}
