"""Meshes to bake: room scans, the bundled scenes, and generated ones that are large, open or full of sharp edges."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import partial
from pathlib import Path

import numpy as np

from scenes.errors import UserError, did_you_mean
from scenes.mesh.csg import csg
from scenes.mesh.mesh import Mesh, load_mesh
from scenes.mesh.primitives import Box, Capsule, Cylinder, Primitive, Sphere
from scenes.world.scene import bundled, bundled_names

SCANS = Path("../shared/data/meshes")
"""Folder of the room scans, which do not come with the package."""


def scan(name: str) -> Mesh:
    """A room scan; raises UserError where the scans are not at hand."""
    return load_mesh(SCANS / f"{name}.ply")


def named(mesh: Mesh, name: str) -> Mesh:
    """The same triangles under another name."""
    return Mesh(mesh.vertices, mesh.faces, name, mesh.source)


FACINGS = ("as-is", "reversed", "wall", "no-ceiling")
"""Ways in which the same room may come: as it is, all of it turned, one wall turned, without what lies highest."""

SKIN = 0.3
"""Metres from the lowest x within which a triangle that faces along x is the wall, and from the top within which what
there is goes."""


def faced(mesh: Mesh, facing: str) -> Mesh:
    """A room as one of `FACINGS`; raises UserError for any other word."""
    if facing not in FACINGS:
        raise UserError(f"unknown facing '{facing}'{did_you_mean(facing, FACINGS)}")
    low, high = mesh.bounds
    a, b, c = np.moveaxis(mesh.triangles, 1, 0)
    normal, middle, faces = np.cross(b - a, c - a), (a + b + c) / 3, mesh.faces
    if facing == "no-ceiling":
        faces = faces[middle[:, 1] < high[1] - SKIN]
    elif facing != "as-is":
        wall = (middle[:, 0] < low[0] + SKIN) & (np.abs(normal[:, 0]) > 0.7 * np.linalg.norm(normal, axis=1))
        turned = wall if facing == "wall" else np.ones(len(faces), dtype=bool)
        faces = np.where(turned[:, None], faces[:, ::-1], faces)
    return named(Mesh(mesh.vertices, faces, mesh.name, mesh.source), f"{mesh.name} {facing}")


def subdivided(mesh: Mesh, triangles: int) -> Mesh:
    """The same surface in so many triangles or, at worst, a quarter fewer, with no new boundary.

    Every triangle is split into four at its edges' middles as often as fits; then the largest are split into three.
    """
    vertices, faces = mesh.vertices, mesh.faces
    while 4 * len(faces) <= triangles:
        edges = np.sort(faces[:, [[0, 1], [1, 2], [2, 0]]], axis=-1)
        pairs, inverse = np.unique(edges.reshape(-1, 2), axis=0, return_inverse=True)
        a, b, c = faces.T
        ab, bc, ca = (inverse.reshape(-1, 3) + len(vertices)).T
        vertices = np.concatenate([vertices, vertices[pairs].mean(axis=1)])
        faces = np.stack([a, ab, ca, ab, b, bc, ca, bc, c, ab, bc, ca], axis=1).reshape(-1, 3)
    corners = vertices[faces]
    areas = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1)
    split = np.argsort(-areas, kind="stable")[: (triangles - len(faces)) // 2]
    middle = len(vertices) + np.arange(len(split))
    a, b, c = faces[split].T
    thirds = np.stack([a, b, middle, b, c, middle, c, a, middle], axis=1).reshape(-1, 3)
    vertices = np.concatenate([vertices, corners[split].mean(axis=1)])
    return Mesh(vertices, np.concatenate([np.delete(faces, split, axis=0), thirds]), mesh.name, mesh.source)


def statue(nodes: int = 190) -> Mesh:
    """A closed figure 2 m high with curved, rippled skin and slivers, from marching cubes."""
    from skimage.measure import marching_cubes

    bones = np.array(
        [
            [[0, -0.9, 0.1], [0.05, -0.2, 0.1], 0.11], [[0, -0.9, -0.15], [-0.05, -0.2, -0.08], 0.11],
            [[0, -0.2, 0], [0, 0.45, 0.02], 0.2], [[0, 0.72, 0.05], [0.02, 0.8, 0.05], 0.13],
            [[0, 0.4, 0.2], [0.3, 0.05, 0.35], 0.07], [[0.3, 0.05, 0.35], [0.5, 0.35, 0.2], 0.06],
            [[0, 0.4, -0.2], [-0.3, 0.6, -0.4], 0.07], [[-0.3, 0.6, -0.4], [-0.2, 0.95, -0.3], 0.06],
            [[-0.1, -0.95, 0], [0.1, -0.95, 0], 0.3],
        ],
        dtype=object,
    )  # fmt: skip
    axis = np.linspace(-1.3, 1.3, nodes)
    points = np.stack(np.meshgrid(axis, axis, axis, indexing="ij"), axis=-1)
    blend = np.zeros(points.shape[:3])
    for a, b, radius in bones:
        start, along = np.array(a, float), np.subtract(b, a).astype(float)
        offset = points - start
        nearest = (offset @ along / (along @ along)).clip(0, 1)[..., None] * along
        blend += np.exp(-25 * (np.linalg.norm(offset - nearest, axis=-1) - radius))
    ripple = 0.006 * np.sin(38 * points).sum(axis=-1)
    step = float(axis[1] - axis[0])
    vertices, faces, _, _ = marching_cubes(-np.log(blend) / 25 + ripple, 0.0, spacing=(step,) * 3)
    return Mesh(vertices - 1.3, faces, "statue", "generated")


def soup_random(triangles: int = 100_000, seed: int = 0) -> Mesh:
    """Loose triangles in a cube of 4 m, a few millimetres to half a metre large, facing anywhere."""
    rng = np.random.default_rng(seed)
    centre = rng.uniform(-2, 2, (triangles, 1, 3))
    size = rng.lognormal(np.log(0.04), 0.8, (triangles, 1, 1))
    corners = centre + size * rng.normal(size=(triangles, 3, 3))
    return Mesh(corners.reshape(-1, 3), np.arange(3 * triangles).reshape(-1, 3), "soup_random", "generated")


def soup_shapes(shapes: int = 360, seed: int = 0) -> Mesh:
    """Boxes, balls, capsules and cylinders that run through each other; every third has lost some of its triangles."""
    rng = np.random.default_rng(seed)
    vertices: list[np.ndarray] = []
    faces: list[np.ndarray] = []
    for i in range(shapes):
        place, size = rng.uniform(-2, 2, 3).tolist(), rng.uniform(0.1, 0.5, 3).tolist()
        kinds: list[Primitive] = [
            Box(place, size, yaw=float(rng.uniform(0, 3))),
            Sphere(place, size[0] / 2),
            Capsule(place, (np.array(place) + size).tolist(), size[0] / 3),
            Cylinder(place, size[0] / 2, size[1]),
        ]
        part = kinds[i % 4].mesh()
        kept = part.faces[rng.random(len(part.faces)) > (0.3 if i % 3 == 0 else 0)]
        faces.append(kept + sum(len(v) for v in vertices))
        vertices.append(part.vertices)
    return Mesh(np.concatenate(vertices), np.concatenate(faces), "soup_shapes", "generated")


def cad() -> Mesh:
    """A block with a round boss, bores and a slot: flat faces, sharp edges, long thin triangles."""
    block = csg("union", Box((0, 0, 0), (2, 0.6, 1.2)), Cylinder((0.4, 0.45, 0), 0.4, 0.5), Sphere((-0.9, 0, 0), 0.5))
    bores = [Cylinder((x, 0, z), 0.09, 3.0) for x in (-0.3, 0.0, 0.85) for z in (-0.45, 0.45)]
    slot = Box((0, -0.3, 0), (3, 0.25, 0.3), yaw=0.2)
    return named(csg("difference", block, Cylinder((0.4, 0, 0), 0.2, 3.0), slot, *bores), "cad")


def _bundled(scene: str) -> Mesh:
    return named(bundled(scene).meshes[0], f"bundled_{scene}")


KNOWN: Mapping[str, Callable[[], Mesh]] = {
    "living_room": partial(scan, "living_room"),
    "office_large": partial(scan, "office_large"),
    **{f"bundled_{name}": partial(_bundled, name) for name in bundled_names()},
    "statue": statue,
    "cad": cad,
    "soup_random": soup_random,
    "soup_shapes": soup_shapes,
    "subdivided_1m4": lambda: named(subdivided(scan("living_room"), 1_400_000), "subdivided_1m4"),
    "statue_2m": lambda: named(subdivided(statue(), 2_000_000), "statue_2m"),
}
"""Makers of meshes by name, quick ones first."""


def mesh_named(name: str) -> Mesh:
    """One of `KNOWN`, or the mesh of a file; raises UserError for what is neither."""
    if name in KNOWN:
        return KNOWN[name]()
    if not Path(name).suffix:
        raise UserError(f"unknown mesh '{name}'{did_you_mean(name, KNOWN)}; or give a file")
    return load_mesh(name)
