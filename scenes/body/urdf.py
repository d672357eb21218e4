"""Robots from URDF files: links, the joints between them at rest, and the shapes that collide."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any
from xml.etree import ElementTree
from xml.etree.ElementTree import Element

import numpy as np

from scenes.body.rig import Part, Rig
from scenes.body.solids import Uncovered, sentences, solid, uncovered
from scenes.errors import UserError, did_you_mean, shown
from scenes.files import MOST_TEXT, readable, unreadable
from scenes.mesh.collada import read_collada
from scenes.mesh.content import joined
from scenes.mesh.reading import READERS, read_content
from scenes.mesh.scale import LARGEST
from scenes.motion.frames import transform
from scenes.motion.skeleton import tree_order
from scenes.numbers import MOST, NARROWEST, is_number

Y_UP = np.array([[0.0, 1.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0], [1.0, 0.0, 0.0, 0.0], [0.0, 0.0, 0.0, 1.0]])
"""From URDF's world (x forward, y left, z up) to ours (z forward, x left, y up)."""

_READERS = {**READERS, "dae": read_collada}


def read_urdf(path: str | Path) -> Rig:
    """Read a robot from a URDF file, in metres, all joints at 0.

    A link's triangles are its collision shapes, or its visual ones where it has none; links without shapes have no
    part. Visual shapes that reach beyond the collision shapes of their link are doubts of the rig. Links keep the
    frames of the file; the world is turned from z up to y up, the robot facing +z. Mesh files are looked for beside the
    file: ``package://name/a/b.stl`` as ``name/a/b.stl`` or ``a/b.stl`` in its folder and those above.

    Raises:
        UserError: no such file; not a URDF; a DOCTYPE (no URDF needs one, and it can make a small file huge); joints
            that name unknown links, give one two parents or go round in a ring; numbers that cannot be read; a mesh
            file that is missing or cannot be read; no shapes.
    """
    path = readable(path, "robot file", MOST_TEXT)
    try:
        return _rig(path)
    except UserError as error:
        raise UserError(f"robot file '{path}' {error}") from error


def _rig(path: Path) -> Rig:
    robot = xml_of(path.read_bytes())
    if robot.tag != "robot":
        raise UserError(f"is not a URDF: its root is <{robot.tag}>, not <robot>; give a URDF file")
    links = [_attribute(link, "name", "a link") for link in robot.findall("link")]
    if not links or len(set(links)) < len(links):
        raise UserError("has two links of one name; rename one" if links else "has no links; export it again")
    place = {name: index for index, name in enumerate(links)}
    parents, origins = [-1] * len(links), [np.eye(4)] * len(links)
    for joint in robot.findall("joint"):
        name = f"joint '{joint.get('name', '?')}'"
        parent, child = (_end(joint, side, name, place) for side in ("parent", "child"))
        if parents[child] >= 0:
            raise UserError(f"gives link '{links[child]}' two parents, the second by {name}; keep one")
        parents[child], origins[child] = parent, _origin(joint, name)
    try:
        order = tree_order(parents)
    except ValueError as error:
        raise UserError("has joints that go round in a ring; cut it open") from error
    frames = np.zeros((len(links), 4, 4))
    for link in order:
        frames[link] = (Y_UP if parents[link] < 0 else frames[parents[link]]) @ origins[link]
    elements = robot.findall("link")
    parts = [part for link in order if (part := _part(elements[link], frames[link], path.parent)) is not None]
    doubts = sentences(_uncovered(elements[link], path.parent) for link in order)
    if not parts:
        raise UserError("has no collision or visual shapes; export it with its meshes")
    new = {old: index for index, old in enumerate(order)}
    above = tuple(new.get(parents[link], -1) for link in order)
    name = robot.get("name") or path.stem
    return Rig(name, str(path), tuple(links[link] for link in order), above, frames[order], tuple(parts), doubts)


def xml_of(data: bytes) -> Element:
    """The root of a robot's file; raises UserErrors that carry on from "robot file 'x' ..."."""
    if b"\0" in data:  # UTF-16 would hide a DOCTYPE
        raise UserError("is not UTF-8 text; save it as such")
    if re.search(rb"<!\s*(DOCTYPE|ENTITY)", data, re.IGNORECASE):
        raise UserError("has a DOCTYPE, which no URDF needs; remove it")
    try:
        return ElementTree.fromstring(data)
    except (ElementTree.ParseError, ValueError, LookupError) as error:
        raise UserError(f"is not valid XML ({error}); run xacro on it first, or export it again") from error


def _end(joint: Element, side: str, name: str, place: dict[str, int]) -> int:
    element = joint.find(side)
    link = None if element is None else element.get("link")
    if link not in place:
        raise UserError(f"has no link '{link}', the {side} of {name}; add it or remove the joint")
    return place[link]


def _part(link: Element, frame: np.ndarray, folder: Path) -> Part | None:
    name = f"link '{link.get('name')}'"
    shapes = link.findall("collision") or link.findall("visual")
    solids = [_solid(shape, name, folder) for shape in shapes]
    if not solids:
        return None
    return Part.of(str(link.get("name")), frame, *joined(solids))


def _uncovered(link: Element, folder: Path) -> Uncovered | str | None:
    """Visual shapes that reach beyond the collision shapes of their link."""
    seen, where = link.findall("visual"), f"link '{link.get('name')}'"
    if not seen or not link.findall("collision"):
        return None
    try:
        collides = [_solid(shape, where, folder) for shape in link.findall("collision")]
        shown = [_solid(shape, where, folder) for shape in seen]
    except UserError as error:  # nobody needs what is only seen
        return f"visual shapes of {where} were not compared with its collision shapes: the file {error}"
    names = [shape.get("name") or f"{shape.find('geometry')[0].tag} {k + 1}" for k, shape in enumerate(seen)]  # type: ignore[index]
    return uncovered(str(link.get("name")), list(zip(names, shown, strict=True)), collides)


def _solid(shape: Element, link: str, folder: Path) -> tuple[np.ndarray, np.ndarray]:
    """Vertices in the link's frame and triangles of one collision or visual shape."""
    geometry = shape.find("geometry")
    kind = None if geometry is None or len(geometry) == 0 else geometry[0]
    if kind is None:
        raise UserError(f"has a {shape.tag} without geometry in {link}; remove it")
    where = link if kind.tag == "mesh" else f"{kind.tag} of {link}"
    if kind.tag == "mesh":
        vertices, faces = mesh_of(kind, where, folder)
    elif kind.tag == "box":
        vertices, faces = solid("box", _sizes(kind, "size", where, 3))
    elif kind.tag == "sphere":
        vertices, faces = solid("sphere", _sizes(kind, "radius", where, 1))
    elif kind.tag in ("cylinder", "capsule"):
        vertices, faces = solid(kind.tag, [_sizes(kind, key, where, 1)[0] for key in ("radius", "length")])
    else:
        raise UserError(f"has the unknown shape <{kind.tag}> in {link}; use mesh, box, cylinder or sphere")
    with np.errstate(over="ignore", invalid="ignore"):
        placed = transform(_origin(shape, where), np.asarray(vertices, dtype=np.float64))
    if not (np.abs(placed) <= LARGEST).all():
        raise UserError(f"has a {kind.tag} in {link} that reaches over {LARGEST:g} m; check its scale and its offset")
    return placed, np.asarray(faces, dtype=np.int64)


def mesh_of(element: Element, where: str, folder: Path) -> tuple[np.ndarray, np.ndarray]:
    """Vertices (metres, the link's frame) and triangles of a <mesh>'s file, read as it stands but for its scale.

    Raises:
        UserError: a file that is missing or cannot be read, a scale of 0; the sentence carries on from the file's name.
    """
    uri = _attribute(element, "filename", where)
    file = mesh_file(uri, folder)
    what = f"names the mesh '{uri}' of {where}, which"
    if file is None:
        raise UserError(f"{what} is not beside it in '{folder}'; copy it there")
    if (ending := file.suffix.lower().removeprefix(".")) not in _READERS:
        raise UserError(f"{what} has the unknown format '{ending}'{did_you_mean(ending, _READERS)}")
    scale = np.array(_numbers(element, "scale", where, 3, "1 1 1"))
    if not scale.all():
        raise UserError(f"states scale={_quoted(element.get('scale'))} for the {where}; give numbers other than 0")
    pieces = read_content(file, what, _READERS).pieces
    vertices, faces = joined([(piece.vertices, piece.faces) for piece in pieces])
    if not np.isfinite(vertices).all():
        raise UserError(f"{what} has NaN or infinite coordinates; repair it")
    with np.errstate(over="ignore", invalid="ignore"):  # what is too large is told by `_solid`
        vertices = vertices * scale
    return vertices, faces if scale.prod() > 0 else faces[:, ::-1]


def mesh_file(uri: str, folder: Path) -> Path | None:
    """The file that a mesh's address means."""
    scheme, _, rest = uri.rpartition("://")
    names = [rest] if scheme != "package" else [rest, rest.partition("/")[2]]
    folders = [folder, *folder.resolve().parents] if scheme == "package" else [folder]
    return next((at / name for at in folders for name in names if name and not unreadable(at / name)), None)


def _origin(element: Element, where: str) -> np.ndarray:
    """Transform of an element's <origin>: fixed-axis roll, pitch and yaw, then the offset; ``[4, 4]``."""
    from trimesh.transformations import euler_matrix

    origin = element.find("origin")
    if origin is None:
        return np.eye(4)
    offset = _numbers(origin, "xyz", where, 3, "0 0 0")
    frame: np.ndarray = euler_matrix(*_numbers(origin, "rpy", where, 3, "0 0 0"), axes="sxyz")
    frame[:3, 3] = offset
    return frame


def _numbers(element: Element, key: str, where: str, count: int, default: str | None = None) -> list[float]:
    text = element.get(key, default)
    try:
        numbers = [float(word) for word in (text or "").split()]
    except ValueError:
        numbers = []
    if len(numbers) != count or not all(map(is_number, numbers)):
        wanted = "a number" if count == 1 else f"{count} numbers"
        raise UserError(f"states {key}={_quoted(text)} for the {where}; give {wanted}, at most {MOST:.0e}")
    return numbers


def _sizes(element: Element, key: str, where: str, count: int) -> list[float]:
    numbers = _numbers(element, key, where, count)
    if min(numbers) <= 0:
        raise UserError(f"states {key}={_quoted(element.get(key))} for the {where}; give positive metres")
    if not NARROWEST <= min(numbers) <= max(numbers) <= LARGEST:
        given, sizes = _quoted(element.get(key)), f"{NARROWEST:g} to {LARGEST:g}"
        raise UserError(f"states {key}={given} for the {where}; give metres from {sizes}")
    return numbers


def _attribute(element: Element, key: str, where: str) -> str:
    if not (value := element.get(key)):
        raise UserError(f"has no {key} for {where}; add it")
    return value


def _quoted(value: Any) -> str:
    return "nothing" if value is None else shown(value)
