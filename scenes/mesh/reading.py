"""Mesh files of any format: which reader reads which."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from scenes.errors import UserError
from scenes.files import unreadable
from scenes.mesh.content import Content, told
from scenes.mesh.gltf import read_gltf
from scenes.mesh.obj import read_obj
from scenes.mesh.off import read_off
from scenes.mesh.ply import read_ply
from scenes.mesh.stl import read_stl

READERS: dict[str, Callable[[Path], Content]] = {
    "glb": read_gltf, "gltf": read_gltf, "obj": read_obj, "off": read_off, "ply": read_ply, "stl": read_stl,
}  # fmt: skip
FORMATS = tuple(READERS)
"""File name endings of scenes."""


def read_content(path: Path, file: str, readers: dict[str, Callable[[Path], Content]] = READERS) -> Content:
    """All triangles of a file, in its own unit and axes.

    Args:
        path: an existing file whose ending is one of the readers'.
        file: subject of the sentence that says what is wrong, such as "mesh file 'a.obj'".
        readers: by file name ending.

    Raises:
        UserError: what cannot be read, or has no triangles.
    """
    ending = path.suffix.lower().removeprefix(".")
    with told(file, ending.upper()):
        if fault := unreadable(path):
            raise UserError(fault)
        content = readers[ending](path)
        if not any(len(piece.faces) for piece in content.pieces):
            raise UserError("has no triangles (a point cloud or an empty scene); export it with faces")
    return content
