"""Robots' files: MJCF and URDF to MuJoCo's models of one robot each, with a free joint at the root."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from importlib import import_module
from pathlib import Path
from typing import Any
from xml.etree import ElementTree
from xml.etree.ElementTree import Element

from scenes.body.urdf import mesh_file, xml_of
from scenes.errors import UserError
from scenes.files import MOST_TEXT, readable

MESHES = frozenset({".stl", ".obj", ".msh"})
"""Endings of mesh files that MuJoCo reads."""
LIGHTEST = 1e-4, 1e-9
"""Mass (kg) and inertia (kg m^2) that moving bodies get which have none: MuJoCo takes no body without."""


@dataclass
class Read:
    """What a robot's file holds.

    Attributes:
        model: MuJoCo's.
        speeds: largest speeds (rad/s, or m/s of slides) that the file states, by joint.
        doubts: what was left out or made up, one sentence each.
    """

    model: Any
    speeds: dict[str, float] = field(default_factory=dict)
    doubts: list[str] = field(default_factory=list)


def borrowed(name: str) -> Any:
    """A module of the extra `robots`; raises UserError where it is not installed."""
    try:
        return import_module(name)
    except ImportError as error:
        raise UserError(f"robots need '{name.partition('.')[0]}'; pip install 'scenectl[robots]'") from error


def read(file: str | Path) -> Read:
    """Read an MJCF or a URDF.

    The robot is the largest tree of bodies that stands in the world; all else in the world is left out, and so are
    meshes that are missing, which kinematics does without. Where its root has no free joint, it gets one.

    Raises:
        UserError: no such file, a file of another kind, or one that MuJoCo cannot read.
    """
    path = readable(file, "robot file", MOST_TEXT)
    mujoco, doubts = borrowed("mujoco"), list[str]()
    try:
        root = xml_of(path.read_bytes())
        if root.tag not in ("mujoco", "robot"):
            raise UserError(f"has the root <{root.tag}>; give an MJCF (<mujoco>) or a URDF (<robot>)")
        try:
            if root.tag == "robot":
                doubts += _prepared(root, path.parent)
                spec = mujoco.MjSpec.from_string(ElementTree.tostring(root, encoding="unicode"))
            else:
                spec = mujoco.MjSpec.from_file(str(path))
            doubts += [*_without_files(spec, path.parent), *_alone(spec, mujoco)]
            model = spec.compile()
        except (ValueError, RuntimeError, mujoco.FatalError) as error:
            if isinstance(error, UserError):
                raise
            raise UserError(f"cannot be read by MuJoCo ({' '.join(str(error).split())}); repair it") from error
    except UserError as error:
        raise UserError(f"robot file '{path}' {error}") from error
    return Read(model, _speeds(root), doubts)


def _prepared(root: Element, folder: Path) -> Iterator[str]:
    """Make a URDF one that MuJoCo reads whole: all links, shapes that are only seen too, no mesh that is missing."""
    for old in root.findall("mujoco"):
        root.remove(old)
    told = ElementTree.SubElement(ElementTree.SubElement(root, "mujoco"), "compiler")
    told.attrib |= {"strippath": "false", "discardvisual": "false", "fusestatic": "false", "balanceinertia": "true"}
    missing = []
    for link in root.findall("link"):
        for shape in [*link.findall("visual"), *link.findall("collision")]:
            mesh = shape.find("geometry/mesh")
            if mesh is None:
                continue
            name = mesh.get("filename", "")
            found = mesh_file(name, folder)
            if found is None or found.suffix.lower() not in MESHES:
                missing.append(name)
                link.remove(shape)
            else:
                mesh.set("filename", str(found.resolve()))
    for joint in root.findall("joint"):
        if joint.get("type") in ("floating", "planar"):  # the root gets a free joint
            joint.set("type", "fixed")
    yield from _told(missing)


def _without_files(spec: Any, folder: Path) -> Iterator[str]:
    """Take out what stands in files that are not there."""
    missing = []
    places = [folder / spec.meshdir, folder / spec.compiler.meshdir, folder]
    for mesh in list(spec.meshes):
        if mesh.file and not any((place / mesh.file).is_file() for place in places):
            missing.append(mesh.file)
            for geom in [geom for geom in spec.geoms if geom.meshname == mesh.name]:
                spec.delete(geom)
            spec.delete(mesh)
    if missing:
        spec.compiler.boundmass, spec.compiler.boundinertia = LIGHTEST
    yield from _told(missing)


def _told(missing: list[str]) -> Iterator[str]:
    if missing:
        names = ", ".join(dict.fromkeys(Path(name).name for name in missing[:3]))
        more = " and others" if len(set(missing)) > 3 else ""
        yield (
            f"{len(set(missing))} mesh files are missing or of a kind that MuJoCo does not read ({names}{more}); "
            "the robot moves without them, and shapes and masses that they give are left out"
        )


def _alone(spec: Any, mujoco: Any) -> Iterator[str]:
    """Leave the robot alone in its world, with a free joint at its root."""
    trees = sorted(spec.worldbody.bodies, key=lambda body: len(body.find_all("body")), reverse=True)
    if not trees:
        raise UserError("has no bodies; give a humanoid robot")
    for thing in [*trees[1:], *spec.worldbody.geoms, *spec.keys]:
        spec.delete(thing)
    if trees[1:]:
        yield f"'{trees[0].name}' is taken for the robot; what stands beside it in the file is left out"
    root, free = trees[0], mujoco.mjtJoint.mjJNT_FREE
    if not root.joints or root.joints[0].type != free:
        if root.joints:
            yield f"the joints of '{root.name}' against the world are replaced by a free joint"
        for joint in list(root.joints):
            spec.delete(joint)
        root.add_freejoint(name="root_free")
    for joint in spec.joints:
        if joint.type == mujoco.mjtJoint.mjJNT_BALL:
            raise UserError(f"has the ball joint '{joint.name}'; make hinges of it, as robots have")
    masses = [body for body in spec.bodies[1:] if body.mass == 0 and not body.geoms]
    if masses and not spec.compiler.boundmass:
        spec.compiler.boundmass, spec.compiler.boundinertia = LIGHTEST


def _speeds(root: Element) -> dict[str, float]:
    """Speeds that a URDF states."""
    stated = {}
    for joint in root.findall("joint"):
        limit = joint.find("limit")
        try:
            speed = float("nan" if limit is None else limit.get("velocity", "nan"))
        except ValueError:
            continue
        if speed > 0:
            stated[joint.get("name", "")] = speed
    return stated
