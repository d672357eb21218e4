"""Robots from MJCF files, as MuJoCo compiles them: bodies, the pose at rest, and the shapes that collide."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import numpy as np

from scenes.body.rig import Part, Rig
from scenes.body.solids import Solid, sentences, solid, uncovered
from scenes.body.urdf import Y_UP, read_urdf
from scenes.errors import UserError, clipped
from scenes.files import MOST_TEXT, readable
from scenes.mesh.content import distinct, joined
from scenes.mesh.scale import LARGEST
from scenes.motion.frames import transform

_ROOT = re.compile(r"\s*(?:<\?.*?\?>|<!--.*?-->|<!DOCTYPE[^<>]*>|\s)*<([A-Za-z_][\w.\-]*)", re.DOTALL)
"""The first element of an XML file, after its declaration and comments."""


def read_robot(path: str | Path) -> Rig:
    """Read a robot from an XML file: MJCF where its root is <mujoco>, else URDF; see `read_mjcf` and `read_urdf`."""
    return read_mjcf(path) if root_tag(path) == "mujoco" else read_urdf(path)


def root_tag(path: str | Path) -> str:
    """The first element of an XML file; "" where it has none. Raises UserError for a file that cannot be read."""
    path = readable(path, "robot file", MOST_TEXT)
    found = _ROOT.match(path.read_bytes().decode("utf-8-sig", errors="replace"))
    return found[1] if found else ""


def read_mjcf(path: str | Path) -> Rig:
    """Read a robot from an MJCF file, in metres, all joints at their reference (`qpos0`).

    Links are MuJoCo's bodies. A link's triangles are its shapes that collide, or those that are seen where none does;
    what is fixed to the world, such as a floor, is no part of the robot. Visual shapes that reach beyond the collision
    shapes of their link are doubts of the rig. Links keep the frames of the file; the world is turned from z up to y
    up, a robot that faces x facing +z.

    Raises:
        UserError: no such file; MuJoCo is missing or refuses it; no bodies or no shapes.
    """
    model = compiled(path)
    try:
        return rig_of(model, Path(path).stem, str(path))
    except UserError as error:
        raise UserError(f"robot file '{path}' {error}") from error


def compiled(path: str | Path) -> Any:
    """MuJoCo's model of an MJCF or URDF file.

    Raises:
        UserError: no such file; MuJoCo is missing, or refuses the file: its own words, in one line.
    """
    path = readable(path, "robot file", MOST_TEXT)
    try:
        import mujoco
    except ImportError as error:
        raise UserError(
            f"robot file '{path}' is read by MuJoCo, which is missing; install it with: pip install 'scenectl[robots]'"
        ) from error
    try:
        return mujoco.MjModel.from_xml_path(str(path))
    except (ValueError, mujoco.FatalError) as error:
        said = clipped(" ".join(str(error).split()), 300)
        raise UserError(f"robot file '{path}' is refused by MuJoCo: {said}; mend it there") from error


def rig_of(model: Any, name: str, source: str) -> Rig:
    """The bodies of MuJoCo's model at `qpos0` and their shapes; see `read_mjcf`. Link l is body l + 1.

    Raises:
        UserError: no bodies or no shapes; the sentence carries on from the file's name.
    """
    import mujoco

    if model.nbody < 2:
        raise UserError("has no bodies; give the file of a robot")
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    links = tuple(distinct(model.body(b).name or f"body {b}" for b in range(1, model.nbody)))
    frames = np.tile(np.eye(4), (model.nbody - 1, 1, 1))
    frames[:, :3, :3], frames[:, :3, 3] = data.xmat[1:].reshape(-1, 3, 3), data.xpos[1:]
    frames = Y_UP @ frames
    parts, doubts = [], []
    for body, (link, frame) in enumerate(zip(links, frames, strict=True), start=1):
        collides, seen = geoms_of(model, body)
        if not seen and not collides:
            continue
        solids = [geom_solid(model, geom) for geom in collides or seen]
        parts.append(Part.of(link, frame, *joined(solids)))
        if seen and collides:
            shown = [(geom_name(model, geom), geom_solid(model, geom)) for geom in seen]
            doubts.append(uncovered(link, shown, solids))
    if not parts:
        raise UserError("has no shapes on its bodies; export it with its meshes")
    above = tuple(int(parent) - 1 for parent in model.body_parentid[1:])
    return Rig(name, source, links, above, frames, tuple(parts), sentences(doubts))


def geoms_of(model: Any, body: int) -> tuple[list[int], list[int]]:
    """Geoms of a body that have a surface of their own: those that collide, and those that are only seen."""
    geoms = [g for g in np.flatnonzero(model.geom_bodyid == body).tolist() if int(model.geom_type[g]) in _solids()]
    collides = [g for g in geoms if model.geom_contype[g] or model.geom_conaffinity[g]]
    return collides, [g for g in geoms if g not in collides]


def geom_name(model: Any, geom: int) -> str:
    """Its own, that of its mesh, or its number."""
    if model.geom(geom).name:
        return str(model.geom(geom).name)
    mesh = int(model.geom_dataid[geom])
    return str(model.mesh(mesh).name) if mesh >= 0 else f"geom {geom}"


def geom_solid(model: Any, geom: int) -> Solid:
    """Triangles of one of `geoms_of` in its body's frame.

    Raises:
        UserError: it reaches over `LARGEST`; the sentence carries on from the file's name.
    """
    word, times = _solids()[int(model.geom_type[geom])]
    if word == "mesh":
        vertices, faces = _mesh(model, int(model.geom_dataid[geom]))
    else:
        vertices, faces = solid(word, (model.geom_size[geom] * times).tolist())
    placed = transform(geom_frame(model, geom), vertices)
    if not (np.abs(placed) <= LARGEST).all():
        raise UserError(f"has the shape '{geom_name(model, geom)}' over {LARGEST:g} m from its body; check its size")
    return placed, faces


def geom_frame(model: Any, geom: int) -> np.ndarray:
    """Transform from a geom to its body, ``[4, 4]``."""
    import mujoco

    turn, frame = np.zeros(9), np.eye(4)
    mujoco.mju_quat2Mat(turn, model.geom_quat[geom])
    frame[:3, :3], frame[:3, 3] = turn.reshape(3, 3), model.geom_pos[geom]
    return frame


def _solids() -> dict[int, tuple[str, tuple[float, ...]]]:
    """Geoms with a surface of their own: what `solid` calls them, and its sizes in MuJoCo's."""
    from mujoco import mjtGeom

    return {
        int(mjtGeom.mjGEOM_MESH): ("mesh", ()),
        int(mjtGeom.mjGEOM_BOX): ("box", (2.0, 2.0, 2.0)),  # MuJoCo states half sizes
        int(mjtGeom.mjGEOM_SPHERE): ("sphere", (1.0, 0.0, 0.0)),
        int(mjtGeom.mjGEOM_ELLIPSOID): ("ellipsoid", (1.0, 1.0, 1.0)),
        int(mjtGeom.mjGEOM_CYLINDER): ("cylinder", (1.0, 2.0, 0.0)),
        int(mjtGeom.mjGEOM_CAPSULE): ("capsule", (1.0, 2.0, 0.0)),
    }


def _mesh(model: Any, mesh: int) -> Solid:
    first, count = int(model.mesh_vertadr[mesh]), int(model.mesh_vertnum[mesh])
    begin, faces = int(model.mesh_faceadr[mesh]), int(model.mesh_facenum[mesh])
    vertices = np.asarray(model.mesh_vert[first : first + count], dtype=np.float64)
    return vertices, np.asarray(model.mesh_face[begin : begin + faces], dtype=np.int64)
