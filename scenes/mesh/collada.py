"""COLLADA files, which robots keep their meshes in."""

from __future__ import annotations

import io
import re
from pathlib import Path

import numpy as np

from scenes.errors import UserError
from scenes.mesh.content import Content, Piece, text_of
from scenes.mesh.polygons import triangulated


def read_collada(path: Path) -> Content:
    """Read the scene of a .dae file in metres, its axes as they stand: as RViz takes them, whatever they call up.

    Raises:
        UserError: a DOCTYPE, which can make a small file huge; not COLLADA, or cut off.
    """
    import collada

    data = text_of(path)
    if re.search(rb"<!\s*(DOCTYPE|ENTITY)", data, re.IGNORECASE):
        raise UserError("has a DOCTYPE, which no COLLADA file needs; remove it")
    harmless = [collada.common.DaeUnsupportedError, collada.common.DaeBrokenRefError]  # cameras, materials, pictures
    try:
        document = collada.Collada(io.BytesIO(data), ignore=harmless, aux_file_loader=lambda _: b"")
    except Exception as error:  # of the library and of either XML parser under it
        what = str(error).partition("\n")[0]
        if not data.rstrip().endswith(b">") or b"</COLLADA" not in data:
            raise UserError("is cut off: it does not end with </COLLADA>; export or copy it again") from error
        raise UserError(f"is not COLLADA and cannot be read ({what}); export it again") from error
    scene = document.scene or next(iter(document.scenes), None)
    metres = document.assetInfo.unitmeter or 1.0
    pieces = []
    for geometry in [] if scene is None else scene.objects("geometry"):
        turned = np.linalg.det(geometry.matrix[:3, :3]) < 0
        for primitive in geometry.primitives():
            if hasattr(primitive, "polygons"):
                rings = [np.asarray(polygon.indices) for polygon in primitive.polygons()]
            else:
                rings = [] if primitive.vertex_index is None else list(np.asarray(primitive.vertex_index))
            vertices = np.asarray(primitive.vertex, dtype=np.float64) * metres
            counts = np.array(list(map(len, rings)), dtype=np.int64)
            faces = triangulated(vertices, np.concatenate([np.zeros(0, dtype=np.int64), *rings]), counts)
            pieces.append(Piece(str(geometry.original.id), vertices, faces[:, ::-1] if turned else faces))
    return Content(pieces)
