"""Winding numbers by counting what rays along the axes cross, exactly.

Triangles are projected along an axis and their corners snapped to whole multiples of a tiny fraction of a voxel, so that
the side of an edge on which a line of nodes lies is decided in whole numbers, alike for both triangles at that edge. A
line through an edge or a corner counts as moved by (e, e²), e infinitesimal. So a closed mesh has no cracks, and what a
line counts is the winding number of every node on it.
"""

from __future__ import annotations

import math

import numpy as np

from scenes.kernels import helper, kernel


def fraction_bits(longest):
    """Bits below the voxel for a lattice of `longest` nodes along its longest axis: products fit 62 bits."""
    return 29 - int(longest).bit_length()


@helper
def _side(ax, ay, bx, by, px, py):
    """Which side of the line from a to b the point p is on, never 0."""
    dx, dy = bx - ax, by - ay
    e = dx * (py - ay) - dy * (px - ax)
    if e != 0:
        return e
    return -dy if dy != 0 else dx


@kernel
def crossings(vertices, faces, members, axes, bits, begin, end, along, counts):
    """Add the crossings of lines along axis ``axes[2]`` with some triangles to ``counts[a, b, c]``.

    A crossing at height c adds the direction of the triangle's normal at node ceil(c), so that minus the sum up to a node
    is the winding number there. `counts` has the axes in the order `axes`. Where `along` is 0 only lines with
    ``begin <= a < end`` count, else only crossings with ``begin <= ceil(c) < end``.
    """
    a, b, c = axes
    one = np.int64(1) << bits
    scale = float(one)
    columns, rows, depth = counts.shape
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
        iz, jz, kz = vertices[i, c], vertices[j, c], vertices[k, c]
        low_x, high_x = -((-min(ix, jx, kx)) >> bits), max(ix, jx, kx) >> bits
        low_y, high_y = max(-((-min(iy, jy, ky)) >> bits), 0), min(max(iy, jy, ky) >> bits, rows - 1)
        low_x, high_x = max(low_x, begin if along == 0 else 0), min(high_x, end - 1 if along == 0 else columns - 1)
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
                        counts[x, y, z] += turn
