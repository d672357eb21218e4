"""Geometry for pictures: the body as capsules, its shadow, the scene with its colours, balls, rings and tubes."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from scenes.body.body import ProxyBody
from scenes.mesh.mesh import Mesh
from scenes.mesh.surface import Surface

CLAY = (216, 211, 203)
"""Colour of meshes that bring none."""


class Hull(NamedTuple):
    """A surface: corners ``[V, 3]`` (m), triangles ``[F, 3]`` of them or None for three by three, unit normals."""

    points: np.ndarray
    faces: Any = None
    normals: Any = None


def body_hull(body: ProxyBody, joints: np.ndarray) -> Hull:
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
    return capsules(a, b, np.array(radii), sphere(6, 18))


def joined(hulls: Sequence[Hull]) -> Hull:
    """Several smooth surfaces as one."""
    starts = np.cumsum([0, *(len(hull.points) for hull in hulls[:-1])])
    faces = [hull.faces + start for hull, start in zip(hulls, starts, strict=True)]
    return Hull(*(np.concatenate(part) for part in ([h.points for h in hulls], faces, [h.normals for h in hulls])))


def sphere(rings: int = 6, sides: int = 18) -> Hull:
    """The unit sphere around +z, its equator doubled, so that it can be drawn apart into a capsule."""
    half = np.linspace(0.0, np.pi / 2, rings)
    polar = np.concatenate([half, half + np.pi / 2])
    turn = np.linspace(0.0, 2 * np.pi, sides, endpoint=False)
    around = np.stack([np.cos(turn), np.sin(turn), np.ones_like(turn)], axis=-1)
    out = np.stack([np.sin(polar), np.sin(polar), np.cos(polar)], axis=-1)
    points = (out[:, None] * around).reshape(-1, 3)
    return Hull(points, _strips(len(polar), sides), points)


def capsules(a: np.ndarray, b: np.ndarray, radii: np.ndarray, unit: Hull | None = None) -> Hull:
    """Half a sphere around each end and what is between them; balls where ends are one point.

    Args:
        a: near ends, ``[n, 3]`` m.
        b: far ends.
        radii: at both, ``[n, 2]`` m.
        unit: the sphere that is drawn apart.
    """
    unit = sphere(15, 60) if unit is None else unit
    upper = np.arange(len(unit.points)) < len(unit.points) // 2  # the half towards +z belongs to the far end
    normals = unit.points @ _frames(b - a)
    centres = np.where(upper[:, None], b[:, None], a[:, None])
    points = centres + np.where(upper, radii[:, 1:], radii[:, :1])[..., None] * normals
    starts = len(unit.points) * np.arange(len(a))
    faces = (unit.faces + starts[:, None, None]).reshape(-1, 3)
    return Hull(points.reshape(-1, 3), faces, normals.reshape(-1, 3))


def tube(points: np.ndarray, radius: float, sides: int = 12) -> Hull:
    """A tube of a radius (m) along a polyline ``[P, 3]``, its ends open; neighbouring points must differ."""
    steps = np.diff(points, axis=0)
    steps /= np.linalg.norm(steps, axis=1, keepdims=True)
    along = np.concatenate([steps[:1], steps[:-1] + steps[1:], steps[-1:]])
    back = np.linalg.norm(along, axis=1) < 1e-6  # where the line turns on the spot
    along[back] = np.concatenate([steps, steps[-1:]])[back]
    along /= np.linalg.norm(along, axis=1, keepdims=True)
    across = np.empty_like(along)
    across[0] = _frames(along[:1])[0, 0]
    for k, (old, new) in enumerate(pairwise(along)):  # turned no more than the line is, so that the tube is not twisted
        bend = (across[k] @ new) / max(1.0 + old @ new, 1e-9)
        across[k + 1] = across[k] - bend * (old + new)
    third = np.cross(along, across)
    turn = np.linspace(0.0, 2 * np.pi, sides, endpoint=False)[:, None]
    normals = np.cos(turn) * across[:, None] - np.sin(turn) * third[:, None]
    # In the plane of a bend its ring is a wider ellipse, so that the tube keeps its width on both sides.
    bends = np.zeros_like(along)
    bends[1:-1] = np.diff(steps, axis=0)
    wide = 2.0 / np.sqrt(np.maximum(4.0 - np.square(bends).sum(1), 1.0)) - 1.0
    bends /= np.maximum(np.linalg.norm(bends, axis=1, keepdims=True), 1e-9)
    wider = normals + (wide[:, None] * (normals @ bends[..., None])[..., 0])[..., None] * bends[:, None]
    placed = points[:, None] + radius * wider
    return Hull(placed.reshape(-1, 3), _strips(len(points), sides), normals.reshape(-1, 3))


def ring(centre: np.ndarray, inner: float, outer: float, sides: int = 48) -> Hull:
    """A flat horizontal ring around a point (m); a disc where `inner` is 0."""
    turn = np.linspace(0.0, 2 * np.pi, sides, endpoint=False)
    circle = np.stack([np.sin(turn), np.zeros_like(turn), np.cos(turn)], axis=-1)
    points = centre + np.concatenate([inner * circle, outer * circle])
    return Hull(points, _strips(2, sides), np.tile([0.0, 1.0, 0.0], (2 * sides, 1)))


def _strips(rows: int, sides: int) -> np.ndarray:
    """Triangles between closed rows of as many points, ``[F, 3]``."""
    i, j = np.meshgrid(np.arange(rows - 1), np.arange(sides), indexing="ij")
    a, b = i * sides + j, i * sides + (j + 1) % sides
    c, d = a + sides, b + sides
    return np.concatenate([np.stack([a, c, b], -1).reshape(-1, 3), np.stack([b, c, d], -1).reshape(-1, 3)])


def _frames(axes: np.ndarray) -> np.ndarray:
    """Rows x, y, z of frames whose z lie along the axes ``[n, 3]``; +z itself for those of no length."""
    length = np.linalg.norm(axes, axis=1, keepdims=True)
    z = np.where(length > 1e-9, axes / np.maximum(length, 1e-9), [0.0, 0.0, 1.0])
    x = np.cross(np.where(np.abs(z[:, :1]) < 0.8, [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]), z)
    x /= np.linalg.norm(x, axis=1, keepdims=True)
    return np.stack([x, np.cross(z, x), z], axis=1)


def soft_shadow(
    poses: list[np.ndarray], radius: np.ndarray, strengths: list[float], cell: float = 0.02, blur: float = 0.12
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Shadow of bodies on the floor, straight down and soft.

    Args:
        poses: sample points of each body, ``[M, 3]`` metres.
        radius: of the samples, ``[M]``.
        strengths: darkness of each body's shadow, 0 to 1.
        cell, blur: metres.

    Returns:
        x ``[X]``, z ``[Z]`` (m) and darkness ``[X, Z]``.
    """
    flat = np.concatenate([pose[:, [0, 2]] for pose in poses])
    low, high = flat.min(axis=0) - 0.4, flat.max(axis=0) + 0.4
    x, z = (np.arange(low[k], high[k], cell) for k in range(2))
    dark = np.zeros((len(x), len(z)))
    for pose, strength in zip(poses, strengths, strict=True):
        here = np.zeros_like(dark)
        for (px, py, pz), r in zip(pose, radius, strict=True):
            reach = r + blur
            i = slice(*np.searchsorted(x, [px - reach, px + reach]))
            j = slice(*np.searchsorted(z, [pz - reach, pz + reach]))
            away = np.sqrt(np.square(x[i] - px)[:, None] + np.square(z[j] - pz))
            fade = np.clip((reach - away) / (2 * blur), 0.0, 1.0) * min(max(1.3 - 0.5 * py, 0.2), 1.0)
            here[i, j] = np.maximum(here[i, j], fade * fade * (3 - 2 * fade))
        dark = np.maximum(dark, strength * here)
    return x, z, dark


class Solid(NamedTuple):
    """A mesh as it is drawn: triangles ``[F, 3, 3]`` (m), and of each its colour ``[F, 3]`` and its piece ``[F]``."""

    triangles: np.ndarray
    colours: np.ndarray
    pieces: np.ndarray


def solid_of(mesh: Mesh, otherwise: tuple[int, int, int] = CLAY) -> Solid:
    """A mesh with the colours of the file it came from, else `otherwise`, and its connected pieces."""
    return Solid(mesh.triangles, face_colours(mesh, otherwise), components(mesh))


def face_colours(mesh: Mesh, otherwise: tuple[int, int, int] = CLAY) -> np.ndarray:
    """sRGB colour of every face, ``[F, 3]`` uint8: those of the file it came from, else `otherwise`."""
    plain = np.tile(np.array(otherwise, dtype=np.uint8), (len(mesh.faces), 1))
    path = Path(mesh.source)
    if not path.is_file():
        return plain
    import trimesh

    try:
        parts = [part for part in trimesh.load_scene(path, process=False).dump() if isinstance(part, trimesh.Trimesh)]
        colours = [_colours_of(part) for part in parts if len(part.faces)]
    except Exception:  # colours are decoration: a file whose materials cannot be read is drawn in clay
        return plain
    found = np.concatenate(colours) if colours else plain
    return found if len(found) == len(plain) else plain


def _colours_of(part: Any) -> np.ndarray:
    """Colour of each face of one part, ``[F, 3]``: of its material, its texture or its vertices, else clay."""
    visual, faces = part.visual, np.asarray(part.faces)
    material = getattr(visual, "material", None)
    texture = getattr(material, "baseColorTexture", None) or getattr(material, "image", None)
    if getattr(visual, "defined", False) and texture is None and material is not None:
        colour = np.asarray(material.main_color)[:3] / 255.0
        if hasattr(material, "baseColorFactor"):  # glTF states linear light, pictures are sRGB
            colour = np.where(colour <= 0.0031308, 12.92 * colour, 1.055 * colour ** (1 / 2.4) - 0.055)
        return np.tile((255 * colour).astype(np.uint8), (len(faces), 1))
    if getattr(visual, "defined", False):
        vertices = np.asarray((visual.to_color() if texture is not None else visual).vertex_colors)[:, :3]
        return vertices[faces].mean(axis=1).astype(np.uint8)
    return np.tile(np.array(CLAY, dtype=np.uint8), (len(faces), 1))


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
