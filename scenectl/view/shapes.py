"""Geometry for pictures: the body as capsules, its shadow, pieces of the scene, rings and tubes."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from scenes.body.body import ProxyBody
from scenes.mesh.mesh import Mesh
from scenes.mesh.surface import Surface

if TYPE_CHECKING:
    from pyvista import PolyData

_CELL, _BLUR = 0.02, 0.12
"""Metres from one sample of a shadow to the next, and by which it fades on both sides of its edge."""


def facets(triangles: np.ndarray, colours: np.ndarray | None = None) -> PolyData:
    """Triangles ``[F, 3, 3]`` (m) as a surface, in their order, each with its ``colour`` of ``[F, 3]``."""
    from pyvista import PolyData

    surface = PolyData.from_regular_faces(triangles.reshape(-1, 3), np.arange(3 * len(triangles)).reshape(-1, 3))
    if colours is not None:
        surface.cell_data["colour"] = colours
    return surface


def body_hull(body: ProxyBody, joints: np.ndarray) -> PolyData:
    """A body in a pose ``[J, 3]`` (m): capsules that taper from joint to joint, and the spheres past the joints."""
    radius = {s.joint: s.radius for s in body.spheres if s.base < 0}
    ends, radii = [], []
    for c in body.capsules:
        # the trunk keeps its capsule's radius, limbs taper between their joints
        ends.append((joints[c.a], joints[c.b]))
        radii.append([max(min(radius[j], 1.25 * c.radius), 0.75 * c.radius) for j in (c.a, c.b)])
    for s in body.spheres:
        if s.base >= 0:
            ends.append((joints[s.joint], (1.0 + s.beyond) * joints[s.joint] - s.beyond * joints[s.base]))
            radii.append([min(radius[s.joint], s.radius), s.radius])
    a, b = np.stack(ends, axis=1)
    return capsules(a, b, np.array(radii), sides=14)


def arrow(begin: np.ndarray, end: np.ndarray) -> PolyData:
    """An arrow from one point to another (m)."""
    from pyvista import Arrow

    size = float(np.linalg.norm(end - begin))
    sides = {"tip_resolution": 24, "shaft_resolution": 24}
    parts = {"tip_length": 0.12 / size, "tip_radius": 0.05 / size, "shaft_radius": 0.018 / size}
    return Arrow(start=begin, direction=end - begin, scale=size, **parts, **sides)


def capsules(a: np.ndarray, b: np.ndarray, radii: np.ndarray, sides: int = 60) -> PolyData:
    """Half a sphere around each end and what is between them; balls where ends are one point.

    Args:
        a: near ends, ``[n, 3]`` m.
        b: far ends.
        radii: at both, ``[n, 2]`` m.
        sides: corners around each, an even number.
    """
    from pyvista import PolyData, Sphere

    unit = Sphere(radius=1.0, theta_resolution=sides, phi_resolution=sides)  # around z, drawn apart at its equator
    far = unit.points[:, 2] > 0
    normals = unit.points @ _frames(b - a)
    centres = np.where(far[:, None], b[:, None], a[:, None])
    points = centres + np.where(far, radii[:, 1:], radii[:, :1])[..., None] * normals
    faces = unit.regular_faces + unit.n_points * np.arange(len(a))[:, None, None]
    hull = PolyData.from_regular_faces(points.reshape(-1, 3), faces.reshape(-1, 3))
    hull.point_data.active_normals = normals.reshape(-1, 3)
    return hull


def _frames(axes: np.ndarray) -> np.ndarray:
    """Rows x, y, z of frames whose z lie along the axes ``[n, 3]``; +z itself for those of no length."""
    length = np.linalg.norm(axes, axis=1, keepdims=True)
    z = np.where(length > 1e-9, axes / np.maximum(length, 1e-9), [0.0, 0.0, 1.0])
    x = np.cross(np.where(np.abs(z[:, :1]) < 0.8, [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]), z)
    x /= np.linalg.norm(x, axis=1, keepdims=True)
    return np.stack([x, np.cross(z, x), z], axis=1)


def soft_shadow(
    poses: list[np.ndarray], radius: np.ndarray, strengths: list[float]
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Shadow of bodies on the floor, straight down and soft.

    Args:
        poses: sample points of each body over the ground, ``[M, 3]`` metres.
        radius: of the samples, ``[M]``.
        strengths: darkness of each body's shadow, 0 to 1.

    Returns:
        x ``[X]``, z ``[Z]`` (m) and darkness ``[X, Z]``.
    """
    flat = np.concatenate([pose[:, [0, 2]] for pose in poses])
    low, high = flat.min(axis=0) - 0.4, flat.max(axis=0) + 0.4
    x, z = (np.arange(low[k], high[k], _CELL) for k in range(2))
    dark = np.zeros((len(x), len(z)))
    for pose, strength in zip(poses, strengths, strict=True):
        here = np.zeros_like(dark)
        for (px, py, pz), r in zip(pose, radius, strict=True):
            reach = r + _BLUR
            i = slice(*np.searchsorted(x, [px - reach, px + reach]))
            j = slice(*np.searchsorted(z, [pz - reach, pz + reach]))
            away = np.sqrt(np.square(x[i] - px)[:, None] + np.square(z[j] - pz))
            fade = np.clip((reach - away) / (2 * _BLUR), 0.0, 1.0) * min(max(1.3 - 0.5 * py, 0.2), 1.0)
            here[i, j] = np.maximum(here[i, j], fade * fade * (3 - 2 * fade))
        dark = np.maximum(dark, strength * here)
    return x, z, dark


def inward(mesh: Mesh) -> bool:
    """A room seen from inside, as scans are: nearly closed, and of negative volume. Costs far less than a bake."""
    a, b, c = np.moveaxis(mesh.triangles - mesh.bounds.mean(axis=0), 1, 0)
    volume = float((a * np.cross(b, c)).sum()) / 6
    return volume < 0 and Surface.of(mesh).nearly_closed


def components(mesh: Mesh) -> np.ndarray:
    """Which connected piece each face belongs to, ``[F]``: the objects of a scene whose objects are apart."""
    from scipy.sparse import coo_matrix
    from scipy.sparse.csgraph import connected_components

    _, welded = np.unique(mesh.vertices.round(5), axis=0, return_inverse=True)
    faces = welded.reshape(-1)[mesh.faces]
    count = int(faces.max()) + 1
    edges = np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]]])
    graph = coo_matrix((np.ones(len(edges)), (edges[:, 0], edges[:, 1])), shape=(count, count))
    _, label = connected_components(graph, directed=False)
    pieces: np.ndarray = label[faces[:, 0]]
    return pieces
