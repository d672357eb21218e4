"""Ground with several heights, made of solids."""

from __future__ import annotations

import numpy as np

from scenes.mesh.csg import csg
from scenes.mesh.mesh import Mesh
from scenes.mesh.primitives import Box
from scenes.world.scene import Scene


def block(x: tuple[float, float], z: tuple[float, float], top: float, bottom: float = -0.2) -> Mesh:
    """A box from `bottom` to `top` (m) over a rectangle."""
    centre = ((x[0] + x[1]) / 2, (bottom + top) / 2, (z[0] + z[1]) / 2)
    return Box(centre, (x[1] - x[0], top - bottom, z[1] - z[0])).mesh()


def wedge(x: tuple[float, float], z: tuple[float, float], rise: float, bottom: float = -0.2) -> Mesh:
    """A ramp from y = 0 at the first z to `rise` (m) at the last one."""
    (x0, x1), (z0, z1) = x, z
    corners = [(a, y, b) for a in (x0, x1) for b, y in ((z0, bottom), (z0, 0.0), (z1, bottom), (z1, rise))]
    import trimesh

    hull = trimesh.convex.convex_hull(np.array(corners))
    return Mesh(hull.vertices, hull.faces, "wedge")


def joined(*solids: Mesh, resolution: int = 192) -> Scene:
    """Solids as one mesh, its floor found."""
    return Scene([csg("union", *solids)], resolution=resolution, cache=None, name="ground")


def steps(rise: float = 0.17, count: int = 4, tread: float = 0.3, width: float = 1.4, side: float = 0.0) -> Scene:
    """A floor of 4 x 6 m, and steps up along +z from z = 0 onto a platform of 2 m."""
    half = width / 2
    parts = [block((side - half, side + half), (k * tread, 3.0), (k + 1) * rise) for k in range(count)]
    top = block((-2.0, 2.0), (count * tread, 3.0), count * rise)
    return joined(block((-2.0, 2.0), (-3.0, 3.0), 0.0), *parts, top)


def ramp(angle: float = 10.0, run: float = 3.0) -> Scene:
    """A floor of 3 x 3 m, a ramp along +z from z = 0, and a platform of 3 x 2 m at its end."""
    rise = run * float(np.tan(np.radians(angle)))
    base, top = block((-1.5, 1.5), (-3.0, 0.0), 0.0), block((-1.5, 1.5), (run, run + 2.0), rise)
    return joined(base, wedge((-1.5, 1.5), (0.0, run), rise), top)


def kerb(height: float) -> Scene:
    """A floor of 4 x 2 m and a pavement of 4 x 2 m beside it, higher."""
    return joined(block((-2.0, 2.0), (-2.0, 0.0), 0.0), block((-2.0, 2.0), (0.0, 2.0), height))


def storeys(stairs: bool = True) -> Scene:
    """Two floors of 6 x 4 m, 2.72 m apart; stairs along +x at +z lead up through an opening in the upper one."""
    rise, tread, count = 0.17, 0.26, 16
    lower = block((-3.0, 3.0), (-2.0, 2.0), 0.0)
    upper = [block((-3.0, 3.0), (-2.0, 0.8), 2.72, 2.52), block((1.6, 3.0), (0.8, 2.0), 2.72, 2.52)]
    flight = [block((-2.56 + k * tread, 1.7), (0.8, 2.0), (k + 1) * rise) for k in range(count if stairs else 0)]
    posts = [block((x, x + 0.1), (z, z + 0.1), 2.6) for x in (-3.0, 2.9) for z in (-2.0, -0.6)]
    return joined(lower, *upper, *flight, *posts, resolution=256)


def room(size: tuple[float, float] = (5.0, 4.0), height: float = 2.6) -> Mesh:
    """A closed room that faces inward, from the origin on."""
    box = block((0.0, size[0]), (0.0, size[1]), height, 0.0)
    return Mesh(box.vertices, box.faces[:, ::-1], "room")


def patch(side: float, y: float) -> Mesh:
    """A level square that faces up, about the middle of `room`."""
    x, z = 2.5 + side / 2 * np.array([-1.0, 1.0]), 2.0 + min(side, 3.6) / 2 * np.array([-1.0, 1.0])
    corners = np.array([(x[0], y, z[0]), (x[0], y, z[1]), (x[1], y, z[1]), (x[1], y, z[0])])
    return Mesh(corners, np.array([[0, 1, 2], [0, 2, 3]]), "patch")
