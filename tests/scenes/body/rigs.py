"""Small characters as GLB files and robots as URDF files, written by hand so that the tests know every number."""

from __future__ import annotations

import json
import math
import struct
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import trimesh

from scenes.mesh.primitives import Capsule
from scenes.motion.skeleton import HUMANML3D

KINDS = {"<f4": 5126, "<i1": 5120, "<u1": 5121, "<i2": 5122, "<u2": 5123, "<u4": 5125}
WIDTHS = {1: "SCALAR", 3: "VEC3", 4: "VEC4", 16: "MAT4"}


class Gltf:
    """A glTF file that is being put together."""

    def __init__(self) -> None:
        self.binary = b""
        self.facts: dict[str, Any] = {
            "asset": {"version": "2.0"}, "scene": 0, "scenes": [{"nodes": [0]}], "nodes": [], "accessors": [],
            "bufferViews": [], "meshes": [], "skins": [],
        }  # fmt: skip

    def add(self, rows: np.ndarray, kind: str = "<f4", **extra: Any) -> int:
        """Store rows ``[n, width]``; returns the accessor."""
        rows = np.asarray(rows)
        rows = rows.reshape(len(rows), -1).astype(kind)
        view = {"buffer": 0, "byteOffset": len(self.binary), "byteLength": rows.nbytes}
        self.binary += rows.tobytes() + b"\0" * (-rows.nbytes % 4)
        self.facts["bufferViews"].append(view)
        self.facts["accessors"].append(
            {
                "bufferView": len(self.facts["bufferViews"]) - 1,
                "componentType": KINDS[kind],
                "count": len(rows),
                "type": WIDTHS[rows.shape[1]],
                **extra,
            }
        )
        return len(self.facts["accessors"]) - 1

    def mesh(self, vertices: np.ndarray, faces: np.ndarray, joints: np.ndarray, weights: np.ndarray) -> int:
        """A skinned mesh; joints and weights ``[V, 4]``."""
        attributes = {
            "POSITION": self.add(vertices),
            "JOINTS_0": self.add(joints, "<u1"),
            "WEIGHTS_0": self.add(weights),
        }
        primitive = {"attributes": attributes, "indices": self.add(np.asarray(faces).reshape(-1, 1), "<u4")}
        self.facts["meshes"].append({"primitives": [primitive]})
        return len(self.facts["meshes"]) - 1

    def bytes(self) -> bytes:
        facts = {"buffers": [{"byteLength": len(self.binary)}], **self.facts}
        text = json.dumps(facts).encode()
        text += b" " * (-len(text) % 4)
        chunks = struct.pack("<II", len(text), 0x4E4F534A) + text
        chunks += struct.pack("<II", len(self.binary), 0x004E4942) + self.binary
        return struct.pack("<4sII", b"glTF", 2, 12 + len(chunks)) + chunks

    def save(self, path: Path) -> Path:
        path.write_bytes(self.bytes())
        return path


def character(
    names: Sequence[str], parents: Sequence[int], offsets: np.ndarray, meshes: dict[int, Any], scale: float = 1.0
) -> Gltf:
    """A character whose node 0 scales and whose joints stand at world `offsets` from each other, without turns.

    `meshes` holds world triangles for joints, wholly bound to them.
    """
    file = Gltf()
    nodes = file.facts["nodes"]
    nodes.append({"name": "armature", "scale": [scale] * 3, "children": [1]})
    for name, offset in zip(names, np.asarray(offsets) / scale, strict=True):
        nodes.append({"name": name, "translation": list(map(float, offset))})
    world = np.zeros((len(names), 3))
    for j, p in enumerate(parents):
        world[j] = offsets[j] + (world[p] if p >= 0 else 0)
        if p >= 0:
            nodes[p + 1].setdefault("children", []).append(j + 1)
    bind = np.tile(np.eye(4), (len(names), 1, 1))
    bind[:, :3, :3] /= scale
    bind[:, :3, 3] = -world / scale
    vertices = np.concatenate([mesh.vertices for mesh in meshes.values()])
    starts = np.cumsum([0, *(len(mesh.vertices) for mesh in meshes.values())])
    faces = np.concatenate([mesh.faces + s for mesh, s in zip(meshes.values(), starts, strict=False)])
    joints = np.zeros((len(vertices), 4))
    joints[:, 0] = np.repeat(list(meshes), [len(mesh.vertices) for mesh in meshes.values()])
    weights = np.zeros((len(vertices), 4))
    weights[:, 0] = 1
    ibm = file.add(bind.transpose(0, 2, 1).reshape(-1, 16))
    file.facts["skins"].append({"joints": list(range(1, len(names) + 1)), "inverseBindMatrices": ibm})
    nodes.append({"name": "skin", "mesh": file.mesh(vertices, faces, joints, weights), "skin": 0})
    file.facts["scenes"][0]["nodes"].append(len(nodes) - 1)
    return file


def arm(scale: float = 1.0) -> Gltf:
    """Two bones along x, a capsule around each."""
    meshes = {
        0: Capsule((0.0, 0.0, 0.0), (0.3, 0.0, 0.0), 0.06).mesh(),
        1: Capsule((0.3, 0.0, 0.0), (0.55, 0.0, 0.0), 0.04).mesh(),
    }
    return character(["upper", "lower"], [-1, 0], np.array([[0.0, 0, 0], [0.3, 0, 0]]), meshes, scale)


LIMBS = {
    "hip": 0.1, "spine1": 0.13, "knee": 0.075, "spine2": 0.13, "ankle": 0.05, "spine3": 0.13, "foot": 0.024,
    "neck": 0.12, "collar": 0.08, "head": 0.05, "shoulder": 0.07, "elbow": 0.05, "wrist": 0.04,
}  # fmt: skip


def standing() -> np.ndarray:
    """Joints of a person in the T-pose, soles at height 0, ``[22, 3]`` metres."""
    joints = np.zeros((22, 3))
    for p, j in HUMANML3D.bones:
        joints[j] = joints[p] + np.array(HUMANML3D.offsets[j])
    joints[HUMANML3D.index("head")] = joints[HUMANML3D.index("neck")] + [0.0, 0.1, 0.02]
    for side, sign in (("left", 1), ("right", -1)):  # the feet point forward and down, as feet do
        ankle, foot = HUMANML3D.index(f"{side}_ankle"), HUMANML3D.index(f"{side}_foot")
        joints[foot] = joints[ankle] + [0.02 * sign, -math.hypot(0.02, 0.13) * 0.33 / 0.944, 0.13]
    return joints - [0.0, joints[:, 1].min() - 0.025, 0.0]


def other_person(legs: float = 0.8, arms: float = 0.9, trunk: float = 0.75, lean: float = 0.9) -> np.ndarray:
    """Joints of somebody of other proportions, who rests with arms that hang by so much (rad), as `standing` gives."""
    place, before = np.zeros((22, 3)), standing()
    for p, j in HUMANML3D.bones:
        name = HUMANML3D.names[j]
        arm = name.endswith(("elbow", "wrist"))
        size = legs if name.endswith(("knee", "ankle", "foot")) else arms if arm else trunk
        bone = size * (before[j] - before[p])
        if arm:
            length = float(np.linalg.norm(bone))
            bone = length * np.array([math.copysign(math.cos(lean), bone[0]), -math.sin(lean), 0.0])
        place[j] = place[p] + bone
    return place - [0.0, place[:, 1].min() - 0.025, 0.0]


def humanoid(names: Sequence[str] = HUMANML3D.names, place: np.ndarray | None = None) -> Gltf:
    """A person of closed cylinders around the bones, a ball for a head and boxes for hands and toes."""
    place = standing() if place is None else place
    solids: dict[int, list[Any]] = {}
    for p, j in HUMANML3D.bones:
        radius = LIMBS[HUMANML3D.names[j].removeprefix("left_").removeprefix("right_")]
        solid = trimesh.creation.cylinder(radius=radius, segment=[place[p], place[j]], sections=24)
        solids.setdefault(p, []).append(solid)
    head = trimesh.creation.icosphere(subdivisions=2, radius=0.1)
    solids[15] = [head.apply_translation(place[15] + [0.0, 0.09, 0.0])]
    for wrist in (20, 21):
        hand = trimesh.creation.box(extents=[0.03, 0.18, 0.08])
        solids[wrist] = [hand.apply_translation(place[wrist] + [0.0, -0.09, 0.0])]
    for foot in (10, 11):
        toes = trimesh.creation.box(extents=[0.08, 0.04, 0.08])
        solids[foot] = [toes.apply_translation(place[foot] + [0.0, -0.005, 0.04])]
    meshes = {j: trimesh.util.concatenate(some) for j, some in solids.items()}
    offsets = np.array([place[j] - (place[p] if p >= 0 else 0) for j, p in enumerate(HUMANML3D.parents)])
    return character(list(names), HUMANML3D.parents, offsets, meshes)


ROBOT = """<?xml version="1.0"?>
<robot name="lamp">
  <material name="grey"><color rgba="0.5 0.5 0.5 1"/></material>
  <link name="base">
    <visual><geometry><sphere radius="9"/></geometry></visual>
    <collision><origin xyz="0 0 0.05"/><geometry><cylinder radius="0.15" length="0.1"/></geometry></collision>
  </link>
  <link name="arm">
    <collision><origin xyz="0 0 0.2"/><geometry><box size="0.06 0.08 0.4"/></geometry></collision>
  </link>
  <link name="forearm">
    <visual>
      <origin xyz="0.1 0 0" rpy="0 1.5707963267948966 0"/>
      <geometry><mesh filename="package://lamp_description/meshes/rod.stl" scale="0.001 0.001 0.001"/></geometry>
    </visual>
  </link>
  <link name="bulb"><collision><geometry><sphere radius="0.05"/></geometry></collision></link>
  <link name="tip"/>
  <joint name="j3" type="fixed"><parent link="bulb"/><child link="tip"/></joint>
  <joint name="j0" type="revolute">
    <parent link="base"/><child link="arm"/><origin xyz="0 0 0.1" rpy="0 0 0"/><axis xyz="0 0 1"/>
  </joint>
  <joint name="j1" type="revolute">
    <parent link="arm"/><child link="forearm"/><origin xyz="0 0 0.4" rpy="0 0 0.5"/><axis xyz="0 1 0"/>
  </joint>
  <joint name="j2" type="fixed"><parent link="forearm"/><child link="bulb"/><origin xyz="0.3 0 0"/></joint>
</robot>
"""


def robot(folder: Path, text: str = ROBOT) -> Path:
    """A lamp of a cylinder, a box, a rod from a mesh file in millimetres and a ball."""
    rod = Capsule((0.0, 0.0, -80.0), (0.0, 0.0, 80.0), 20.0).mesh()
    (folder / "meshes").mkdir(exist_ok=True)
    trimesh.Trimesh(rod.vertices, rod.faces, process=False).export(folder / "meshes" / "rod.stl")
    path = folder / "lamp.urdf"
    path.write_text(text, encoding="utf-8")
    return path
