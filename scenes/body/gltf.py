"""Characters from glTF files: triangles bound to a skeleton.

`scenes.mesh.gltf` reads the file; here is what concerns skins, and the humanoid bones that VRM files name. Section
numbers are those of the Khronos glTF 2.0 specification.
"""

from __future__ import annotations

from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from scenes.body.rig import Part, Rig
from scenes.errors import UserError
from scenes.files import readable
from scenes.mesh.content import distinct, placed, told
from scenes.mesh.gltf import Gltf, numbered
from scenes.mesh.scale import LARGEST
from scenes.motion.frames import rigid, transform
from scenes.numbers import MOST

_VRM = {
    "hips": "pelvis", "neck": "neck", "head": "head",
    **{
        f"{side}{theirs}": f"{side}_{ours}"
        for side in ("left", "right")
        for theirs, ours in (
            ("UpperLeg", "hip"), ("LowerLeg", "knee"), ("Foot", "ankle"), ("Toes", "foot"), ("Shoulder", "collar"),
            ("UpperArm", "shoulder"), ("LowerArm", "elbow"), ("Hand", "wrist"),
        )
    },
}  # fmt: skip
"""Humanoid bones of VRM 0 and 1 that are joints of ours. Spines are told by the tree (`Rig`): they may be 1 to 3."""


def read_rig(path: str | Path) -> Rig:
    """Read a character with a skeleton from a GLB, glTF or VRM file, in metres with y up as its standard says.

    Every triangle belongs to the joint that has the most weight on its corners, and moves with it as a rigid body: in
    the joint's frame it lies where the file bound it. Several skins are read together where they share joints (a body
    and its clothes). Meshes without a skin move with the joint that they hang on; others are left out. The pose at rest
    is that of the file's nodes; a scale on them is applied to the triangles and taken out of the frames. Humanoid bones
    that a VRM extension names are joints, and known as ours.

    Raises:
        UserError: no such file; one that `scenes.mesh.gltf.read_gltf` refuses; no skin, or several without a common
            joint; no triangles; nodes in a ring; weights that are missing, NaN or name no joint.
    """
    path = readable(path, "character file")
    with told(f"character file '{path}'", "glTF"):
        return rig_of(Skinned.read(path))


def rig_of(file: Skinned) -> Rig:
    """The rig of a file that is already in memory: link k is its node ``file.joints[k]``."""
    path, joints = file.path, file.joints
    names = tuple(distinct(str(file.nodes[node].get("name") or f"node {node}") for node in joints))
    place = {node: joint for joint, node in enumerate(joints)}
    parents = tuple(place.get(file.above(node, place), -1) for node in joints)
    if not (np.abs(file.world[joints]) <= MOST).all():
        raise ValueError("a joint's transform is not finite, or huge")
    frames = np.stack([rigid(file.world[node]) for node in joints])
    pieces: dict[int, list[np.ndarray]] = {}
    for node in sorted(file.drawn):
        for joint, triangles in file.triangles(node, place):
            pieces.setdefault(joint, []).append(transform(np.linalg.inv(frames[joint]), triangles))
    if not pieces:
        raise UserError("has no triangles bound to its skeleton; bind a mesh to the joints and export it again")
    parts = []
    for joint in sorted(pieces):
        corners = np.concatenate(pieces[joint])
        if not (np.abs(corners) <= LARGEST).all():
            raise ValueError(f"coordinates are NaN, infinite or over {LARGEST:g} m from their joint")
        vertices, faces = np.unique(corners.reshape(-1, 3), axis=0, return_inverse=True)
        parts.append(Part(names[joint], frames[joint], vertices, faces.reshape(-1, 3)))
    known = {joint: names[place[node]] for joint, node in file.humanoid.items()}
    return Rig(path.stem, str(path), names, parents, frames, tuple(parts), known=known)


class Skinned(Gltf):
    """A file whose meshes are bound to joints (section 3.7.3)."""

    @cached_property
    def joints(self) -> list[int]:
        """Nodes that are joints of a skin, parents before children."""
        skins = self.facts.get("skins", [])
        if not skins:
            raise UserError("has no skin, so nothing says which joint moves which triangle; export it with its rig")
        groups = [{numbered(node, self.nodes, "joint") for node in skin["joints"]} for skin in skins]
        together = groups[0] | set(self.humanoid.values())
        for _ in groups:  # clothes may share joints with other clothes only
            together = together.union(*(group for group in groups if self._hangs(group, together)))
        if apart := sum(not self._hangs(group, together) for group in groups):
            raise UserError(
                f"has {len(groups)} skins, {apart} of them without a joint in common with the first; "
                "export one character a file"
            )
        return [node for node in self.order if node in together]

    @cached_property
    def humanoid(self) -> dict[str, int]:
        """Nodes of the joints of ours that a VRM extension names (VRM 1.0 `VRMC_vrm`, else VRM 0.x `VRM`)."""
        extensions = self.facts.get("extensions", {})
        bones: Any = next(
            (extensions[key]["humanoid"]["humanBones"] for key in ("VRMC_vrm", "VRM") if key in extensions), {}
        )
        named = bones.items() if isinstance(bones, dict) else [(bone["bone"], bone) for bone in bones]
        return {_VRM[name]: numbered(bone["node"], self.nodes, "node") for name, bone in named if name in _VRM}

    def _hangs(self, group: set[int], on: set[int]) -> bool:
        """Whether some joints are among others or hang on them, as those of hair do on a head."""
        among = dict.fromkeys(on, 0)
        return any(joint in on or self.above(joint, among) >= 0 for joint in group)

    def triangles(self, node: int, place: dict[int, int]) -> list[tuple[int, np.ndarray]]:
        """World triangles ``[F, 3, 3]`` of a node's mesh for each joint that owns some."""
        skin = self.nodes[node].get("skin")
        holder = node if node in place else self.above(node, place)
        found = []
        for primitive in self.primitives(node):
            vertices, faces = self.shape(primitive, node)
            if not len(faces):
                continue
            if skin is not None:
                found += self._bound(self.facts["skins"][skin], primitive, vertices, faces, place)
            elif holder >= 0:
                copies = [placed(frame, vertices, faces) for frame in self.places(node)]
                found += [(place[holder], corners[triangles]) for corners, triangles in copies]
        return found

    def above(self, node: int, among: dict[int, int]) -> int:
        """The nearest node above this one that is one of some; -1 where there is none."""
        node = self.parents[node]
        while node >= 0 and node not in among:
            node = self.parents[node]
        return node

    def _bound(
        self, skin: dict[str, Any], primitive: dict[str, Any], vertices: np.ndarray, faces: np.ndarray, place: Any
    ) -> list[tuple[int, np.ndarray]]:
        """World triangles of one skinned primitive, each carried rigidly by its joint."""
        own = skin["joints"]
        slots, weights = self._weights(primitive, len(own), len(vertices))
        corners, shares = slots[faces].reshape(len(faces), -1), weights[faces].reshape(len(faces), -1)
        # for every slot, the weight that its joint has on all three corners
        sums = np.stack([(shares * (corners == slot[:, None])).sum(axis=1) for slot in corners.T], axis=1)
        owner = corners[np.arange(len(faces)), sums.argmax(axis=1)]
        bind = np.tile(np.eye(4), (len(own), 1, 1))
        if "inverseBindMatrices" in skin:
            bind = self.accessor(skin["inverseBindMatrices"]).reshape(-1, 4, 4).transpose(0, 2, 1).astype(np.float64)
            if len(bind) < len(own):
                raise ValueError(f"a skin has {len(own)} joints and {len(bind)} inverse bind matrices")
        found = []
        for j in np.unique(owner):
            corners, triangles = placed(self.world[own[j]] @ bind[j], vertices, faces[owner == j])
            found.append((place[own[j]], corners[triangles]))
        return found

    def _weights(self, primitive: dict[str, Any], joints: int, vertices: int) -> tuple[np.ndarray, np.ndarray]:
        """Joints ``[V, 4 n]`` (indices into the skin) and weights of every vertex."""
        attributes = primitive["attributes"]
        sets = sorted(name.removeprefix("JOINTS_") for name in attributes if name.startswith("JOINTS_"))
        if not sets or any(f"WEIGHTS_{n}" not in attributes for n in sets):
            raise ValueError("a skinned mesh has no weights")
        slots = np.concatenate([self.attribute(primitive, f"JOINTS_{n}") for n in sets], axis=1).astype(np.int64)
        weights = np.concatenate([self.attribute(primitive, f"WEIGHTS_{n}") for n in sets], axis=1).astype(np.float64)
        if len(slots) != vertices or len(weights) != vertices:
            raise ValueError(f"{vertices} vertices have {len(slots)} joints and {len(weights)} weights")
        if not np.isfinite(weights).all() or (weights < 0).any() or (weights.sum(axis=1) <= 0).any():
            raise ValueError("weights are NaN, negative or all zero")
        if (slots[weights > 0] >= joints).any():
            raise ValueError(f"weights name joints beyond the {joints} of the skin")
        return np.where(weights > 0, slots, 0), weights
