"""Beyond the band: the nearest node beside a surface, exactly, and from it a triangle to measure.

The feature transform is separable (Felzenszwalb and Huttenlocher, "Distance transforms of sampled functions", 2012):
along z the nearest seed of a row, then along y and along x the lower envelope of parabolas.
"""

from __future__ import annotations

import numpy as np

from scenes.kernels import helper, kernel
from scenes.kernels.triangles import framed, planar_squared

SEED = 0.7501
"""Squared distance (voxels²) up to which a node is a seed: every point of a surface has one within sqrt(3) / 2."""


@helper
def _nearest_in_row(row, out):
    """The seed nearest to each node of one row along z, or -1 without any; the lower of two."""
    last = -1
    for z in range(len(row)):
        if row[z] <= SEED:
            last = z
        out[z] = last
    last = -1
    for z in range(len(row) - 1, -1, -1):
        if row[z] <= SEED:
            last = z
        if last >= 0 and (out[z] < 0 or last - z < z - out[z]):
            out[z] = last


@helper
def envelope(height, count, site, start):
    """Lower envelope of ``height[i] + (q - i)²`` over q: sites and where each begins; returns how many.

    ``height`` is negative where there is no parabola. Site m is the lowest for ``start[m] <= q < start[m + 1]``.
    """
    top = -1
    for q in range(count):
        if height[q] < 0:
            continue
        lift = float(height[q]) + float(q) * q
        begin = -1e30
        while top >= 0:
            p = site[top]
            begin = (lift - float(height[p]) - float(p) * p) / (2.0 * (q - p))
            if begin > start[top]:
                break
            top -= 1
        top += 1
        site[top] = q
        start[top] = begin if top > 0 else -1e30
    start[top + 1] = 1e30
    return top + 1


@kernel
def seeds_in_plane(squared, x, nearest):
    """Replace the seeds' numbers in plane x of `nearest` by that of the plane's nearest seed at each of its nodes.

    -1 where the plane has none.
    """
    rows, depth = squared.shape[1], squared.shape[2]
    along = np.empty((rows, depth), np.int32)
    empty = True
    for y in range(rows):
        _nearest_in_row(squared[x, y], along[y])
        empty &= along[y, 0] < 0
    if empty:
        nearest[x] = -1
        return
    number = nearest[x].copy()
    height = np.empty(rows, np.int64)
    site = np.empty(rows, np.int64)
    start = np.empty(rows + 1, np.float64)
    for z in range(depth):
        for y in range(rows):
            away = along[y, z] - z
            height[y] = away * away if along[y, z] >= 0 else -1
        count = envelope(height, rows, site, start)
        m = 0
        for y in range(rows):
            while m + 1 < count and start[m + 1] < y:
                m += 1
            nearest[x, y, z] = number[site[m], along[site[m], z]]


@kernel
def nearest_triangles(nearest, place, triangle, y, far):
    """Fill ``far[X, Z]`` with the triangle of the seed nearest to each node of plane y.

    Args are the output of `seeds_in_plane` for all planes, and of `numbered`.
    """
    planes, depth = nearest.shape[0], nearest.shape[2]
    slab = nearest[:, y, :].copy()
    height = np.empty(planes, np.int64)
    site = np.empty(planes, np.int64)
    start = np.empty(planes + 1, np.float64)
    for z in range(depth):
        for x in range(planes):
            seed = slab[x, z]
            if seed >= 0:
                dy, dz = (place[seed] >> 16) - y, (place[seed] & 0xFFFF) - z
                height[x] = dy * dy + dz * dz
            else:
                height[x] = -1
        count = envelope(height, planes, site, start)
        m = 0
        for x in range(planes):
            while m + 1 < count and start[m + 1] < x:
                m += 1
            far[x, z] = triangle[slab[site[m], z]]


@kernel
def numbered(squared, nearest, triangles):
    """Number the seeds, in place of their triangles in `nearest`.

    Returns:
        place of each seed in its plane, ``y << 16 | z``; its triangle, as a place in the list that follows; and the
        triangles that are nearest to any seed.
    """
    listed = np.full(triangles, -1, np.int32)
    used = np.empty(triangles, np.int32)
    count, seeds = 0, 0
    planes, rows, depth = squared.shape
    d = squared.reshape(-1)
    for node in range(len(d)):
        seeds += d[node] <= SEED
    place, triangle = np.empty(seeds, np.int32), np.empty(seeds, np.int32)
    seed = 0
    for x in range(planes):
        for y in range(rows):
            for z in range(depth):
                if squared[x, y, z] <= SEED:
                    f = nearest[x, y, z]
                    if listed[f] < 0:
                        listed[f] = count
                        used[count] = f
                        count += 1
                    place[seed], triangle[seed] = y << 16 | z, listed[f]
                    nearest[x, y, z] = seed
                    seed += 1
    return place, triangle, used[:count].copy()


@kernel
def records(vertices, faces, used, out):
    """Frames of some triangles as rows of 16 single-precision numbers, one cache line each."""
    for at in range(len(used)):
        frame = framed(vertices, faces, used[at])
        for k in range(9):
            out[at, k] = frame[k]
        for k in range(9, 14):  # all but the normal
            out[at, k] = frame[k + 3]


@helper
def to_record(record, f, x, y, z):
    """Squared distance from a node to the triangle of a record, in single precision."""
    at = f * 16
    dx, dy, dz = x - record[at], y - record[at + 1], z - record[at + 2]
    ux, uy, uz = record[at + 3], record[at + 4], record[at + 5]
    vx, vy, vz = record[at + 6], record[at + 7], record[at + 8]
    u = dx * ux + dy * uy + dz * uz
    v = dx * vx + dy * vy + dz * vz
    # Not |d|^2 - u^2 - v^2, which would lose the height above a large triangle.
    n = dx * (uy * vz - uz * vy) + dy * (uz * vx - ux * vz) + dz * (ux * vy - uy * vx)
    flat = planar_squared(
        u, v, record[at + 9], record[at + 10], record[at + 11], record[at + 12], record[at + 13], np.float32(1.0)
    )
    return n * n + flat


@kernel
def measured(record, y, band, far, squared):
    """Distances to the triangles `far` on the nodes of plane y beyond `band`.

    Where the triangle of the node one step along -x is nearer than a node's own, it is handed on in `far`: seeds are
    nearest to a node, not their triangles, and this mends a third of the difference.
    """
    fy = np.float32(y)
    for x in range(far.shape[0]):
        row, ids = squared[x, y], far[x]
        fx = np.float32(x)
        for z in range(len(row)):
            d = to_record(record, np.int64(ids[z]), fx, fy, np.float32(z))
            row[z] = d if row[z] > band else row[z]
        before = far[max(x - 1, 0)]
        for z in range(len(row)):
            if row[z] > band and before[z] != ids[z]:
                d = to_record(record, np.int64(before[z]), fx, fy, np.float32(z))
                if d < row[z]:
                    row[z], ids[z] = d, before[z]
