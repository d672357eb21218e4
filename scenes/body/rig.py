"""Characters and robots at rest: links in a tree, and the triangles that move rigidly with each of them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from scenes.errors import UserError, did_you_mean
from scenes.mesh.content import used
from scenes.mesh.scale import LARGEST
from scenes.motion.frames import transform


@dataclass(frozen=True, eq=False)
class Part:
    """Triangles that move with one link.

    Attributes:
        link: name of the joint (of a character) or link (of a robot) that carries them.
        frame: rigid transform from the link to the world at rest, ``[4, 4]``, metres, y up in the world.
        vertices: ``[V, 3]`` metres in the link's frame, every one used by a triangle.
        faces: ``[F, 3]``; the front side sees them counter-clockwise.
    """

    link: str
    frame: np.ndarray
    vertices: np.ndarray
    faces: np.ndarray

    @classmethod
    def of(cls, link: str, frame: np.ndarray, vertices: np.ndarray, faces: np.ndarray) -> Part:
        """The part of the vertices that the triangles use; vertices in the link's frame."""
        return cls(link, frame, *used(vertices, faces))

    @cached_property
    def placed(self) -> np.ndarray:
        """Vertices in the world at rest, ``[V, 3]`` metres."""
        return transform(self.frame, self.vertices)


@dataclass(frozen=True, eq=False)
class Rig:
    """A character or a robot at rest. `read_rig` and `read_urdf` make them.

    Attributes:
        name, source: the file's stem and the file.
        links: names of all joints (of a character) or links (of a robot), parents before children.
        parents: index of each link's parent, -1 for roots.
        frames: rigid transform from each link to the world at rest, ``[L, 4, 4]``, metres, y up.
        parts: triangles of the links that have some, in the order of `links`.
        doubts: what whoever gave the file should hear about how it was read, one sentence each.
        known: {joint of our 22: link} as far as the file itself says so.

    Raises:
        UserError: it is larger than any scene; the sentence carries on from its name.
    """

    name: str
    source: str
    links: tuple[str, ...]
    parents: tuple[int, ...]
    frames: np.ndarray
    parts: tuple[Part, ...]
    doubts: tuple[str, ...] = ()
    known: Mapping[str, str] = field(default_factory=dict)

    def __post_init__(self) -> None:
        reach = np.concatenate([self.origins, *(part.placed for part in self.parts)])
        extent = float(np.ptp(reach, axis=0).max()) if len(reach) else 0.0
        if not extent <= LARGEST:
            raise UserError(f"is {extent:.3g} m long, and rigs are {LARGEST:g} m at most; check its scales and offsets")

    def index(self, link: str) -> int:
        """Index of a link; raises UserError naming the nearest known one."""
        if link not in self.links:
            raise UserError(f"'{self.name}' has no link '{link}'{did_you_mean(link, self.links)}")
        return self.links.index(link)

    @property
    def origins(self) -> np.ndarray:
        """World positions of all links at rest, ``[L, 3]`` metres."""
        positions: np.ndarray = self.frames[:, :3, 3]
        return positions

    @cached_property
    def triangles(self) -> np.ndarray:
        """Corners of all triangles in the world at rest, ``[F, 3, 3]`` metres, part after part."""
        return np.concatenate([part.placed[part.faces] for part in self.parts])
