"""The trilinear interpolant of a grid: value and gradient in one pass, and its second derivative times a vector.

Points come in chunks. Finding the cells, fetching their corners and doing the sums are loops of their own: the fetches
of many points are then under way together, and most of the time goes into waiting for memory.
"""

from __future__ import annotations

import math

import numpy as np

from scenes.kernels import helper, kernel

CHUNK = 64


@helper
def _inside(local, last):
    """A coordinate moved into the grid; 0 where it is not a number."""
    return min(local, last) if local > 0.0 else 0.0


@helper
def _cell(inside, size):
    """The cell of a coordinate inside the grid."""
    return min(np.int64(inside), size - 2)


@helper
def _outward(points, p, origin, spacing, shape):
    """How far (m) a point is from the nearest point of the grid, along each axis; exactly 0 inside."""
    over = 1.0 / spacing
    x = (points[p, 0] - origin[0]) * over
    y = (points[p, 1] - origin[1]) * over
    z = (points[p, 2] - origin[2]) * over
    bx = (x - _inside(x, shape[0] - 1.0)) * spacing
    by = (y - _inside(y, shape[1] - 1.0)) * spacing
    bz = (z - _inside(z, shape[2] - 1.0)) * spacing
    return bx, by, bz


@helper
def _located(points, begin, count, origin, spacing, shape, base, share):
    """Flat index of each point's cell and where in it the point lies; which points are outside; are there any?"""
    over = 1.0 / spacing
    last = (shape[0] - 1.0, shape[1] - 1.0, shape[2] - 1.0)
    any_outside = False
    for i in range(count):
        x = (points[begin + i, 0] - origin[0]) * over
        y = (points[begin + i, 1] - origin[1]) * over
        z = (points[begin + i, 2] - origin[2]) * over
        kx, ky, kz = _inside(x, last[0]), _inside(y, last[1]), _inside(z, last[2])
        any_outside |= not (kx == x and ky == y and kz == z)
        cx, cy, cz = _cell(kx, shape[0]), _cell(ky, shape[1]), _cell(kz, shape[2])
        base[i] = (cx * shape[1] + cy) * shape[2] + cz
        share[0, i], share[1, i], share[2, i] = kx - cx, ky - cy, kz - cz
    return any_outside


@helper
def _fetched(values, base, count, rows, depth, corners):
    """Values at the corners of cells, in the order (x, y, z) = 000 001 010 ... 111."""
    plane = rows * depth
    for i in range(count):
        at = base[i]
        corners[0, i], corners[1, i] = values[at], values[at + 1]
        corners[2, i], corners[3, i] = values[at + depth], values[at + depth + 1]
        corners[4, i], corners[5, i] = values[at + plane], values[at + plane + 1]
        corners[6, i], corners[7, i] = values[at + plane + depth], values[at + plane + depth + 1]


@kernel
def interpolated(values, shape, origin, spacing, beyond, points, begin, end, value, gradient):
    """Value of points ``begin .. end``, and their gradient where `gradient` holds as many rows as `points`.

    Args:
        values: of all nodes, flat.
        shape: nodes along x, y, z.
        origin: of node 0, double.
        spacing: metres a voxel.
        beyond: sign of the distance that is added outside.
        points: ``[n, 3]``; `value` ``[n]`` and `gradient` ``[n, 3]`` have their precision.
    """
    base = np.empty(CHUNK, np.int64)
    share = np.empty((3, CHUNK), points.dtype)
    corners = np.empty((8, CHUNK), points.dtype)
    slopes = len(gradient) > 0
    scale = np.empty(1, points.dtype)
    scale[0] = 1.0 / spacing
    over = scale[0]
    for first in range(begin, end, CHUNK):
        count = min(CHUNK, end - first)
        outside = _located(points, first, count, origin, spacing, shape, base, share)
        _fetched(values, base, count, shape[1], shape[2], corners)
        for i in range(count):
            x, y, z = share[0, i], share[1, i], share[2, i]
            z0, z1 = corners[1, i] - corners[0, i], corners[3, i] - corners[2, i]
            z2, z3 = corners[5, i] - corners[4, i], corners[7, i] - corners[6, i]
            f0, f1 = corners[0, i] + z0 * z, corners[2, i] + z1 * z
            f2, f3 = corners[4, i] + z2 * z, corners[6, i] + z3 * z
            y0, y1 = f1 - f0, f3 - f2
            line = f0 + y0 * y
            dx = f2 + y1 * y - line
            value[first + i] = line + dx * x
            if slopes:
                gradient[first + i, 0] = dx * over
                gradient[first + i, 1] = (y0 + (y1 - y0) * x) * over
                near, far = z0 + (z1 - z0) * y, z2 + (z3 - z2) * y
                gradient[first + i, 2] = (near + (far - near) * x) * over
        if outside:
            for p in range(first, first + count):
                _leave(points, p, origin, spacing, shape, beyond, value, gradient, slopes)


@helper
def _leave(points, p, origin, spacing, shape, beyond, value, gradient, slopes):
    """Add the way from the grid to a point outside; along axes on which it was moved, only that way changes."""
    bx, by, bz = _outward(points, p, origin, spacing, shape)
    away = math.sqrt(bx * bx + by * by + bz * bz)
    if away == 0.0:
        return
    value[p] += beyond * away
    if slopes:
        gradient[p, 0] = beyond * bx / away if bx != 0.0 else gradient[p, 0]
        gradient[p, 1] = beyond * by / away if by != 0.0 else gradient[p, 1]
        gradient[p, 2] = beyond * bz / away if bz != 0.0 else gradient[p, 2]


@kernel
def curved(values, shape, origin, spacing, beyond, points, vectors, begin, end, product):
    """Second derivative of the interpolant at points ``begin .. end``, times a vector each.

    Inside a cell only the mixed derivatives are not zero; outside, the distance to the grid curves along the axes on
    which a point was moved.
    """
    base = np.empty(CHUNK, np.int64)
    share = np.empty((3, CHUNK), np.float64)
    c = np.empty((8, CHUNK), np.float64)
    over = 1.0 / (spacing * spacing)
    for first in range(begin, end, CHUNK):
        count = min(CHUNK, end - first)
        _located(points, first, count, origin, spacing, shape, base, share)
        _fetched(values, base, count, shape[1], shape[2], c)
        for i in range(count):
            p = first + i
            x, y, z = share[0, i], share[1, i], share[2, i]
            low, high = c[6, i] - c[4, i] - c[2, i] + c[0, i], c[7, i] - c[5, i] - c[3, i] + c[1, i]
            xy = (low + (high - low) * z) * over
            low, high = c[5, i] - c[4, i] - c[1, i] + c[0, i], c[7, i] - c[6, i] - c[3, i] + c[2, i]
            xz = (low + (high - low) * y) * over
            low, high = c[3, i] - c[2, i] - c[1, i] + c[0, i], c[7, i] - c[6, i] - c[5, i] + c[4, i]
            yz = (low + (high - low) * x) * over
            bx, by, bz = _outward(points, p, origin, spacing, shape)
            kx, ky, kz = float(bx == 0.0), float(by == 0.0), float(bz == 0.0)
            vx, vy, vz = vectors[p, 0], vectors[p, 1], vectors[p, 2]
            px = kx * (ky * xy * vy + kz * xz * vz)
            py = ky * (kx * xy * vx + kz * yz * vz)
            pz = kz * (kx * xz * vx + ky * yz * vy)
            away = math.sqrt(bx * bx + by * by + bz * bz)
            if not away == 0.0:
                bx, by, bz = bx / away, by / away, bz / away
                along = bx * vx + by * vy + bz * vz
                px += beyond * (1.0 - kx) * (vx - along * bx) / away
                py += beyond * (1.0 - ky) * (vy - along * by) / away
                pz += beyond * (1.0 - kz) * (vz - along * bz) / away
            product[p, 0], product[p, 1], product[p, 2] = px, py, pz
