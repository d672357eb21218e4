"""The mannequin that plays motions in files for other tools: a smooth closed skin on HumanML3D's joints.

`make` makes it from capsules and writes the file beside this one.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path

import numpy as np
from jaxtyping import Float, Int

from scenectl.export.animation import Animation
from scenes.files import read_arrays
from scenes.motion.bones import rest_pose
from scenes.motion.skeleton import HUMANML3D, Skeleton, size_of

FILE = Path(__file__).with_name("mannequin.npz")
"""Where it lies."""
COLOUR = (196, 178, 158)
"""sRGB."""
_STIFF = 0.05
"""Share of a joint's bones, squared, below which a direction is not stretched by them: they say nothing of it."""


@dataclass(frozen=True, eq=False)
class Mannequin:
    """A closed skin and what carries it.

    Attributes:
        skeleton: HumanML3D's 22 joints, with lengths of its own.
        vertices: ``[V, 3]`` metres, in the skeleton's T-pose with the root at the origin, y up, facing +z.
        faces: ``[F, 3]``, counter-clockwise as seen from outside; no edge is open.
        joints: of each vertex those that carry it, indices of the 22, ``[V, 4]``.
        weights: their shares, ``[V, 4]``, which sum to 1; of joints that do not count 0.
    """

    skeleton: Skeleton
    vertices: Float[np.ndarray, "V 3"]
    faces: Int[np.ndarray, "F 3"]
    joints: Int[np.ndarray, "V 4"]
    weights: Float[np.ndarray, "V 4"]

    @classmethod
    @cache
    def bundled(cls) -> Mannequin:
        """The one of this package, on HumanML3D's skeleton."""
        return read_arrays(
            FILE,
            "mannequin",
            lambda arrays: cls(
                HUMANML3D,
                arrays["vertices"].astype(np.float64),
                arrays["faces"].astype(np.int64),
                arrays["joints"].astype(np.int64),
                arrays["weights"].astype(np.float64) / arrays["weights"].sum(axis=1, keepdims=True, dtype=np.float64),
            ),
            "install scenectl again",
        )

    @classmethod
    def of(cls, animation: Animation) -> Mannequin:
        """The one that plays an animation: on the lengths between those of its joints that are ours."""
        rest = rest_pose(animation.skeleton).numpy()[animation.ours]
        offsets = rest - rest[[max(parent, 0) for parent in HUMANML3D.parents]]
        return cls.bundled().on(replace(HUMANML3D, offsets=tuple((x, y, z) for x, y, z in offsets.tolist())))

    @property
    def normals(self) -> Float[np.ndarray, "V 3"]:
        """Unit normals at the vertices: those of the triangles around, each by its area."""
        a, b, c = np.moveaxis(self.vertices[self.faces], 1, 0)
        across = np.cross(b - a, c - a)
        summed = np.zeros_like(self.vertices)
        for corner in range(3):
            np.add.at(summed, self.faces[:, corner], across)
        return summed / np.linalg.norm(summed, axis=1, keepdims=True)

    def on(self, skeleton: Skeleton) -> Mannequin:
        """The same on other lengths of the 22 joints' bones.

        Each joint carries its part of the skin along, wider or narrower by the ratio of the legs and, along its bones,
        stretched as these are; so a skeleton that is larger as a whole gets a mannequin that is.
        """
        girth = size_of(skeleton) / size_of(self.skeleton)
        old, new = (np.asarray(each.offsets, dtype=np.float64) for each in (self.skeleton, skeleton))
        before, after = rest_pose(self.skeleton).numpy(), rest_pose(skeleton).numpy()
        moved = np.zeros_like(self.vertices)
        for joint in range(len(old)):
            bones = [child for parent, child in skeleton.bones if parent == joint]
            stretch = np.eye(3) * girth
            if bones:
                left, scale = new[bones] - girth * old[bones], np.square(old[bones]).sum()
                gram = old[bones].T @ old[bones]
                stretch += left.T @ old[bones] @ np.linalg.pinv(gram, rcond=_STIFF, hermitian=True) if scale else 0.0
            share = np.where(self.joints == joint, self.weights, 0.0).sum(axis=1)[:, None]
            moved += share * (after[joint] + (self.vertices - before[joint]) @ stretch.T)
        return replace(self, skeleton=skeleton, vertices=moved)
