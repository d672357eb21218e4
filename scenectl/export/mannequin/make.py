"""The mannequin, as the script that makes it: ``python -m scenectl.export.mannequin.make [FILE]``.

Capsules that taper, on HumanML3D's joints in the T-pose, are united smoothly; the surface is thinned to about 5,000
triangles; and every joint's share of it spreads along the surface as heat does.
"""

from __future__ import annotations

import sys
import tomllib
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import numpy as np

from scenectl.export.mannequin import FILE
from scenes.files import atomic_write
from scenes.motion.bones import rest_pose
from scenes.motion.skeleton import FEET, HUMANML3D

CELL = 0.006
"""Metres between the nodes on which the distance is known."""
TRIANGLES = 5000
BLEND = 0.03
"""Metres around which the surfaces of two capsules become one."""
SPREAD = 0.035
"""Metres along the surface by which the hold of a joint fades."""
SOLE = 0.025
"""Metres from the foot joints down to the soles, which are level."""


class Cone(NamedTuple):
    """A capsule that tapers: what carries it, both ends (m) and both radii (m)."""

    joint: int
    a: np.ndarray
    b: np.ndarray
    near: float
    far: float

    def distance(self, points: np.ndarray) -> np.ndarray:
        """Signed distance (m) of points ``[..., 3]``, up to the slope of the taper."""
        axis = self.b - self.a
        share = np.clip((points - self.a) @ axis / max(float(axis @ axis), 1e-12), 0.0, 1.0)
        nearest = self.a + share[..., None] * axis
        away: np.ndarray = np.linalg.norm(points - nearest, axis=-1)
        return away - (self.near + share * (self.far - self.near))


def cones() -> Iterator[Cone]:
    """All parts of the table, on both sides."""
    rest = rest_pose(HUMANML3D).numpy()
    table = tomllib.loads(Path(__file__).with_name("parts.toml").read_text(encoding="utf-8"))["parts"]
    for row in table:
        for side, sign in (("left", 1), ("right", -1)):
            joint, near, radius, far, other = row
            a, b = (
                rest[HUMANML3D.index(name.replace("*", side))] + np.array([sign, 1, 1]) * np.array(by) / 1000
                for name, by in (near, far)
            )
            yield Cone(HUMANML3D.index(joint.replace("*", side)), a, b, radius / 1000, other / 1000)


def blended(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """The smooth least of two distances (m): the polynomial one of I. Quilez, which reaches as far as `BLEND`."""
    share = np.maximum(BLEND - np.abs(a - b), 0.0) / BLEND
    least: np.ndarray = np.minimum(a, b) - share**2 * BLEND / 4
    return least


def surface(parts: list[Cone]) -> tuple[np.ndarray, np.ndarray]:
    """Vertices (m) and faces of all parts as one."""
    from skimage.measure import marching_cubes

    ends = np.concatenate([[part.a, part.b] for part in parts])
    low = ends.min(axis=0) - 0.15
    axes = [np.arange(a, b, CELL) for a, b in zip(low, ends.max(axis=0) + 0.15, strict=True)]
    field = np.full([len(axis) for axis in axes], 1.0)
    for part in parts:
        reach = max(part.near, part.far) + 2 * BLEND
        box = tuple(
            slice(*np.searchsorted(axis, [min(a, b) - reach, max(a, b) + reach]))
            for axis, a, b in zip(axes, part.a, part.b, strict=True)
        )
        points = np.stack(np.meshgrid(*(axis[s] for axis, s in zip(axes, box, strict=True)), indexing="ij"), axis=-1)
        field[box] = blended(field[box], part.distance(points))
    field = np.maximum(field, sole() - axes[1][:, None])
    vertices, faces, _, _ = marching_cubes(field, 0.0)
    return low + CELL * vertices, faces


def sole() -> float:
    """Height (m) of the soles in the T-pose."""
    return float(rest_pose(HUMANML3D)[HUMANML3D.indices(FEET), 1].min()) - SOLE


def held(vertices: np.ndarray, faces: np.ndarray, parts: list[Cone]) -> np.ndarray:
    """Shares ``[V, 22]`` that joints have in vertices: those of the nearest parts, spread along the surface."""
    from igl import cotmatrix, massmatrix
    from scipy.sparse.linalg import splu

    nearest = np.argmin([part.distance(vertices) for part in parts], axis=0)
    owned = np.eye(len(HUMANML3D.names))[np.array([part.joint for part in parts])[nearest]]
    mass = massmatrix(vertices, faces)
    spread = splu((mass - SPREAD**2 * cotmatrix(vertices, faces)).tocsc())
    return np.clip(spread.solve(mass @ owned), 0.0, 1.0)


def thinned(vertices: np.ndarray, faces: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The same surface in fewer triangles."""
    from igl import qslim

    vertices, faces, *_ = qslim(vertices, faces, TRIANGLES)
    return vertices, faces


def main(path: Path) -> None:
    """Write the file."""
    from scipy.spatial import cKDTree

    parts = list(cones())
    fine, fine_faces = surface(parts)
    vertices, faces = thinned(fine, fine_faces)
    shares = held(fine, fine_faces, parts)[cKDTree(fine).query(vertices)[1]]
    joints = np.argsort(-shares, axis=1, kind="stable")[:, :4]
    weights = np.take_along_axis(shares, joints, axis=1)
    weights /= weights.sum(axis=1, keepdims=True)
    with atomic_write(path) as out:
        np.savez_compressed(
            out,
            vertices=vertices.astype(np.float32),
            faces=faces.astype(np.uint16),
            joints=joints.astype(np.uint8),
            weights=weights.astype(np.float32),
        )


if __name__ == "__main__":
    main(Path(sys.argv[1]) if len(sys.argv) > 1 else FILE)
