"""The mannequin, as the script that makes it: ``python -m scenectl.export.mannequin.make [FILE]``.

Tubes of capsules that taper, on HumanML3D's joints in the T-pose, are united smoothly; the surface is thinned to about
5,000 triangles; and every joint's share of it spreads along the surface as heat does.
"""

from __future__ import annotations

import sys
import tomllib
from collections.abc import Iterator
from itertools import pairwise
from pathlib import Path
from typing import NamedTuple

import numpy as np
from scipy.interpolate import PchipInterpolator

from scenectl.export.mannequin import FILE
from scenes.files import atomic_write
from scenes.motion.bones import rest_pose
from scenes.motion.skeleton import FEET, HUMANML3D

CELL = 0.006
"""Metres between the nodes on which the distance is known."""
FINE, TRIANGLES = 50_000, 5000
"""Triangles along which shares spread, and of the mannequin."""
TABLE = tomllib.loads(Path(__file__).with_name("parts.toml").read_text(encoding="utf-8"))
BLEND = TABLE["blend"] / 1000
"""Metres around which the surfaces of two tubes become one."""
PIECES = 6
"""Straight pieces of a tube between two of its points."""
SPREAD = 0.045
"""Metres along the surface by which the hold of a joint fades."""
STEPS = 4
"""Steps of time in which it does; a single one would leave a joint a hold far away."""
LEAST = 0.01
"""Share below which a joint does not carry a vertex."""
SOLE = 0.025
"""Metres from the foot joints down to the soles, which are level."""


class Tube(NamedTuple):
    """Balls along a smooth way, near each other: centres ``[n, 3]`` and radii ``[n]`` (m), and what carries each."""

    centres: np.ndarray
    radii: np.ndarray
    joints: np.ndarray

    def nearest(self, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Signed distance (m) of points ``[..., 3]``, and the joint that carries what is nearest."""
        distance, joint = np.full(points.shape[:-1], np.inf), np.zeros(points.shape[:-1], dtype=int)
        for k, (a, b) in enumerate(pairwise(self.centres)):
            axis = b - a
            share = np.clip((points - a) @ axis / (axis @ axis), 0.0, 1.0)
            away = np.linalg.norm(points - a - share[..., None] * axis, axis=-1)
            away -= self.radii[k] + share * (self.radii[k + 1] - self.radii[k])
            joint = np.where(away < distance, self.joints[k], joint)
            distance = np.minimum(away, distance)
        return distance, joint


def tubes() -> Iterator[Tube]:
    """All tubes of the table, on both sides."""
    rest = rest_pose(HUMANML3D).numpy()
    for tube in TABLE["tubes"]:
        both = any("*" in point[0] for point in tube)
        for side, sign in (("left", 1), ("right", -1))[: 1 + both]:
            names = [[HUMANML3D.index(point[k].replace("*", side)) for point in tube] for k in (0, 3)]
            places = rest[names[0]] + np.array([point[1] for point in tube]) * [sign, 1, 1] / 1000
            way = np.concatenate([[0.0], np.linalg.norm(np.diff(places, axis=0), axis=1).cumsum()])
            at = np.unique(np.concatenate([np.linspace(a, b, PIECES + 1) for a, b in pairwise(way)]))
            balls = PchipInterpolator(way, np.column_stack([places, [point[2] / 1000 for point in tube]]))(at)
            yield Tube(balls[:, :3], balls[:, 3], np.array(names[1])[np.searchsorted(way, at, "right") - 1])


def blended(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """The smooth least of two distances (m): the polynomial one of I. Quilez, which reaches as far as `BLEND`."""
    share = np.maximum(BLEND - np.abs(a - b), 0.0) / BLEND
    least: np.ndarray = np.minimum(a, b) - share**2 * BLEND / 4
    return least


def surface(parts: list[Tube]) -> tuple[np.ndarray, np.ndarray]:
    """Vertices (m) and faces of all parts as one."""
    from skimage.measure import marching_cubes

    low, high = (end([end(part.centres, axis=0) for part in parts], axis=0) for end in (np.min, np.max))
    axes = [np.arange(a - 0.15, b + 0.15, CELL) for a, b in zip(low, high, strict=True)]
    field = np.full([len(axis) for axis in axes], 1.0)
    for part in parts:
        reach = part.radii.max() + 2 * BLEND
        sides = np.stack([part.centres.min(axis=0) - reach, part.centres.max(axis=0) + reach], axis=1)
        box = tuple(slice(*np.searchsorted(axis, side)) for axis, side in zip(axes, sides, strict=True))
        points = np.stack(np.meshgrid(*(axis[s] for axis, s in zip(axes, box, strict=True)), indexing="ij"), axis=-1)
        field[box] = blended(field[box], part.nearest(points)[0])
    field = np.maximum(field, sole() - axes[1][:, None])
    vertices, faces, _, _ = marching_cubes(field, 0.0)
    return [axis[0] for axis in axes] + CELL * vertices, faces


def sole() -> float:
    """Height (m) of the soles in the T-pose."""
    return float(rest_pose(HUMANML3D)[HUMANML3D.indices(FEET), 1].min()) - SOLE


def held(vertices: np.ndarray, faces: np.ndarray, parts: list[Tube]) -> np.ndarray:
    """Shares ``[V, 22]`` that joints have in vertices: those of the nearest parts, spread along the surface."""
    from igl import cotmatrix, massmatrix
    from scipy.sparse.linalg import splu

    distances, joints = (np.stack(each) for each in zip(*(part.nearest(vertices) for part in parts), strict=True))
    owner = np.take_along_axis(joints, distances.argmin(axis=0)[None], axis=0)[0]
    owned = np.eye(len(HUMANML3D.names))[owner]
    mass = massmatrix(vertices, faces)
    spread = splu((mass - SPREAD**2 / STEPS * cotmatrix(vertices, faces)).tocsc())
    for _ in range(STEPS):
        owned = np.clip(spread.solve(mass @ owned), 0.0, 1.0)
    return np.where(owned < LEAST, 0.0, owned)


def thinned(vertices: np.ndarray, faces: np.ndarray, count: int) -> tuple[np.ndarray, np.ndarray]:
    """The same surface in so many triangles, none of them without an area."""
    from igl import qslim

    vertices, faces, *_ = qslim(vertices, faces, count)
    return vertices, faces


def main(path: Path) -> None:
    """Write the file."""
    from scipy.spatial import cKDTree

    parts = list(tubes())
    fine, fine_faces = thinned(*surface(parts), FINE)
    vertices, faces = thinned(fine, fine_faces, TRIANGLES)
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
