"""Winding numbers by counting what rays along the axes cross, exactly.

Triangles are projected along an axis and their corners snapped to multiples of a tiny fraction of a voxel, so that the
side of an edge on which a line of nodes lies is decided in whole numbers, alike for both triangles at that edge. A
line through an edge or a corner counts as moved by (e, e²), e infinitesimal. So a closed mesh has no cracks, and what a
line counts is the winding number of every node on it.
"""

from __future__ import annotations

import math

import numpy as np

from scenes.kernels import helper, kernel


def fraction_bits(longest: int) -> int:
    """Bits below the voxel for a lattice of `longest` nodes along its longest axis: products fit 62 bits."""
    return 29 - longest.bit_length()


@helper
def _side(ax, ay, bx, by, px, py):
    """Which side of the line from a to b the point p is on, never 0."""
    dx, dy = bx - ax, by - ay
    e = dx * (py - ay) - dy * (px - ax)
    if e != 0:
        return e
    return -dy if dy != 0 else dx


@kernel
def crossings(vertices, faces, members, axes, bits, begin, end, along, counts, crossed, flag):
    """Add the crossings of lines along axis ``axes[2]`` with some triangles to ``counts[a, b, c]``.

    A crossing at height c adds the direction of the triangle's normal at node ceil(c), so that minus the sum up to
    a node is the winding number there, and sets `flag` in ``crossed[a, b, ceil(c)]``. Both arrays have the axes in the
    order `axes`. Where `along` is 0 they hold the lines ``begin <= a < end`` only, else all lines, of which those
    crossings count that have ``begin <= ceil(c) < end``.
    """
    a, b, c = axes
    one = np.int64(1) << bits
    handed = 1 if (b - a) % 3 == 1 else -1
    scale = float(one)
    columns, rows, depth = counts.shape
    first = begin if along == 0 else 0
    for member in range(len(members)):
        f = members[member]
        i, j, k = faces[f, 0], faces[f, 1], faces[f, 2]
        ix, iy = np.int64(round(vertices[i, a] * scale)), np.int64(round(vertices[i, b] * scale))
        jx, jy = np.int64(round(vertices[j, a] * scale)), np.int64(round(vertices[j, b] * scale))
        kx, ky = np.int64(round(vertices[k, a] * scale)), np.int64(round(vertices[k, b] * scale))
        area = (jx - ix) * (ky - iy) - (jy - iy) * (kx - ix)
        if area == 0:
            continue
        turn = 1 if area > 0 else -1
        step = turn * handed
        iz, jz, kz = vertices[i, c], vertices[j, c], vertices[k, c]
        low_x, high_x = -((-min(ix, jx, kx)) >> bits), max(ix, jx, kx) >> bits
        low_y, high_y = max(-((-min(iy, jy, ky)) >> bits), 0), min(max(iy, jy, ky) >> bits, rows - 1)
        low_x, high_x = max(low_x, first), min(high_x, end - 1 if along == 0 else columns - 1)
        for x in range(low_x, high_x + 1):
            px = np.int64(x) << bits
            for y in range(low_y, high_y + 1):
                py = np.int64(y) << bits
                if (
                    _side(ix, iy, jx, jy, px, py) * turn > 0
                    and _side(jx, jy, kx, ky, px, py) * turn > 0
                    and _side(kx, ky, ix, iy, px, py) * turn > 0
                ):
                    wi = float((kx - jx) * (py - jy) - (ky - jy) * (px - jx))
                    wj = float((ix - kx) * (py - ky) - (iy - ky) * (px - kx))
                    wk = float((jx - ix) * (py - iy) - (jy - iy) * (px - ix))
                    height = (wi * iz + wj * jz + wk * kz) / float(area)
                    z = min(max(math.ceil(height), 0), depth - 1)
                    if along == 0 or begin <= z < end:
                        counts[x - first, y, z] += step
                        if flag != 0:
                            crossed[x - first, y, z] |= flag


@kernel
def signed(counts, low, high, scale, distance):
    """Scale distances and turn those negative whose winding number lies outside ``low .. high``; lines along axis 2."""
    for x in range(counts.shape[0]):
        for y in range(counts.shape[1]):
            w = 0
            for z in range(counts.shape[2]):
                w -= counts[x, y, z]
                distance[x, y, z] *= scale if low <= w <= high else -scale


@kernel
def sunk(counts, low, high, distance):
    """Turn distances negative whose winding number lies outside ``low .. high``; lines along axis 2."""
    for x in range(counts.shape[0]):
        for y in range(counts.shape[1]):
            w = 0
            for z in range(counts.shape[2]):
                w -= counts[x, y, z]
                if not low <= w <= high:
                    distance[x, y, z] = -abs(distance[x, y, z])


@kernel
def vote(counts, low, high, votes):
    """One vote for free (1) or solid (16) on the nodes of lines along axis 0 that leave as they came in.

    A line whose crossings do not add up to nothing went through a hole: its counts depend on where it began.
    """
    length, lines = counts.shape
    total = np.zeros(lines, np.int32)
    for i in range(length):
        for j in range(lines):
            total[j] += counts[i, j]
    w = np.zeros(lines, np.int32)
    for i in range(length):
        for j in range(lines):
            w[j] -= counts[i, j]
            free = low <= w[j] <= high
            votes[i, j] += (1 if free else 16) if total[j] == 0 else 0


@kernel
def turned(votes, scale, distance):
    """Scale distances and turn those negative whose vote is for solid."""
    for n in range(len(votes)):
        distance[n] *= scale if votes[n] & 15 else -scale
