"""Triangles into the narrow band: exact squared distances and the nearest triangle around every surface."""

from __future__ import annotations

import math

import numpy as np

from scenes.kernels import kernel
from scenes.kernels.triangles import framed, planar_squared

LANES = 8
"""Nodes measured together: a vector of double precision."""


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

    A row of nodes is cut to where the triangle's plane and bounding box come within `reach`; equal distances keep the
    triangle of the lowest index.
    """
    height, depth = squared.shape[1], squared.shape[2]
    found = np.empty(LANES)
    for member in range(len(members)):
        f = members[member]
        i, j, k = faces[f, 0], faces[f, 1], faces[f, 2]
        low_x = max(math.ceil(min(vertices[i, 0], vertices[j, 0], vertices[k, 0]) - reach), begin)
        high_x = min(math.floor(max(vertices[i, 0], vertices[j, 0], vertices[k, 0]) + reach), end - 1)
        low_y = max(math.ceil(min(vertices[i, 1], vertices[j, 1], vertices[k, 1]) - reach), 0)
        high_y = min(math.floor(max(vertices[i, 1], vertices[j, 1], vertices[k, 1]) + reach), height - 1)
        low = max(math.ceil(min(vertices[i, 2], vertices[j, 2], vertices[k, 2]) - reach), 0)
        high = min(math.floor(max(vertices[i, 2], vertices[j, 2], vertices[k, 2]) + reach), depth - 1)
        ax, ay, az, ux, uy, uz, vx, vy, vz, nx, ny, nz, length, cx, cy, over_ac, over_bc = framed(vertices, faces, f)
        steep = abs(nz) > 1e-3
        inverse = 1.0 / nz if steep else 0.0
        half = reach * abs(inverse)
        for x in range(low_x, high_x + 1):
            for y in range(low_y, high_y + 1):
                dx, dy = x - ax, y - ay
                first, last = low, high
                if steep:
                    middle = az - (dx * nx + dy * ny) * inverse
                    first = max(first, math.ceil(middle - half))
                    last = min(last, math.floor(middle + half))
                elif abs(dx * nx + dy * ny) > reach + 1e-3 * (abs(low - az) + abs(high - az)):
                    continue
                n0, u0, v0 = dx * nx + dy * ny - az * nz, dx * ux + dy * uy - az * uz, dx * vx + dy * vy - az * vz
                row, ids = squared[x, y], nearest[x, y]
                for start in range(first, last + 1, LANES):
                    for lane in range(LANES):  # always whole vectors: those beyond `last` cost nothing and are dropped
                        z = float(start + lane)
                        n = n0 + z * nz
                        flat = planar_squared(u0 + z * uz, v0 + z * vz, length, cx, cy, over_ac, over_bc, 1.0)
                        found[lane] = n * n + flat
                    for lane in range(min(LANES, last + 1 - start)):
                        if found[lane] < row[start + lane]:
                            row[start + lane] = found[lane]
                            ids[start + lane] = f
