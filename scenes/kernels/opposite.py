"""How far the triangle opposite to a point of a surface is, through a tree of triangle clusters."""

from __future__ import annotations

import math

import numpy as np

from scenes.kernels import helper, kernel
from scenes.kernels.winding import LEAF

TURNED = -0.9
"""Cosine between the normals of two triangles up to which they are opposite: within 26 degrees."""


@kernel
def opposite(vertices, faces, order, tree, chosen, points, length, begin, end, out):
    """Distances from points ``begin .. end`` to the nearest opposite triangles, in front and behind, ``out[n, 2]``.

    Args:
        vertices, faces, order, tree: of `scenes.kernels.winding.clusters`.
        chosen: the triangle that each point lies on, ``[n]``, which has an area.
        points: ``[n, 3]``; lines are followed along the triangle's normal, both ways.
        length: as far as this; infinite where nothing is met.
    """
    leaves = (len(tree) + 1) // 2
    stack = np.empty(64, np.int64)
    for p in range(begin, end):
        out[p, 0] = out[p, 1] = np.inf
        x, y, z = points[p, 0], points[p, 1], points[p, 2]
        nx, ny, nz = _area_vector(vertices, faces, chosen[p])
        size = math.sqrt(nx * nx + ny * ny + nz * nz)
        nx, ny, nz = nx / size, ny / size, nz / size
        stack[0] = 0
        top = 1
        while top > 0:
            top -= 1
            k = stack[top]
            rx, ry, rz = tree[k, 0] - x, tree[k, 1] - y, tree[k, 2] - z
            along = rx * nx + ry * ny + rz * nz
            along -= min(max(along, -length), length)
            across = rx * rx + ry * ry + rz * rz - (rx * nx + ry * ny + rz * nz) ** 2
            if tree[k, 6] == 0.0 or across + along * along > tree[k, 7] ** 2:
                continue
            if k < leaves - 1:
                stack[top], stack[top + 1] = 2 * k + 1, 2 * k + 2
                top += 2
                continue
            m = k - (leaves - 1)
            for at in range(LEAF * m, min(LEAF * (m + 1), len(order))):
                f = order[at]
                ax, ay, az = _area_vector(vertices, faces, f)
                facing = ax * nx + ay * ny + az * nz
                if f == chosen[p] or facing >= TURNED * math.sqrt(ax * ax + ay * ay + az * az):
                    continue
                t = _met(vertices, faces, f, x, y, z, nx, ny, nz, facing)
                side = 0 if t > 0.0 else 1
                if abs(t) <= length and abs(t) < out[p, side]:
                    out[p, side] = abs(t)


@helper
def _area_vector(vertices, faces, f):
    """Along the normal of a triangle, as long as twice its area."""
    i, j, k = faces[f, 0], faces[f, 1], faces[f, 2]
    ux, uy, uz = vertices[j, 0] - vertices[i, 0], vertices[j, 1] - vertices[i, 1], vertices[j, 2] - vertices[i, 2]
    vx, vy, vz = vertices[k, 0] - vertices[i, 0], vertices[k, 1] - vertices[i, 1], vertices[k, 2] - vertices[i, 2]
    return uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx


@helper
def _met(vertices, faces, f, x, y, z, nx, ny, nz, facing):
    """Where the line from (x, y, z) along n meets a triangle; infinite where it passes by.

    The volumes that the line spans with the edges have one sign (Moeller and Trumbore, 1997, written for a line);
    `facing` is their sum.
    """
    volume, total = 0.0, 0.0
    for corner in range(3):
        i, j = faces[f, corner], faces[f, (corner + 1) % 3]
        ax, ay, az = vertices[i, 0] - x, vertices[i, 1] - y, vertices[i, 2] - z
        bx, by, bz = vertices[j, 0] - x, vertices[j, 1] - y, vertices[j, 2] - z
        volume = nx * (ay * bz - az * by) + ny * (az * bx - ax * bz) + nz * (ax * by - ay * bx)
        if volume > 0.0:  # seen along n the triangle turns the other way
            return np.inf
        k = faces[f, (corner + 2) % 3]
        total += volume * (nx * (vertices[k, 0] - x) + ny * (vertices[k, 1] - y) + nz * (vertices[k, 2] - z))
    return total / facing
