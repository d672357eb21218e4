"""The trilinear interpolant of a grid: value and gradient in one pass.

Points come in chunks, and what is known of a chunk lies in rows of `CHUNK` numbers: each step is a loop over whole rows
that the compiler turns into vector instructions, and the fetches of many points are under way together. Indices that
are computed are unsigned: signed ones may count from the end in numba, and asking for that stops the vectors.
"""

from __future__ import annotations

import math

import numpy as np

from scenes.kernels import helper, kernel

CHUNK = 256

_X, _Y, _Z = 0, CHUNK, 2 * CHUNK  # where in its voxel a point lies
_CORNERS = 3 * CHUNK  # four rows of pairs along z, at (x, y) = 00 01 10 11: twice as long as the others
_VALUE, _DX, _DY, _DZ = 11 * CHUNK, 12 * CHUNK, 13 * CHUNK, 14 * CHUNK
_ROWS = 15 * CHUNK


@helper
def trilinear(v, i, j, k, s, x, y, z):
    """Between the nodes of `v` at (i, j, k) and those `s` further on."""
    a = v[i, j, k] + (v[i, j, k + s] - v[i, j, k]) * z
    b = v[i, j + s, k] + (v[i, j + s, k + s] - v[i, j + s, k]) * z
    c = v[i + s, j, k] + (v[i + s, j, k + s] - v[i + s, j, k]) * z
    d = v[i + s, j + s, k] + (v[i + s, j + s, k + s] - v[i + s, j + s, k]) * z
    e = a + (b - a) * y
    return e + (c + (d - c) * y - e) * x


@helper
def left(v, squared, beyond):
    """Value outside a grid, from the value `v` at the nearest point of its border, and what gradients there take.

    No surface is within `margin` of the border. Where all is free outside, b leads from the point q of the grid nearest
    to p to p itself: along an axis with b != 0 any point s of a surface is `margin` behind q or more, and along the
    others b is 0. So |p - s|^2 = |q - s|^2 + |b|^2 - 2 b (s - q) >= v^2 + |b|^2 + 2 margin (|b_x| + |b_y| + |b_z|): the
    root of that is what p is away at least. From a border that is solid, and where all outside is, it is what falls
    fastest of all distances: v + |b|, and v - |b|; there the margin counts as 0.

    Args:
        squared: |b|^2 + 2 margin (|b_x| + |b_y| + |b_z|).

    Returns:
        the value; its derivative by b, over b and `margin` in its direction; its derivative by `v`.
    """
    zero = v - v
    one = zero + 1
    free = v if v > zero and beyond > zero else zero
    r = math.sqrt(squared + free * free)
    return v - free + beyond * r, beyond / (r if r > zero else one), free / r if free > zero else one


@helper
def _located(local, axis, size, places, voxel, share):
    """Number of each point's voxel and where in it the point lies, along one axis; `local` becomes what lies outside.

    The axis has `size` nodes, and `places` for them in memory.
    What is not a number lies in voxel 0, and stays what it is in `local`.
    """
    edge, across = np.int32(size - 2), np.int32(places)
    last = share.dtype.type(size - 1)
    zero = last - last
    row = axis * CHUNK
    for i in range(CHUNK):
        x = local[row + i]
        inside = x if x > zero else zero
        inside = inside if inside < last else last
        cell = min(np.int32(inside), edge)
        voxel[i] = voxel[i] * across + cell
        share[row + i] = inside - share.dtype.type(cell)
        local[row + i] = x - inside


@helper
def _prepared(points, begin, count, shape, origin, over, local, voxel, share):
    """Locate points ``begin .. begin + count``; True where any of them is outside.

    The origin is taken off in double, so that nothing is lost far from the world's.
    """
    ox, oy, oz = origin[0], origin[1], origin[2]
    for i in range(count):
        at = np.uint64(begin + i) * np.uint64(3)
        local[i] = (points[at] - ox) * over
        local[CHUNK + i] = (points[at + np.uint64(1)] - oy) * over
        local[2 * CHUNK + i] = (points[at + np.uint64(2)] - oz) * over
    voxel[:] = 0
    _located(local, 0, shape[0], shape[0], voxel, share)
    _located(local, 1, shape[1], shape[1], voxel, share)
    _located(local, 2, shape[2], shape[3], voxel, share)
    outside = 0
    for i in range(3 * CHUNK):
        outside += np.int64(local[i] != 0.0)
    return outside > 0


@helper
def _fetched(values, voxel, count, rows, depth, into):
    """Values at the corners of voxels: of neighbours along z together, which the compiler then moves as one."""
    one, y, x = np.uint64(1), np.uint64(depth), np.uint64(rows * depth)
    for i in range(count):
        at, to = np.uint64(voxel[i]), _CORNERS + 2 * i
        into[to], into[to + 1] = values[at], values[at + one]
        at, to = at + y, to + 2 * CHUNK
        into[to], into[to + 1] = values[at], values[at + one]
        at, to = at + x, to + 4 * CHUNK
        into[to], into[to + 1] = values[at], values[at + one]
        at, to = at - y, to - 2 * CHUNK
        into[to], into[to + 1] = values[at], values[at + one]


@helper
def _summed(s, over):
    """Collapse z, then y, then x; the differences met on the way are the partial derivatives."""
    for i in range(CHUNK):
        x, y, z = s[_X + i], s[_Y + i], s[_Z + i]
        c = _CORNERS + 2 * i
        c0, c2, c4, c6 = s[c], s[c + 2 * CHUNK], s[c + 4 * CHUNK], s[c + 6 * CHUNK]
        z0, z1 = s[c + 1] - c0, s[c + 2 * CHUNK + 1] - c2
        z2, z3 = s[c + 4 * CHUNK + 1] - c4, s[c + 6 * CHUNK + 1] - c6
        f0, f1 = c0 + z0 * z, c2 + z1 * z
        f2, f3 = c4 + z2 * z, c6 + z3 * z
        y0, y1 = f1 - f0, f3 - f2
        line = f0 + y0 * y
        dx = f2 + y1 * y - line
        near, far = z0 + (z1 - z0) * y, z2 + (z3 - z2) * y
        s[_VALUE + i] = line + dx * x
        s[_DX + i] = dx * over
        s[_DY + i] = (y0 + (y1 - y0) * x) * over
        s[_DZ + i] = (near + (far - near) * x) * over


@kernel
def interpolated(values, shape, origin, spacing, beyond, margin, points, begin, end, value, gradient):
    """Value of points ``begin .. end``, and their gradient unless `gradient` is empty.

    Args:
        values: of all nodes, flat; behind each row along z there may be numbers that mean nothing.
        shape: nodes along x, y, z, and numbers in a row along z.
        origin: of node 0, double.
        spacing: metres a voxel.
        beyond, margin: sign of the distance far outside, and metres from the border to any surface; see `left`.
        points: x, y, z of one after the other, ``[n, 3]`` in one piece; `value` ``[n]`` and `gradient` ``[n, 3]``,
            or empty, have their precision.
    """
    points, gradient = points.reshape(-1), gradient.reshape(-1)  # flat, so that the strides are constants
    voxel, local = np.zeros(CHUNK, np.int32), np.zeros(3 * CHUNK, points.dtype)
    scratch = np.zeros(_ROWS, points.dtype)
    scratch[0] = 1.0 / spacing
    over = scratch[0]  # in the precision of the points
    for first in range(begin, end, CHUNK):
        count = min(CHUNK, end - first)
        outside = _prepared(points, first, count, shape, origin, 1.0 / spacing, local, voxel, scratch)
        _fetched(values, voxel, count, shape[1], shape[3], scratch)
        _summed(scratch, over)
        if outside:
            kind = scratch.dtype.type
            _leave(local, kind(spacing), kind(beyond), kind(margin), scratch)
        for i in range(count):
            value[first + i] = scratch[_VALUE + i]
        if len(gradient) > 0:
            for i in range(count):
                at = np.uint64(first + i) * np.uint64(3)
                gradient[at] = scratch[_DX + i]
                gradient[at + np.uint64(1)] = scratch[_DY + i]
                gradient[at + np.uint64(2)] = scratch[_DZ + i]


@helper
def _leave(local, spacing, beyond, margin, s):
    """Lead the values at the border on to points outside; along axes on which one was moved, only that way changes.

    Without a branch, for all of a chunk: few of its points are outside, and branches on that would be mispredicted.
    """
    zero, one = s.dtype.type(0), s.dtype.type(1)
    for i in range(CHUNK):
        bx, by, bz = local[i] * spacing, local[CHUNK + i] * spacing, local[2 * CHUNK + i] * spacing
        squared = bx * bx + by * by + bz * bz + 2 * margin * (abs(bx) + abs(by) + abs(bz))
        value, turn, share = left(s[_VALUE + i], squared, beyond)
        s[_VALUE + i] = value if squared != zero else s[_VALUE + i]
        share = share if squared != zero else one
        dx, dy, dz = s[_DX + i] * share, s[_DY + i] * share, s[_DZ + i] * share
        s[_DX + i] = (bx + math.copysign(margin, bx)) * turn if bx != zero else dx
        s[_DY + i] = (by + math.copysign(margin, by)) * turn if by != zero else dy
        s[_DZ + i] = (bz + math.copysign(margin, bz)) * turn if bz != zero else dz
