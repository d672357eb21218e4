"""Two characters as GLB and VRM files, made by this script: smooth skins from capsules around other people's joints.

``python -m tests.scenectl.retarget.rigs FOLDER`` writes both.
"""

from __future__ import annotations

import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation
from skimage.measure import marching_cubes

from scenes.motion.skeleton import HUMANML3D
from tests.scenes.body.rigs import LIMBS, Gltf

MIXAMO = (
    "Hips", "LeftUpLeg", "RightUpLeg", "Spine", "LeftLeg", "RightLeg", "Spine1", "LeftFoot", "RightFoot", "Spine2",
    "LeftToeBase", "RightToeBase", "Neck", "LeftShoulder", "RightShoulder", "Head", "LeftArm", "RightArm",
    "LeftForeArm", "RightForeArm", "LeftHand", "RightHand",
)  # fmt: skip
"""Mixamo's names of our 22 joints."""
VRM = (
    "hips", "leftUpperLeg", "rightUpperLeg", "spine", "leftLowerLeg", "rightLowerLeg", "chest", "leftFoot", "rightFoot",
    "upperChest", "leftToes", "rightToes", "neck", "leftShoulder", "rightShoulder", "head", "leftUpperArm",
    "rightUpperArm", "leftLowerArm", "rightLowerArm", "leftHand", "rightHand",
)  # fmt: skip
"""VRM's names of our 22 joints."""
_STEP = 0.022  # metres between the nodes of the grid on which a skin is drawn


@dataclass(frozen=True)
class Person:
    """Proportions of somebody, against an adult of ours, and how they stand.

    Attributes:
        legs, arms, trunk, broad: lengths of those bones, and how broad hips and shoulders are.
        ankle: height (m) of the ankles over the soles.
        toe: height (m) of the toe joints over the soles.
        lean: by how much (rad) the arms hang.
        neck: by how much (rad) the neck leans forward.
        thick: radii of the limbs.
    """

    legs: float
    arms: float
    trunk: float
    broad: float
    ankle: float
    toe: float
    lean: float
    neck: float
    thick: float

    def joints(self) -> np.ndarray:
        """Places of our 22 joints, soles at height 0, ``[22, 3]`` metres."""
        place = np.zeros((22, 3))
        for parent, joint in HUMANML3D.bones:
            name, bone = HUMANML3D.names[joint], np.array(HUMANML3D.offsets[joint])
            side = np.sign(bone[0])
            if name.endswith(("knee", "ankle")):
                bone = bone * self.legs
            elif name.endswith("foot"):
                bone = bone * self.legs * [1, 0, 1] - [0, self.ankle - self.toe, 0]
            elif name.endswith(("elbow", "wrist")):
                bone = self.arms * np.linalg.norm(bone) * np.array([side * np.cos(self.lean), -np.sin(self.lean), 0.0])
            elif name == "head":
                bone = self.trunk * np.linalg.norm(bone) * np.array([0.0, np.cos(self.neck), np.sin(self.neck)])
            else:
                bone = bone * [self.broad, self.trunk, 1.0]
            place[joint] = place[parent] + bone
        low = place[HUMANML3D.indices(["left_ankle", "right_ankle"]), 1].min()
        return place + np.array([0.0, self.ankle - low, 0.0])


SMALL = Person(legs=0.75, arms=0.84, trunk=0.88, broad=0.85, ankle=0.09, toe=0.025, lean=0.0, neck=0.2, thick=0.85)
"""1.5 m tall, in a T-pose."""
TALL = Person(legs=1.14, arms=1.08, trunk=1.06, broad=1.12, ankle=0.075, toe=0.03, lean=0.8, neck=0.35, thick=1.1)
"""1.95 m tall, in an A-pose."""


def small() -> Gltf:
    """Mixamo's names with its prefix, ends of limbs and a finger; 1.5 m, T-pose, nothing turned at rest."""
    return hero(SMALL, [f"mixamorig:{name}" for name in MIXAMO], extra=_EXTRA)


def tall() -> Gltf:
    """Names that say nothing and VRM's extension; 1.95 m, A-pose, axes turned anyhow, in centimetres, z up inside."""
    names = [f"bone.{j:03}" for j in range(22)]
    file = hero(TALL, names, axes=np.random.default_rng(7), scale=0.01, z_up=True)
    bones = {name: {"node": 2 + j} for j, name in enumerate(VRM)}
    meta = {"name": "tall", "version": "1", "authors": ["scenectl"], "licenseUrl": "https://vrm.dev/licenses/1.0/"}
    file.facts["extensionsUsed"] = ["VRMC_vrm"]
    file.facts["extensions"] = {"VRMC_vrm": {"specVersion": "1.0", "meta": meta, "humanoid": {"humanBones": bones}}}
    return file


_EXTRA = {
    "mixamorig:LeftToe_End": (10, (0.0, -0.02, 0.06)),
    "mixamorig:LeftHandIndex1": (20, (0.07, 0.0, 0.02)),
    "mixamorig:HeadTop_End": (15, (0.0, 0.2, 0.0)),
}


def hero(
    person: Person,
    names: Sequence[str],
    axes: np.random.Generator | None = None,
    scale: float = 1.0,
    z_up: bool = False,
    extra: Mapping[str, tuple[int, tuple[float, float, float]]] | None = None,
) -> Gltf:
    """A character: node 0 stands on the ground, node 1 scales, and joints follow, our 22 and `extra` ones.

    Args:
        person: who stands so at rest.
        names: of the joints.
        axes: draws how each joint's own axes lie; None for none turned.
        scale: metres of a unit inside.
        z_up: node 0 turns from a frame with z up.
        extra: {name: (which of ours it hangs on, offset (m))}.
    """
    place, parents, names = person.joints(), [*HUMANML3D.parents], [*names]
    for name, (parent, offset) in (extra or {}).items():
        place, parents = np.concatenate([place, [place[parent] + offset]]), [*parents, parent]
        names.append(name)
    root, inner = np.eye(4), np.diag([scale, scale, scale, 1.0])
    if z_up:
        root[:3, :3] = Rotation.from_euler("x", -90, degrees=True).as_matrix()
    world = np.tile(np.eye(4), (len(place), 1, 1))
    world[:, :3, :3] = scale * (np.eye(3) if axes is None else Rotation.random(len(place), axes).as_matrix())
    world[:, :3, 3] = place
    file = Gltf()
    nodes = file.facts["nodes"]
    nodes += [
        {"name": "root", "matrix": root.T.ravel().tolist(), "children": [1]},
        {"name": "armature", "scale": [scale] * 3, "children": [2]},
    ]
    for joint, parent in enumerate(parents):
        local = np.linalg.inv(root @ inner if parent < 0 else world[parent]) @ world[joint]
        size = np.linalg.norm(local[:3, 0])
        turn = Rotation.from_matrix(local[:3, :3] / size).as_quat()
        nodes.append({"name": names[joint], "translation": local[:3, 3].tolist(), "rotation": turn.tolist()})
        if parent < 0:
            nodes[-1]["scale"] = [float(size)] * 3
        else:
            nodes[parent + 2].setdefault("children", []).append(joint + 2)
    vertices, faces, slots, weights = _skin(person, place[:22])
    inside = vertices @ root[:3, :3] / scale  # bound in the armature's frame and unit
    bind = np.linalg.inv(world) @ root @ inner
    inverse = file.add(bind.transpose(0, 2, 1).reshape(-1, 16))
    file.facts["skins"].append({"joints": list(range(2, 2 + len(place))), "inverseBindMatrices": inverse})
    nodes.append({"name": "skin", "mesh": file.mesh(inside, faces, slots, weights), "skin": 0})
    file.facts["accessors"][file.facts["meshes"][0]["primitives"][0]["attributes"]["POSITION"]] |= {
        "min": inside.astype(np.float32).min(axis=0).tolist(), "max": inside.astype(np.float32).max(axis=0).tolist(),
    }  # fmt: skip
    file.facts["scenes"][0]["nodes"].append(len(nodes) - 1)
    return file


def _skin(person: Person, place: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Vertices, triangles, and four joints and weights of each vertex: capsules that flow into each other."""
    starts, ends, radii, owners = _capsules(person, place)
    low, high = np.minimum(starts, ends).min(0) - 0.2, np.maximum(starts, ends).max(0) + 0.2
    low[1] = -3.5 * _STEP
    grid = np.stack(np.meshgrid(*(np.arange(a, b, _STEP) for a, b in zip(low, high, strict=True)), indexing="ij"), -1)
    away = _away(grid.reshape(-1, 3), starts, ends, radii)
    near = -0.015 * np.log(np.exp(-away / 0.015).sum(-1))
    near = np.maximum(near, -grid.reshape(-1, 3)[:, 1])  # soles are flat
    vertices, faces, _, _ = marching_cubes(near.reshape(grid.shape[:3]), 0.0, spacing=(_STEP,) * 3)
    vertices = vertices + low
    away = _away(vertices, starts, ends, radii)
    shares = np.zeros((len(vertices), 22))
    np.add.at(shares.T, owners, np.exp(-(away - away.min(-1, keepdims=True)) / 0.02).T)
    slots = np.argsort(-shares, axis=1)[:, :4]
    weights = np.take_along_axis(shares, slots, axis=1)
    return vertices, faces[:, ::-1], slots, weights / weights.sum(axis=1, keepdims=True)


def _capsules(person: Person, place: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Starts, ends (m), radii and joints of the limbs, heads, hands, heels and toes among them."""
    rows: list[tuple[Any, Any, float, int]] = []
    for parent, joint in HUMANML3D.bones:
        radius = LIMBS[HUMANML3D.names[joint].removeprefix("left_").removeprefix("right_")]
        rows.append((place[parent], place[joint], 0.7 * person.thick * radius, parent))
    rows.append((place[15] + [0, 0.06, 0.02], place[15] + [0, 0.1, 0.02], 0.09, 15))
    for wrist, elbow in ((20, 18), (21, 19)):
        along = place[wrist] - place[elbow]
        rows.append((place[wrist], place[wrist] + 0.1 * along / np.linalg.norm(along), 0.03, wrist))
    for ankle, foot in ((7, 10), (8, 11)):
        heel = place[ankle] * [1, 0, 1] + [0, 0.03, -0.04]
        ball = place[foot] * [1, 0, 1] + [0, 0.03, 0]
        rows += [
            (heel, ball - np.array([0.0, 0.0, 0.04]), 0.04, ankle),
            (place[ankle], heel, 0.04, ankle),
            (ball, [*ball[:2], ball[2] + 0.04], 0.035, foot),
        ]
    starts, ends, radii, owners = zip(*rows, strict=True)
    return np.array(starts), np.array(ends), np.array(radii), np.array(owners)


def _away(points: np.ndarray, starts: np.ndarray, ends: np.ndarray, radii: np.ndarray) -> np.ndarray:
    """Distance (m) of points to capsules, ``[n, c]``."""
    along = ends - starts
    share = ((points[:, None] - starts) * along).sum(-1) / np.maximum((along**2).sum(-1), 1e-12)
    return np.linalg.norm(points[:, None] - starts - share.clip(0, 1)[..., None] * along, axis=-1) - radii


if __name__ == "__main__":
    folder = Path(sys.argv[1])
    small().save(folder / "small.glb")
    tall().save(folder / "tall.vrm")
