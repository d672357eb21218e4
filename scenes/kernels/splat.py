"""Triangles into the narrow band: exact squared distances and the nearest triangle around every surface."""

from __future__ import annotations

import math

import numpy as np

from scenes.kernels import helper, kernel
from scenes.kernels.triangles import framed, planar_squared

LANES = 8
"""Nodes of a piece of a row."""

ROWS = 64
"""Pieces that are measured together."""

_V, _N, _D, _C = (k * ROWS * LANES for k in range(1, 5))  # where in the scratch: v, normal, distance, constants

SMALL = 16.0
"""Voxels up to which single precision, around a corner of the triangle, is as good as what is stored."""


@kernel
def binned(vertices, faces, axis, reach, thickness, slabs):
    """Which triangles come within `reach` of each slab of nodes: offsets ``[slabs + 1]`` and triangles, ascending."""
    offsets = np.zeros(slabs + 1, np.int64)
    first = np.empty(len(faces), np.int32)
    last = np.empty(len(faces), np.int32)
    for f in range(len(faces)):
        a, b, c = vertices[faces[f, 0], axis], vertices[faces[f, 1], axis], vertices[faces[f, 2], axis]
        low = max(math.ceil(min(a, b, c) - reach), 0)
        high = min(math.floor(max(a, b, c) + reach), slabs * thickness - 1)
        first[f], last[f] = low // thickness, (high // thickness if high >= low else low // thickness - 1)
        for slab in range(first[f], last[f] + 1):
            offsets[slab + 1] += 1
    for slab in range(slabs):
        offsets[slab + 1] += offsets[slab]
    free = offsets[:-1].copy()
    members = np.empty(offsets[-1], np.int32)
    for f in range(len(faces)):
        for slab in range(first[f], last[f] + 1):
            members[free[slab]] = f
            free[slab] += 1
    return offsets, members


@kernel
def splat(vertices, faces, members, reach, begin, end, squared, nearest):
    """Lower `squared` (voxels²) and set `nearest` on the nodes of planes ``begin <= x < end`` near some triangles.

    Small triangles are measured in single precision around a corner of their own, which loses nothing that could be
    stored; large ones in double. Equal distances keep the triangle of the lowest index.
    """
    place = np.empty((ROWS, 4), np.int64)
    scratch32, scratch64 = np.empty(5 * ROWS * LANES, np.float32), np.empty(5 * ROWS * LANES, np.float64)
    for member in range(len(members)):
        f = members[member]
        low, high = _box(vertices, faces, f, reach, begin, end, squared.shape)
        frame = framed(vertices, faces, f)
        if frame[12] < SMALL:
            _near(frame, f, low, high, reach, squared, nearest, place, scratch32, np.float32(1.0))
        else:
            _near(frame, f, low, high, reach, squared, nearest, place, scratch64, 1.0)


@helper
def _box(vertices, faces, f, reach, begin, end, shape):
    """First and last node along each axis that a triangle comes near."""
    i, j, k = faces[f, 0], faces[f, 1], faces[f, 2]
    low_x = max(math.ceil(min(vertices[i, 0], vertices[j, 0], vertices[k, 0]) - reach), begin)
    high_x = min(math.floor(max(vertices[i, 0], vertices[j, 0], vertices[k, 0]) + reach), end - 1)
    low_y = max(math.ceil(min(vertices[i, 1], vertices[j, 1], vertices[k, 1]) - reach), 0)
    high_y = min(math.floor(max(vertices[i, 1], vertices[j, 1], vertices[k, 1]) + reach), shape[1] - 1)
    low_z = max(math.ceil(min(vertices[i, 2], vertices[j, 2], vertices[k, 2]) - reach), 0)
    high_z = min(math.floor(max(vertices[i, 2], vertices[j, 2], vertices[k, 2]) + reach), shape[2] - 1)
    return (low_x, low_y, low_z), (high_x, high_y, high_z)


@helper
def _near(frame, f, low, high, reach, squared, nearest, place, s, one):
    """The nodes of a box that lie near a triangle, in the precision of `one`.

    A row along z is cut to where the triangle's plane comes within `reach`, and left out where the ball around it does
    not. Pieces of rows are gathered and measured together: only a long loop becomes vector instructions.
    """
    ax, ay, az, ux, uy, uz, vx, vy, vz, nx, ny, nz, length, cx, cy, _, _ = frame
    ball = reach + max(length / 2.0, math.sqrt((cx - length / 2.0) ** 2 + cy * cy))
    middle_x, middle_y = ax + ux * length / 2.0, ay + uy * length / 2.0
    steep = abs(nz) > 1e-3
    inverse = 1.0 / nz if steep else 0.0
    half = reach * abs(inverse)
    count = 0
    for x in range(low[0], high[0] + 1):
        for y in range(low[1], high[1] + 1):
            if (x - middle_x) ** 2 + (y - middle_y) ** 2 > ball * ball:
                continue
            dx, dy = x - ax, y - ay
            first, last = low[2], high[2]
            if steep:
                middle = az - (dx * nx + dy * ny) * inverse
                first = max(first, math.ceil(middle - half))
                last = min(last, math.floor(middle + half))
            elif abs(dx * nx + dy * ny) > reach + 1e-3 * (abs(low[2] - az) + abs(high[2] - az)):
                continue
            for start in range(first, last + 1, LANES):
                at = count * LANES
                for lane in range(LANES):  # always whole pieces: nodes beyond `last` are dropped
                    dz = start + lane - az
                    s[at + lane] = dx * ux + dy * uy + dz * uz
                    s[_V + at + lane] = dx * vx + dy * vy + dz * vz
                    s[_N + at + lane] = dx * nx + dy * ny + dz * nz
                place[count, 0], place[count, 1], place[count, 2] = x, y, start
                place[count, 3] = min(LANES, last + 1 - start)
                count += 1
                if count == ROWS:
                    _lowered(frame, f, count, squared, nearest, place, s, one)
                    count = 0
    _lowered(frame, f, count, squared, nearest, place, s, one)


@helper
def _lowered(frame, f, count, squared, nearest, place, s, one):
    """Measure the gathered pieces of rows and keep what is nearer."""
    s[_C], s[_C + 1], s[_C + 2], s[_C + 3], s[_C + 4] = frame[12], frame[13], frame[14], frame[15], frame[16]
    length, cx, cy, over_ac, over_bc = s[_C], s[_C + 1], s[_C + 2], s[_C + 3], s[_C + 4]
    for at in range(count * LANES):
        flat = planar_squared(s[at], s[_V + at], length, cx, cy, over_ac, over_bc, one)
        s[_D + at] = s[_N + at] * s[_N + at] + flat
    for piece in range(count):
        x, y, start = place[piece, 0], place[piece, 1], place[piece, 2]
        row, ids = squared[x, y], nearest[x, y]
        for lane in range(place[piece, 3]):
            d = s[_D + piece * LANES + lane]
            if d < row[start + lane]:
                row[start + lane] = d
                ids[start + lane] = f
