"""Characters of the user's own as motions play them: nodes of a glTF file, and which of them are our 22 joints."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import torch
from jaxtyping import Float

from scenectl.data.characters import CHARACTERS, joints_of
from scenes.body.fit import placed, t_pose
from scenes.body.gltf import Skinned, rig_of
from scenes.body.rig import Rig
from scenes.errors import UserError
from scenes.files import readable
from scenes.mesh.content import told
from scenes.motion.frames import rotations
from scenes.motion.kinematics import orientations
from scenes.motion.motion import Motion
from scenes.motion.skeleton import HUMANML3D, Skeleton

_AT = HUMANML3D.index


@dataclass(frozen=True, eq=False)
class Character:
    """A skinned character, and how it stands in its file, which is taken for standing on level soles.

    Attributes:
        file: the file in memory.
        rig: its joints and triangles.
        joints: {joint of our 22: node}; spines and collars may be missing.
        place: world positions of the 22 joints at rest, ``[22, 3]`` metres (`scenes.body.fit.placed`).
        skeleton: its T-pose; the one of its fitted body.
    """

    file: Skinned
    rig: Rig
    joints: Mapping[str, int]
    place: Float[np.ndarray, "22 3"]
    skeleton: Skeleton

    @classmethod
    def load(cls, path: str | Path, stated: Mapping[str, str] | None = None) -> Character:
        """Read a character.

        Args:
            path: a GLB, glTF or VRM file.
            stated: {our joint: name of a joint of the file} for what its names don't tell.

        Raises:
            UserError: what `scenes.body.gltf.read_rig` refuses, another kind of file, joints that are not found.
        """
        path = readable(path, "character file")
        if path.suffix.lower() not in CHARACTERS:
            raise UserError(f"character file '{path}' ends with '{path.suffix}'; {', '.join(CHARACTERS)} are read")
        with told(f"character file '{path}'", "glTF"):
            file = Skinned.read(path)
            rig = rig_of(file)
        try:
            links = joints_of(rig, stated)
            place = placed(rig, links)
            skeleton = t_pose(rig, place)
        except UserError as error:
            raise UserError(f"character file '{path}': {error}") from error
        joints = {joint: file.joints[rig.index(link)] for joint, link in links.items()}
        found = cls(file, rig, joints, place, skeleton)
        if found.mover < 0:
            raise UserError(f"character file '{path}': its joints hang on no node together; join them under one")
        return found

    @cached_property
    def mover(self) -> int:
        """The node that carries all joints: the pelvis, or the nearest that it hangs on with the others; -1 if none."""
        ways = [self.way(node) for node in self.joints.values()]
        return next((node for node in self.way(self.joints["pelvis"]) if all(node in way for way in ways)), -1)

    def way(self, node: int) -> list[int]:
        """A node and all that it hangs on, up to the root."""
        way = [node]
        while (node := self.file.parents[node]) >= 0:
            way.append(node)
        return way

    def goes_with(self, node: int) -> list[int]:
        """A node and all that it goes with: what it hangs on, or as `loose` says."""
        way = [node]
        while (node := self.loose.get(node, self.file.parents[node])) >= 0:
            way.append(node)
        return way

    @cached_property
    def loose(self) -> dict[int, int]:
        """{node: what it goes with} of joints that do not hang on what they do in a body, as feet that hang on a root.

        They are moved to where they would be if they did.
        """
        found = {}
        for name, node in self.joints.items():
            above = HUMANML3D.parents[_AT(name)]
            while above >= 0 and HUMANML3D.names[above] not in self.joints:
                above = HUMANML3D.parents[above]
            if above >= 0 and (carrier := self.joints[HUMANML3D.names[above]]) not in self.way(node):
                found[node] = carrier
        return found

    @cached_property
    def turned(self) -> Float[np.ndarray, "22 3 3"]:
        """How its joints are turned at rest against its T-pose, in the world, by the rule that motions go by."""
        rest = Motion(torch.from_numpy(self.place)[None], skeleton=self.skeleton)
        turned: np.ndarray = orientations(rest)[0].numpy()
        return turned

    @cached_property
    def origins(self) -> Float[np.ndarray, "N 3"]:
        """World positions of all nodes at rest, metres."""
        origins: np.ndarray = self.file.world[:, :3, 3]
        return origins

    @cached_property
    def ankles(self) -> Float[np.ndarray, " 2"]:
        """How high (m) the left and the right ankle stand over the sole at rest, by the triangles of the feet."""
        heights = []
        for side in ("left", "right"):
            ankle = _AT(f"{side}_ankle")
            points = self.hanging_on(self.joints[f"{side}_ankle"])
            up = self.turned[ankle][:, 1]
            heights.append(float(((self.place[ankle] - points) @ up).max()))
        return np.array(heights)

    def hanging_on(self, node: int) -> Float[np.ndarray, "V 3"]:
        """Points of the surface that move with a node or with what hangs on it; of all of it where none do."""
        nodes = dict(zip(self.rig.links, self.file.joints, strict=True))
        found = [part.placed for part in self.rig.parts if node in self.goes_with(nodes[part.link])]
        return np.concatenate(found or [part.placed for part in self.rig.parts])


def apart(node: dict[str, Any]) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Translation ``[3]``, rotation ``[3, 3]`` and scale ``[3]`` of a node of a glTF file; shear is left out."""
    if "matrix" not in node:
        x, y, z, w = node.get("rotation", (0.0, 0.0, 0.0, 1.0))
        turn = rotations(np.array([w, x, y, z], dtype=np.float64))
        return np.array(node.get("translation", [0.0] * 3)), turn, np.array(node.get("scale", [1.0] * 3))
    matrix = np.array(node["matrix"], dtype=np.float64).reshape(4, 4).T
    turn = orthogonal(matrix[:3, :3])
    mirror = np.array([np.linalg.det(turn), 1.0, 1.0])
    scale = mirror * np.diag(turn.T @ matrix[:3, :3])
    return matrix[:3, 3], turn * mirror, scale


def orthogonal(matrix: np.ndarray) -> np.ndarray:
    """The orthogonal matrix nearest to a matrix ``[3, 3]``: a rotation, mirrored where the matrix mirrors."""
    u, _, v = np.linalg.svd(matrix)
    nearest: np.ndarray = u @ v
    return nearest
