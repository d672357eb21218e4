"""Triangle meshes: where the geometry of a scene comes from, always in metres and y up."""

from __future__ import annotations

import hashlib
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np

from scenes.errors import UserError, did_you_mean
from scenes.mesh.stray import without_strays

FORMATS = ("glb", "gltf", "obj", "off", "ply", "stl")
"""File name endings that `load_mesh` reads."""

UNITS = {"m": 1.0, "cm": 0.01, "mm": 0.001, "in": 0.0254, "ft": 0.3048}
"""Metres in each unit that a file may be in."""

_UNIT_WORDS = {
    **dict.fromkeys(("m", "meter", "meters", "metre", "metres"), "m"),
    **dict.fromkeys(("cm", "centimeter", "centimeters", "centimetre", "centimetres"), "cm"),
    **dict.fromkeys(("mm", "millimeter", "millimeters", "millimetre", "millimetres"), "mm"),
    **dict.fromkeys(("in", "inch", "inches"), "in"),
    **dict.fromkeys(("ft", "foot", "feet"), "ft"),
}

# Proper rotations that take the named axis to +y; rows act on column vectors (x, y, z).
_TO_Y_UP = {
    "x": np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]]),
    "y": np.eye(3),
    "z": np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]]),
}

SMALLEST, LARGEST = 0.05, 2000.0
"""Plausible extents of a scene (m), along its longest side: 5 cm to 2 km."""


@dataclass(frozen=True, eq=False)
class Mesh:
    """Triangles in space.

    Attributes:
        vertices: positions, ``[V, 3]`` float64, metres, y up.
        faces: vertex indices of the triangles, ``[F, 3]`` int64; the front side sees them counter-clockwise.
        name: short name for reports.
        source: the file it was read from, or how it was made.
        unit: unit of the source; `vertices` are metres whatever it says.
        up: axis that pointed up in the source; in `vertices` it is y.
        digest: SHA-256 of vertices and faces, hexadecimal; computed when left empty.
        doubts: what whoever gave the file should hear about how it was read, one sentence each.
        bounds: lowest and highest corner of the vertices that triangles use, ``[2, 3]``, metres.

    Raises:
        UserError: wrong shapes, no triangles, coordinates that are not finite, or faces naming missing vertices.
    """

    vertices: np.ndarray
    faces: np.ndarray
    name: str = "mesh"
    source: str = "arrays"
    unit: str = "m"
    up: str = "y"
    digest: str = ""
    doubts: tuple[str, ...] = ()
    bounds: np.ndarray = field(init=False, repr=False)

    def __post_init__(self) -> None:
        vertices = np.array(self.vertices, dtype=np.float64, order="C")
        faces = np.array(self.faces, dtype=np.int64, order="C")
        if vertices.ndim != 2 or vertices.shape[1] != 3 or faces.ndim != 2 or faces.shape[1] != 3:
            raise UserError(
                f"mesh '{self.name}' has vertices {vertices.shape} and faces {faces.shape}; give [V, 3] and [F, 3]"
            )
        if len(faces) == 0 or len(vertices) == 0:
            raise UserError(f"mesh '{self.name}' has no triangles; export it with its faces")
        if faces.min() < 0 or faces.max() >= len(vertices):
            raise UserError(f"mesh '{self.name}' has faces that name vertices beyond its {len(vertices)}; repair it")
        used = np.zeros(len(vertices), dtype=bool)
        used[faces.reshape(-1)] = True
        corners = vertices if used.all() else vertices[used]
        bad = 0 if np.isfinite(corners).all() else int((~np.isfinite(corners)).any(axis=1).sum())
        if bad:
            raise UserError(f"mesh '{self.name}' has {bad} vertices with NaN or infinite coordinates; repair it first")
        object.__setattr__(self, "vertices", vertices)
        object.__setattr__(self, "faces", faces)
        object.__setattr__(self, "bounds", np.stack([corners.min(axis=0), corners.max(axis=0)]))
        if not self.digest:
            state = hashlib.sha256(vertices.data)
            state.update(faces.data)
            object.__setattr__(self, "digest", state.hexdigest())
        vertices.flags.writeable = faces.flags.writeable = self.bounds.flags.writeable = (
            False  # the digest must stay true
        )

    def moved(self, by: Sequence[float]) -> Mesh:
        """The same elsewhere, by so much (m)."""
        return replace(self, vertices=self.vertices + by, digest="")

    @property
    def triangles(self) -> np.ndarray:
        """Corner positions of every triangle, ``[F, 3, 3]``, metres."""
        corners: np.ndarray = self.vertices[self.faces]
        return corners


def load_mesh(path: str | Path, unit: str | None = None, up: str | None = None) -> Mesh:
    """Read a mesh file into metres, y up.

    Args:
        path: a GLB, glTF, OBJ, PLY, STL or OFF file. Scenes of several parts become one mesh. A few small triangles far
            from all else are left out, with a doubt (`scenes.mesh.stray`).
        unit: "m", "cm", "mm", "in" or "ft". Default: metres for glTF (its standard says so); for the others
            what a header comment such as ``comment unit: mm`` states, else metres.
        up: "x", "y" or "z", the axis that points up in the file. Default: y, or what a header comment such as
            ``# up: z`` states.

    Raises:
        UserError: missing file, unknown format or unit, unreadable content, no triangles, coordinates that are
            not finite, or an extent that no scene has (under 5 cm or over 2 km).
    """
    path, unit, up = _stated(path, unit, up)
    vertices, faces = joined([(vertices, faces) for _, vertices, faces in _read(path)])
    mesh = _mesh(vertices * UNITS[unit] @ _TO_Y_UP[up].T, faces, path.stem, str(path), unit, up)
    _check_extent(path, unit, mesh.bounds)
    return mesh


def _mesh(vertices: np.ndarray, faces: np.ndarray, name: str, source: str, unit: str, up: str) -> Mesh:
    """The mesh that was read (m, y up), without its stray triangles."""
    vertices, faces, doubts = without_strays(vertices, faces, name)
    return Mesh(vertices, faces, name, source, unit, up, doubts=doubts)


def joined(pieces: Sequence[tuple[np.ndarray, np.ndarray]]) -> tuple[np.ndarray, np.ndarray]:
    """Vertices ``[V, 3]`` and faces ``[F, 3]`` of several pieces, at least one, as those of one; nothing is merged."""
    starts = np.cumsum([0] + [len(vertices) for vertices, _ in pieces])
    faces = np.concatenate([faces + start for (_, faces), start in zip(pieces, starts, strict=False)])
    return np.concatenate([vertices for vertices, _ in pieces]), faces


def load_parts(path: str | Path, unit: str | None = None, up: str | None = None) -> dict[str, Mesh]:
    """Read the objects of a scene file as meshes of their own, each where it stands: metres, y up.

    Objects are the nodes of a glTF scene and the ``o`` lines of an OBJ file; other formats hold one. Arguments and
    errors as for `load_mesh`, but a single object may be smaller than a scene.

    Returns:
        Meshes by name.
    """
    path, unit, up = _stated(path, unit, up)
    meshes = {
        name: _mesh(vertices * UNITS[unit] @ _TO_Y_UP[up].T, faces, name, str(path), unit, up)
        for name, vertices, faces in _read(path, _BY_OBJECT.get(path.suffix.lower(), {}))
    }
    _check_extent(path, unit, hull([mesh.bounds for mesh in meshes.values()]))
    return meshes


def hull(boxes: Sequence[np.ndarray]) -> np.ndarray:
    """Bounds ``[2, 3]`` around several."""
    return np.stack([np.min([box[0] for box in boxes], axis=0), np.max([box[1] for box in boxes], axis=0)])


_BY_OBJECT = {
    ".obj": {"split_objects": True, "group_material": False},
    ".glb": {"merge_primitives": True},
    ".gltf": {"merge_primitives": True},
}
"""Options of trimesh by which an object of several materials is read as one object."""


def _stated(path: str | Path, unit: str | None, up: str | None) -> tuple[Path, str, str]:
    """The file, its unit and its up axis: as stated, as its comments say, or by default."""
    path = Path(path)
    if not path.is_file():
        raise UserError(f"mesh file '{path}' does not exist")
    ending = path.suffix.lower().removeprefix(".")
    if ending not in FORMATS:
        raise UserError(f"mesh file '{path}' has the unknown format '{ending}'{did_you_mean(ending, FORMATS)}")
    comments = {} if ending in ("glb", "gltf", "stl") else _stated_in_comments(path)
    unit = _known("unit", unit or comments.get("unit", "m"), UNITS)
    return path, unit, _known("up axis", up or comments.get("up", "y"), _TO_Y_UP)


def _known(what: str, word: str, known: dict[str, Any]) -> str:
    if word not in known:
        raise UserError(f"unknown {what} '{word}'{did_you_mean(word, known)}")
    return word


def _read(path: Path, options: Mapping[str, bool] = MappingProxyType({})) -> list[tuple[str, np.ndarray, np.ndarray]]:
    """Name, vertices and faces of everything in the file, placed, in the file's own unit and axes."""
    import trimesh  # 0.3 s to import, needed only here

    try:
        scene = trimesh.load_scene(path, process=False, **options)
        parts = [part for part in scene.dump() if isinstance(part, trimesh.Trimesh)]
    except Exception as error:  # each of trimesh's parsers raises its own kinds
        reason = str(error).splitlines()[0] if str(error) else type(error).__name__
        raise UserError(f"mesh file '{path}' cannot be read ({reason}); export it again") from error
    parts = [part for part in parts if len(part.faces)]
    if not parts:
        raise UserError(f"mesh file '{path}' has no triangles (a point cloud or an empty scene); export it with faces")
    return [
        (str(part.metadata["node"]), np.asarray(part.vertices, np.float64), np.asarray(part.faces, np.int64))
        for part in parts
    ]


def _stated_in_comments(path: Path) -> dict[str, str]:
    """Unit and up axis as comments at the top of a PLY, OBJ or OFF file may state them."""
    with path.open("rb") as file:
        head = file.read(4096).decode("latin-1")
    stated: dict[str, str] = {}
    for line in head.splitlines():
        text = line.strip().lower()
        if text == "end_header":
            break
        if not text.startswith(("#", "comment", "obj_info")):
            continue
        found = re.search(r"\bunits?\b\s*[:=]?\s*([a-z]+)", text)
        if found and found[1] in _UNIT_WORDS:
            stated["unit"] = _UNIT_WORDS[found[1]]
        if found := re.search(r"\bup(?:[ _-]?axis)?\b\s*[:=]?\s*\+?([xyz])\b", text):
            stated["up"] = found[1]
        if found := re.search(r"\b([xyz])[ _-]up\b", text):
            stated["up"] = found[1]
    return stated


def _check_extent(path: Path, unit: str, bounds: np.ndarray) -> None:
    extent = float(np.ptp(bounds, axis=0).max())
    if SMALLEST <= extent <= LARGEST:
        return
    size = f"{extent:.3g} m" if extent < 1e5 else f"{extent:.1e} m"
    raw = extent / UNITS[unit]
    fitting = [other for other, metres in UNITS.items() if 0.5 <= raw * metres <= 100.0 and other != unit]
    hint = f"did you mean unit='{fitting[-1] if 'mm' not in fitting else 'mm'}'?" if fitting else "state its unit"
    raise UserError(f"mesh file '{path}' is {size} long in unit '{unit}', and scenes are 5 cm to 2 km; {hint}")
