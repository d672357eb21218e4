"""Solids as a binary glTF file, one named object each: what `scenes.mesh.mesh.load_parts` reads back."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from scenes.mesh.colours import linear


@dataclass(frozen=True)
class Item:
    """One object of a scene: a closed solid (a `manifold3d.Manifold`, metres) with a name and an sRGB colour."""

    name: str
    solid: Any
    colour: tuple[int, int, int]


def glb(items: Sequence[Item]) -> bytes:
    """A scene as a binary glTF file: one named node, mesh and material per object."""
    import trimesh

    scene = trimesh.Scene()
    for item in items:
        solid = item.solid.to_mesh()
        colour = [*linear(np.array(item.colour)).round(4).tolist(), 1.0]  # no library's last digit shows
        material = trimesh.visual.material.PBRMaterial(
            name=item.name, baseColorFactor=colour, metallicFactor=0.0, roughnessFactor=0.9
        )
        # vertices are shared, normals left out: a viewer then shades flat, which suits boxes
        shape = trimesh.Trimesh(
            vertices=np.asarray(solid.vert_properties[:, :3], dtype=np.float64),
            faces=np.asarray(solid.tri_verts, dtype=np.int64),
            process=False,
        )
        shape.visual = trimesh.visual.TextureVisuals(material=material)
        scene.add_geometry(shape, geom_name=item.name, node_name=item.name)
    data: bytes = scene.export(file_type="glb", include_normals=False)
    return data
