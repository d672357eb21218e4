"""One triangle and one point.

A triangle is brought into a frame of its own: corner A at the origin, the longest edge AB along u, C at (cx, cy) with
cy >= 0 in the plane of u and v, n the normal. Distances in that frame lose nothing on slivers, where barycentric
coordinates do, because C projects between A and B and every edge is measured as a segment.
"""

from __future__ import annotations

import math

from scenes.kernels import helper


@helper
def framed(vertices, faces, f):
    """Frame of triangle `f`: origin a, axes u, v, n, and l, cx, cy, 1 / |AC|^2, 1 / |BC|^2, as 17 numbers."""
    i, j, k = faces[f, 0], faces[f, 1], faces[f, 2]
    ab = _squared(vertices, i, j)
    bc = _squared(vertices, j, k)
    ca = _squared(vertices, k, i)
    if bc >= ab and bc >= ca:
        i, j, k = j, k, i
    elif ca >= ab:
        i, j, k = k, i, j
    ax, ay, az = vertices[i, 0], vertices[i, 1], vertices[i, 2]
    ux, uy, uz = vertices[j, 0] - ax, vertices[j, 1] - ay, vertices[j, 2] - az
    wx, wy, wz = vertices[k, 0] - ax, vertices[k, 1] - ay, vertices[k, 2] - az
    length = math.sqrt(ux * ux + uy * uy + uz * uz)
    inverse = 1.0 / length if length > 0.0 else 0.0
    ux, uy, uz = ux * inverse, uy * inverse, uz * inverse
    cx = wx * ux + wy * uy + wz * uz
    vx, vy, vz = wx - cx * ux, wy - cx * uy, wz - cx * uz
    cy = math.sqrt(vx * vx + vy * vy + vz * vz)
    if cy <= 1e-14 * length:  # nothing but rounding is left of it: any direction across AB will do
        vx, vy, vz = _across(ux, uy, uz)
        cy = 0.0
    # On slivers the first difference is mostly rounding, which need not lie across AB: a second one mends that.
    along = vx * ux + vy * uy + vz * uz
    vx, vy, vz = vx - along * ux, vy - along * uy, vz - along * uz
    size = math.sqrt(vx * vx + vy * vy + vz * vz)
    inverse = 1.0 / size if size > 0.0 else 0.0
    vx, vy, vz = vx * inverse, vy * inverse, vz * inverse
    cy = wx * vx + wy * vy + wz * vz if cy > 0.0 else 0.0
    nx, ny, nz = uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx
    ac = cx * cx + cy * cy
    bc = (cx - length) * (cx - length) + cy * cy
    return (
        ax, ay, az, ux, uy, uz, vx, vy, vz, nx, ny, nz, length, cx, cy,
        1.0 / ac if ac > 0.0 else 0.0, 1.0 / bc if bc > 0.0 else 0.0,
    )  # fmt: skip


@helper
def _across(x, y, z):
    """A direction at right angles to a unit vector, itself not of unit length."""
    if abs(x) <= abs(y) and abs(x) <= abs(z):
        return 0.0, z, -y
    if abs(y) <= abs(z):
        return -z, 0.0, x
    return y, -x, 0.0


@helper
def _squared(vertices, i, j):
    x, y, z = vertices[i, 0] - vertices[j, 0], vertices[i, 1] - vertices[j, 1], vertices[i, 2] - vertices[j, 2]
    return x * x + y * y + z * z


@helper
def planar_squared(u, v, length, cx, cy, over_ac, over_bc, one):
    """Squared distance from (u, v) to the triangle in its own plane, in the precision of `one`."""
    zero = one - one
    ex = cx - length
    w = u - length
    inside = (v >= zero) & (cx * v < cy * u) & (ex * v > cy * w)  # nothing is inside a triangle without area
    t = min(max(u, zero), length)
    best = (u - t) * (u - t) + v * v
    t = min(max((u * cx + v * cy) * over_ac, zero), one)
    du, dv = u - t * cx, v - t * cy
    best = min(best, du * du + dv * dv)
    t = min(max((w * ex + v * cy) * over_bc, zero), one)
    du, dv = w - t * ex, v - t * cy
    best = min(best, du * du + dv * dv)
    return zero if inside else best


@helper
def squared_distance(frame, x, y, z):
    """Squared distance from a point to the triangle of `frame`."""
    ax, ay, az, ux, uy, uz, vx, vy, vz, nx, ny, nz, length, cx, cy, over_ac, over_bc = frame
    dx, dy, dz = x - ax, y - ay, z - az
    n = dx * nx + dy * ny + dz * nz
    u = dx * ux + dy * uy + dz * uz
    v = dx * vx + dy * vy + dz * vz
    return n * n + planar_squared(u, v, length, cx, cy, over_ac, over_bc, 1.0)
