"""One grid as the minimum of several objects: what an object adds to it, and what is left where it goes.

An object is measured in the frame of its own window, wherever its distances are asked for, so that the same node gets
the same bits whichever box it is part of. Numbers of objects start at 1; 0 stands for none.
"""

from __future__ import annotations

import math

import numpy as np

from scenes.kernels import kernel
from scenes.kernels.feature import envelope, to_record

REACH = 0.868
"""Voxels from any point of a surface to its nearest seed, at most: sqrt(0.7501) and a margin for single precision."""


@kernel
def merged(own, number, values, owner):
    """Lower `values` to an object's `own`, and note it as `owner` where it is strictly lower."""
    for x in range(own.shape[0]):
        for y in range(own.shape[1]):
            for z in range(own.shape[2]):
                d = own[x, y, z] + np.float32(0.0)  # -0 becomes 0: the minimum must not depend on the order
                if d < values[x, y, z]:
                    values[x, y, z] = d
                    owner[x, y, z] = number


@kernel
def released(number, values, owner):
    """Forget an object: its nodes become infinite and belong to none."""
    for x in range(owner.shape[0]):
        for y in range(owner.shape[1]):
            for z in range(owner.shape[2]):
                if owner[x, y, z] == number:
                    owner[x, y, z] = 0
                    values[x, y, z] = np.inf


@kernel
def extent(number, owner):
    """First index, and the one after the last, of an object's nodes along each axis; first > last without any."""
    low = np.array(owner.shape)
    high = np.zeros(3, np.int64)
    for x in range(owner.shape[0]):
        for y in range(owner.shape[1]):
            for z in range(owner.shape[2]):
                if owner[x, y, z] == number:
                    low[0], high[0] = min(low[0], x), max(high[0], x + 1)
                    low[1], high[1] = min(low[1], y), max(high[1], y + 1)
                    low[2], high[2] = min(low[2], z), max(high[2], z + 1)
    return low, high


@kernel
def highest(values, edge, tx, top):
    """Highest value in each of the tiles ``top[tx]``, cubes of `edge` nodes."""
    line = np.empty(values.shape[2], np.float32)
    for ty in range(top.shape[1]):
        line[:] = -np.inf
        for x in range(tx * edge, min((tx + 1) * edge, values.shape[0])):
            for y in range(ty * edge, min((ty + 1) * edge, values.shape[1])):
                row = values[x, y]
                for z in range(len(line)):
                    line[z] = row[z] if row[z] > line[z] else line[z]
        top[tx, ty] = -np.inf
        for z in range(len(line)):
            top[tx, ty, z // edge] = max(top[tx, ty, z // edge], line[z])


@kernel
def along_rows(seed, x, first, out):
    """The seed nearest along z, for every row of plane x and every ``z = first + k``: ``out[x, y, k]``, or -1.

    ``seed[X, Y, Z]`` numbers the seeds of a window and is -1 elsewhere; z may lie outside it. Of two, the lower.
    """
    depth = seed.shape[2]
    held = np.empty(depth, np.int64)
    for y in range(seed.shape[1]):
        count = 0
        for z in range(depth):
            if seed[x, y, z] >= 0:
                held[count] = z
                count += 1
        if count == 0:
            out[x, y] = -1
            continue
        m = 0
        for k in range(out.shape[2]):
            z = first + k
            while m + 1 < count and abs(held[m + 1] - z) < abs(held[m] - z):
                m += 1
            out[x, y, k] = seed[x, y, held[m]]


@kernel
def in_planes(along, place, x, first_y, first_z, out):
    """The seed nearest within plane x, for every ``y = first_y + j``: ``out[x, j, k]``, or -1 without any."""
    rows = along.shape[1]
    height = np.empty(rows, np.int64)
    site = np.empty(rows, np.int64)
    start = np.empty(rows + 1, np.float64)
    for k in range(out.shape[2]):
        z = first_z + k
        for y in range(rows):
            seed = along[x, y, k]
            away = (place[seed] & 0xFFFF) - z if seed >= 0 else 0
            height[y] = away * away if seed >= 0 else -1
        count = envelope(height, rows, site, start)
        m = 0
        for j in range(out.shape[1]):
            if count == 0:
                out[x, j, k] = -1
                continue
            while m + 1 < count and start[m + 1] < first_y + j:
                m += 1
            out[x, j, k] = along[x, site[m], k]


@kernel
def lowered(near, place, triangle, record, j, first, core, scale, number, values, owner):
    """Lower plane j of a box, ``values[:, j]``, to an object's distances, and note it as `owner` there.

    Args:
        near: of `in_planes`.
        place, triangle: of `numbered`.
        record: of `records`, flat.
        first: the box's first node in the frame of the object's window, 3 integers.
        core: nodes of that window along each axis; those within it are left alone.
        scale: metres a voxel; negative where the space around the object is solid.
    """
    planes, breadth, depth = near.shape[0], values.shape[0], values.shape[2]
    far = np.empty((breadth, depth), np.int32)
    away = np.empty((breadth, depth), np.int64)
    height = np.empty(planes, np.int64)
    site = np.empty(planes, np.int64)
    start = np.empty(planes + 1, np.float64)
    y = first[1] + j
    for k in range(depth):
        z = first[2] + k
        for x in range(planes):
            seed = near[x, j, k]
            dy, dz = (place[seed] >> 16) - y, (place[seed] & 0xFFFF) - z
            height[x] = dy * dy + dz * dz if seed >= 0 else -1
        count = envelope(height, planes, site, start)
        m = 0
        for i in range(breadth):
            x = first[0] + i
            while m + 1 < count and start[m + 1] < x:
                m += 1
            far[i, k] = near[site[m], j, k]
            away[i, k] = height[site[m]] + (x - site[m]) * (x - site[m])
    level = 0 <= y < core[1]
    for i in range(breadth):
        x = first[0] + i
        within = level and 0 <= x < core[0]
        for k in range(depth):
            z = first[2] + k
            if within and 0 <= z < core[2]:
                continue
            if scale > 0 and (math.sqrt(away[i, k]) - REACH) * scale > values[i, j, k]:
                continue  # its triangles are further away than what is there
            squared = to_record(record, np.int64(triangle[far[i, k]]), np.float32(x), np.float32(y), np.float32(z))
            d = np.float32(math.sqrt(squared)) * np.float32(scale)
            if d < values[i, j, k]:
                values[i, j, k] = d
                owner[i, j, k] = number
