"""The generalised winding number through a tree of dipoles.

Barill et al., "Fast winding numbers for soups and clouds", 2018, first order: far from a cluster of triangles its sum
of area vectors at their common centre stands for all of them; near it the solid angle of each triangle is exact.
"""

from __future__ import annotations

import math

import numpy as np

from scenes.kernels import helper, kernel

LEAF = 8
"""Triangles in a leaf."""


@helper
def _spread(bits):
    """Two zeros between the lowest ten bits."""
    bits = (bits | bits << 16) & 0x30000FF
    bits = (bits | bits << 8) & 0x300F00F
    bits = (bits | bits << 4) & 0x30C30C3
    return (bits | bits << 2) & 0x9249249


@kernel
def morton(vertices, faces, low, scale):
    """Place of each triangle's centre on a Morton curve with 1024 steps along each axis."""
    codes = np.empty(len(faces), np.int32)
    for f in range(len(faces)):
        code = 0
        for axis in range(3):
            middle = (vertices[faces[f, 0], axis] + vertices[faces[f, 1], axis] + vertices[faces[f, 2], axis]) / 3.0
            code |= _spread(min(max(int((middle - low[axis]) * scale), 0), 1023)) << axis
        codes[f] = code
    return codes


@kernel
def clusters(vertices, faces, order, leaves):
    """A complete binary tree over the ordered triangles: rows of centre, area vector, area and radius, root first.

    Node k has the children 2 k + 1 and 2 k + 2; leaf m is node ``leaves - 1 + m`` and holds triangles
    ``order[LEAF * m : LEAF * (m + 1)]``.
    """
    tree = np.zeros((2 * leaves - 1, 8))
    for m in range(leaves):
        _gather(vertices, faces, order, m, tree[leaves - 1 + m])
    for k in range(leaves - 2, -1, -1):
        a, b, node = tree[2 * k + 1], tree[2 * k + 2], tree[k]
        area = a[6] + b[6]
        node[6] = area
        for axis in range(3):
            node[axis] = (a[axis] * a[6] + b[axis] * b[6]) / area if area > 0.0 else a[axis]
            node[3 + axis] = a[3 + axis] + b[3 + axis]
        for child in (a, b):
            if child[6] > 0.0:
                away = 0.0
                for axis in range(3):
                    away += (child[axis] - node[axis]) ** 2
                node[7] = max(node[7], math.sqrt(away) + child[7])
    return tree


@helper
def _gather(vertices, faces, order, m, node):
    first, last = LEAF * m, min(LEAF * (m + 1), len(order))
    for at in range(first, last):
        i, j, k = faces[order[at], 0], faces[order[at], 1], faces[order[at], 2]
        ux, uy, uz = vertices[j, 0] - vertices[i, 0], vertices[j, 1] - vertices[i, 1], vertices[j, 2] - vertices[i, 2]
        vx, vy, vz = vertices[k, 0] - vertices[i, 0], vertices[k, 1] - vertices[i, 1], vertices[k, 2] - vertices[i, 2]
        nx, ny, nz = (uy * vz - uz * vy) / 2.0, (uz * vx - ux * vz) / 2.0, (ux * vy - uy * vx) / 2.0
        area = math.sqrt(nx * nx + ny * ny + nz * nz) + 1e-300
        node[3] += nx
        node[4] += ny
        node[5] += nz
        node[6] += area
        for axis in range(3):
            node[axis] += area * (vertices[i, axis] + vertices[j, axis] + vertices[k, axis]) / 3.0
    for axis in range(3):
        node[axis] = node[axis] / node[6] if node[6] > 0.0 else 0.0
    for at in range(first, last):
        for corner in range(3):
            away = 0.0
            for axis in range(3):
                away += (vertices[faces[order[at], corner], axis] - node[axis]) ** 2
            node[7] = max(node[7], math.sqrt(away))


@helper
def _solid_angle(vertices, i, j, k, x, y, z):
    """Signed solid angle of a triangle (van Oosterom and Strackee, 1983)."""
    ax, ay, az = vertices[i, 0] - x, vertices[i, 1] - y, vertices[i, 2] - z
    bx, by, bz = vertices[j, 0] - x, vertices[j, 1] - y, vertices[j, 2] - z
    cx, cy, cz = vertices[k, 0] - x, vertices[k, 1] - y, vertices[k, 2] - z
    a, b = math.sqrt(ax * ax + ay * ay + az * az), math.sqrt(bx * bx + by * by + bz * bz)
    c = math.sqrt(cx * cx + cy * cy + cz * cz)
    volume = ax * (by * cz - bz * cy) + ay * (bz * cx - bx * cz) + az * (bx * cy - by * cx)
    over = a * b * c + (ax * bx + ay * by + az * bz) * c
    over += (bx * cx + by * cy + bz * cz) * a + (cx * ax + cy * ay + cz * az) * b
    return 2.0 * math.atan2(volume, over)


@kernel
def winding(vertices, faces, order, tree, reach, points, begin, end, out):
    """Winding number at ``points[begin:end]``; a cluster is a dipole from `reach` of its radii on."""
    leaves = (len(tree) + 1) // 2
    stack = np.empty(64, np.int64)
    for p in range(begin, end):
        x, y, z = points[p, 0], points[p, 1], points[p, 2]
        total = 0.0
        stack[0] = 0
        top = 1
        while top > 0:
            top -= 1
            k = stack[top]
            if tree[k, 6] == 0.0:
                continue
            rx, ry, rz = tree[k, 0] - x, tree[k, 1] - y, tree[k, 2] - z
            away = rx * rx + ry * ry + rz * rz
            if away > (reach * tree[k, 7]) ** 2:
                total += (rx * tree[k, 3] + ry * tree[k, 4] + rz * tree[k, 5]) / (away * math.sqrt(away))
            elif k >= leaves - 1:
                m = k - (leaves - 1)
                for at in range(LEAF * m, min(LEAF * (m + 1), len(order))):
                    f = order[at]
                    total += _solid_angle(vertices, faces[f, 0], faces[f, 1], faces[f, 2], x, y, z)
            else:
                stack[top], stack[top + 1] = 2 * k + 1, 2 * k + 2
                top += 2
        out[p] = total / (4.0 * math.pi)
