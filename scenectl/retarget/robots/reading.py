"""Robots' files: MJCF and URDF to MuJoCo's models of one robot each, with a free joint at the root."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass, field
from importlib import import_module
from itertools import count
from pathlib import Path
from typing import Any
from xml.etree import ElementTree
from xml.etree.ElementTree import Element

import numpy as np

from scenes.body.urdf import mesh_file, mesh_of, xml_of
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
                meshes = dict[str, bytes]()
                doubts += _prepared(root, path.parent, meshes)
                spec = mujoco.MjSpec.from_string(ElementTree.tostring(root, encoding="unicode"), assets=meshes)
            else:
                spec = mujoco.MjSpec.from_file(str(path))
                doubts += _without_files(spec, path.parent)
            doubts += _alone(spec, mujoco)
            model = _compiled(spec, mujoco)
        except (ValueError, RuntimeError, mujoco.FatalError) as error:
            if isinstance(error, UserError):
                raise
            raise UserError(f"cannot be read by MuJoCo ({' '.join(str(error).split())}); repair it") from error
    except UserError as error:
        raise UserError(f"robot file '{path}' {error}") from error
    return Read(model, _speeds(root), doubts)


def _compiled(spec: Any, mujoco: Any) -> Any:
    """Compile a model; meshes that enclose nothing (flat, or turned inside out) weigh as shells."""
    for _ in range(len(spec.meshes)):
        try:
            return spec.compile()
        except ValueError as error:
            told = re.search(r"inertia to shell|orientation.*Element name '(.*?)'", " ".join(str(error).split()))
            name = re.search(r"Element name '(.*?)'", str(error))
            mesh = None if not told or not name else spec.mesh(name[1])
            if mesh is None or mesh.inertia == mujoco.mjtMeshInertia.mjMESH_INERTIA_SHELL:
                raise
            mesh.inertia = mujoco.mjtMeshInertia.mjMESH_INERTIA_SHELL
    return spec.compile()


def _prepared(root: Element, folder: Path, meshes: dict[str, bytes]) -> Iterator[str]:
    """Make a URDF one that MuJoCo reads whole: all links, shapes that are only seen too, no mesh that is missing.

    Meshes of kinds that only we read go to `meshes`, by the names that the shapes get.
    """
    if any("${" in value for element in root.iter() for value in element.attrib.values()):
        raise UserError("holds expressions of xacro (${...}); run xacro on it and give what that writes")
    for old in root.findall("mujoco"):
        root.remove(old)
    told = ElementTree.SubElement(ElementTree.SubElement(root, "mujoco"), "compiler")
    told.attrib |= {"strippath": "false", "discardvisual": "false", "fusestatic": "false", "balanceinertia": "true"}
    for origin in root.iter("origin"):
        origin.attrib |= {key: value.replace(",", " ") for key, value in origin.attrib.items()}
    missing = []
    for link in root.findall("link"):
        _weighed(link)
        for shape in [*link.findall("visual"), *link.findall("collision")]:
            shape.attrib.pop("name", None)  # of no use, and often the same twice
            mesh = shape.find("geometry/mesh")
            if mesh is not None and not _given(mesh, folder, meshes):
                missing.append(mesh.get("filename", ""))
                link.remove(shape)
            elif mesh is None and not _large(shape):
                link.remove(shape)
    for joint in root.findall("joint"):
        if joint.get("type") in ("floating", "planar"):  # the root gets a free joint
            joint.set("type", "fixed")
    yield from _told(missing)


def _large(shape: Element) -> bool:
    """Whether a box, sphere, cylinder or capsule has a size; some files keep places with spheres of none."""
    sizes = [value for element in shape.iterfind("geometry/*") for value in element.attrib.values()]
    try:
        return all(float(word) > 0 for value in sizes for word in value.split())
    except ValueError:
        return True  # MuJoCo says what is wrong


def _weighed(link: Element) -> None:
    """Give a link whose inertia no body can have that of a ball of the same trace."""
    inertia = link.find("inertial/inertia")
    if inertia is None:
        return
    try:
        xx, yy, zz, xy, xz, yz = (float(inertia.get(key, "0")) for key in ("ixx", "iyy", "izz", "ixy", "ixz", "iyz"))
    except ValueError:
        return  # MuJoCo says what is wrong
    if np.linalg.eigvalsh([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])[0] <= 0:
        each = repr(max((xx + yy + zz) / 3, LIGHTEST[1]))
        inertia.attrib |= dict.fromkeys(("ixx", "iyy", "izz"), each) | dict.fromkeys(("ixy", "ixz", "iyz"), "0")


def _given(mesh: Element, folder: Path, meshes: dict[str, bytes]) -> bool:
    """Whether MuJoCo can have a mesh: where its file is, or read by us where MuJoCo reads no such."""
    found = mesh_file(mesh.get("filename", ""), folder)
    if found is None:
        return False
    if found.suffix.lower() in MESHES and not _is_text(found):
        mesh.set("filename", str(found.resolve()))
        return True
    try:
        vertices, faces = mesh_of(mesh, "a link", folder)
    except UserError:
        return False
    name = f"{found.stem}-{len(meshes)}.obj"
    lines = [f"v {x:.9g} {y:.9g} {z:.9g}\n" for x, y, z in vertices.tolist()]
    lines += [f"f {a} {b} {c}\n" for a, b, c in (faces + 1).tolist()]
    meshes[name] = "".join(lines).encode()
    mesh.attrib = {"filename": name}
    return True


def _is_text(path: Path) -> bool:
    """Whether an STL is written as text, which MuJoCo does not read."""
    if path.suffix.lower() != ".stl":
        return False
    with path.open("rb") as file:
        head = file.read(84)
    return len(head) < 84 or path.stat().st_size != 84 + 50 * int.from_bytes(head[80:], "little")


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
    for thing in [*trees[1:], *spec.worldbody.geoms, *spec.keys, *spec.pairs, *spec.sensors, *spec.skins]:
        spec.delete(thing)  # of pairs, sensors and skins some name what is gone, and kinematics needs none
    if trees[1:]:
        yield f"'{trees[0].name}' is taken for the robot; what stands beside it in the file is left out"
    root, free = trees[0], mujoco.mjtJoint.mjJNT_FREE
    if not root.joints or root.joints[0].type != free:
        if root.joints:
            yield f"the joints of '{root.name}' against the world are replaced by a free joint"
        for joint in list(root.joints):
            spec.delete(joint)
        root.add_freejoint(name="root_free")
    for kind, things in (("body", spec.bodies), ("joint", spec.joints)):
        taken = {thing.name for thing in things}
        for number, thing in enumerate(things):
            if not thing.name:
                thing.name = next(name for n in count(number) if (name := f"{kind}_{n}") not in taken)
                taken.add(thing.name)
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
