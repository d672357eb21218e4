"""Colours of meshes: those of the files that they came from, a face each."""

from __future__ import annotations

import warnings
from pathlib import Path
from typing import Any

import numpy as np

from scenes.mesh.mesh import Mesh
from scenes.mesh.scale import in_metres

CLAY, OBSTACLE = (216, 211, 203), (122, 94, 168)
"""Colours of meshes that bring none: of what stands, and of what moves."""
_SIDE, _PIXELS = 2048, 8192**2
"""Pixels of a side to which textures are shrunk, for a face has one colour; and of a whole one, beyond which it is not
decoded: the colour of the material is drawn then."""


def face_colours(mesh: Mesh, otherwise: tuple[int, int, int] = CLAY) -> np.ndarray:
    """sRGB colour of every face, ``[F, 3]`` uint8: those of the file it came from, else `otherwise`."""
    plain = np.tile(np.array(otherwise, dtype=np.uint8), (len(mesh.faces), 1))
    path = Path(mesh.source)
    if not path.is_file():
        return plain
    import trimesh

    try:
        with warnings.catch_warnings(action="ignore"):  # of Pillow, about pictures that are not decoded
            scene = trimesh.load_scene(path, process=False)
        for part in scene.geometry.values():
            _without_large(getattr(part.visual, "material", None))
        parts = [part for part in scene.dump() if isinstance(part, trimesh.Trimesh) and len(part.faces)]
        centres = in_metres(np.concatenate([part.triangles_center for part in parts]), mesh.unit, mesh.up)
        colours = np.concatenate([_colours_of(part) for part in parts])
    except Exception:  # colours are decoration: a file whose materials cannot be read is drawn in clay
        return plain
    wanted = mesh.triangles.mean(axis=1)
    if centres.shape == wanted.shape and np.allclose(centres, wanted, atol=1e-4):
        return colours
    # trimesh cuts polygons and orders faces in its own way: the nearest of its faces is the same or a neighbour
    from scipy.spatial import cKDTree

    return np.asarray(colours[cKDTree(centres).query(wanted)[1]])


def linear(colours: np.ndarray) -> np.ndarray:
    """Shares of light, as glTF and USD state them, of sRGB colours (0 to 255), by IEC 61966-2-1."""
    share = np.asarray(colours) / 255.0
    return np.where(share <= 0.04045, share / 12.92, ((share + 0.055) / 1.055) ** 2.4)


def _without_large(material: Any) -> None:
    """Make a material's picture small, before anything decodes or copies it whole, and drop those of no colour."""
    for name in ("normalTexture", "emissiveTexture", "occlusionTexture", "metallicRoughnessTexture"):
        if hasattr(material, name):
            setattr(material, name, None)
    for name in ("baseColorTexture", "image"):
        picture = getattr(material, name, None)
        if picture is None:
            continue
        if picture.size[0] * picture.size[1] > _PIXELS:
            setattr(material, name, None)
            continue
        picture.draft("RGB", (_SIDE, _SIDE))  # a JPEG is decoded at a fraction of its size
        picture.thumbnail((_SIDE, _SIDE))


def _colours_of(part: Any) -> np.ndarray:
    """Colour of each face of one part, ``[F, 3]``: of its material, its texture or its vertices, else clay."""
    visual, faces = part.visual, np.asarray(part.faces)
    material = getattr(visual, "material", None)
    texture = getattr(material, "baseColorTexture", None) or getattr(material, "image", None)
    if getattr(visual, "defined", False) and texture is None and material is not None:
        colour = np.asarray(material.main_color)[:3] / 255.0
        if hasattr(material, "baseColorFactor"):  # glTF states linear light, pictures are sRGB
            colour = np.where(colour <= 0.0031308, 12.92 * colour, 1.055 * colour ** (1 / 2.4) - 0.055)
        return np.tile((255 * colour).astype(np.uint8), (len(faces), 1))
    if getattr(visual, "defined", False):
        vertices = np.asarray((visual.to_color() if texture is not None else visual).vertex_colors)[:, :3]
        return vertices[faces].mean(axis=1).astype(np.uint8)
    return np.tile(np.array(CLAY, dtype=np.uint8), (len(faces), 1))
