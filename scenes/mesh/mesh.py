"""Triangle meshes: where the geometry of a scene comes from, always in metres and y up."""

from __future__ import annotations

import hashlib
import re
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from scenes.errors import UserError, did_you_mean
from scenes.files import readable
from scenes.mesh.content import Content, distinct, joined
from scenes.mesh.reading import FORMATS, read_content
from scenes.mesh.scale import TO_Y_UP, UNITS, check_extent, doubts, in_metres
from scenes.mesh.stray import without_strays
from scenes.numbers import MOST

_UNIT_WORDS = {
    **dict.fromkeys(("m", "meter", "meters", "metre", "metres"), "m"),
    **dict.fromkeys(("cm", "centimeter", "centimeters", "centimetre", "centimetres"), "cm"),
    **dict.fromkeys(("mm", "millimeter", "millimeters", "millimetre", "millimetres"), "mm"),
    **dict.fromkeys(("in", "inch", "inches"), "in"),
    **dict.fromkeys(("ft", "foot", "feet"), "ft"),
}


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
        bounds = np.stack([corners.min(axis=0), corners.max(axis=0)])
        if (far := float(np.abs(bounds).max())) > MOST:
            raise UserError(
                f"mesh '{self.name}' has coordinates of {far:.1e} m, and at most {MOST:.0e} are read; move it"
            )
        object.__setattr__(self, "vertices", vertices)
        object.__setattr__(self, "faces", faces)
        object.__setattr__(self, "bounds", bounds)
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
    path = Path(path)
    content, said = _read(path, unit, up)
    mesh = _mesh(path.stem, path, joined([(piece.vertices, piece.faces) for piece in content.pieces]), *said)
    check_extent(f"mesh file '{path}'", mesh.unit, mesh.bounds)
    return _doubted(mesh, content, mesh.triangles, said)


def load_parts(path: str | Path, unit: str | None = None, up: str | None = None) -> dict[str, Mesh]:
    """Read the objects of a scene file as meshes of their own, each where it stands: metres, y up.

    Objects are the nodes of a glTF scene and the ``o`` lines of an OBJ file; other formats hold one. Arguments and
    errors as for `load_mesh`, but a single object may be smaller than a scene. What is in doubt about the file is a
    doubt of its first object.

    Returns:
        Meshes by name; names that the file gives several times are numbered.
    """
    path = Path(path)
    content, said = _read(path, unit, up)
    names = distinct(piece.name for piece in content.pieces)
    parts = [
        _mesh(name, path, (piece.vertices, piece.faces), *said)
        for name, piece in zip(names, content.pieces, strict=True)
    ]
    check_extent(f"mesh file '{path}'", parts[0].unit, hull([part.bounds for part in parts]))
    everything = np.concatenate([part.triangles for part in parts])
    parts[0] = _doubted(parts[0], content, everything, said)
    return dict(zip(names, parts, strict=True))


def hull(boxes: Sequence[np.ndarray]) -> np.ndarray:
    """Bounds ``[2, 3]`` around several."""
    return np.stack([np.min([box[0] for box in boxes], axis=0), np.max([box[1] for box in boxes], axis=0)])


def _read(path: Path, unit: str | None, up: str | None) -> tuple[Content, tuple[str | None, str | None]]:
    """Everything in the file, placed, in its own unit and axes; and these, None where neither user nor file says."""
    readable(path, "mesh file")
    ending = path.suffix.lower().removeprefix(".")
    if ending not in FORMATS:
        raise UserError(f"mesh file '{path}' has the unknown format '{ending}'{did_you_mean(ending, FORMATS)}")
    for what, word, known in (("unit", unit, UNITS), ("up axis", up, TO_Y_UP)):
        if word is not None and word not in known:
            raise UserError(f"unknown {what} '{word}'{did_you_mean(word, known)}")
    comments = {} if ending in ("glb", "gltf", "stl") else _stated_in_comments(path)
    return read_content(path, f"mesh file '{path}'"), (unit or comments.get("unit"), up or comments.get("up"))


def _mesh(name: str, path: Path, shape: tuple[np.ndarray, np.ndarray], unit: str | None, up: str | None) -> Mesh:
    """The mesh that was read, in metres and y up, without its stray triangles."""
    unit, up = unit or "m", up or "y"
    with np.errstate(all="ignore"):  # what is not finite, or huge, is told by the mesh
        vertices, faces, strays = without_strays(in_metres(shape[0], unit, up), shape[1], name)
    return Mesh(vertices, faces, name, str(path), unit, up, doubts=strays)


def _doubted(mesh: Mesh, content: Content, triangles: np.ndarray, said: tuple[str | None, str | None]) -> Mesh:
    """The mesh with what is in doubt about its file, whose triangles (m) are all of these."""
    found = (*mesh.doubts, *content.doubts, *doubts(f"'{Path(mesh.source).name}'", triangles, *said))
    return replace(mesh, doubts=found) if found else mesh


def _stated_in_comments(path: Path) -> dict[str, str]:
    """Unit and up axis as comments at the top of a PLY, OBJ or OFF file may state them."""
    with path.open("rb") as file:
        head = file.read(4096).removeprefix(b"\xef\xbb\xbf").decode("latin-1")
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
