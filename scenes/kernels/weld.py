"""Equal vertices become one, repeated triangles go, edges are counted: hashing, where sorting takes seconds."""

from __future__ import annotations

import math

import numpy as np

from scenes.kernels import helper, kernel
from scenes.kernels.sets import join, numbered


@helper
def _mixed(a, b, c, mask):
    """A slot for three integers."""
    h = np.uint64(a) * np.uint64(0x9E3779B97F4A7C15)
    h = (h ^ np.uint64(b)) * np.uint64(0xC2B2AE3D27D4EB4F)
    h = (h ^ np.uint64(c)) * np.uint64(0x165667B19E3779F9)
    return np.int64((h ^ (h >> np.uint64(29))) & np.uint64(mask))


@kernel
def welded(bits, table):
    """For rows ``bits[V, 3]``: index of the first equal row among the kept ones, and the rows kept, in order.

    `table` is int32, a power of two long and at least twice V, filled with -1.
    """
    index = np.empty(len(bits), np.int32)
    kept = np.empty(len(bits), np.int32)
    count = 0
    mask = len(table) - 1
    for v in range(len(bits)):
        a, b, c = bits[v, 0], bits[v, 1], bits[v, 2]
        slot = _mixed(a, b, c, mask)
        while True:
            held = table[slot]
            if held < 0:
                table[slot] = count
                kept[count] = v
                index[v] = count
                count += 1
                break
            w = kept[held]
            if bits[w, 0] == a and bits[w, 1] == b and bits[w, 2] == c:
                index[v] = held
                break
            slot = (slot + 1) & mask
    return index, kept[:count].copy()


@kernel
def distinct(faces, index, table):
    """Triangles of welded corners that are neither collapsed nor a copy (turned or not) of an earlier one.

    `table` as for `welded`, at least twice as long as `faces`.
    """
    out = np.empty((len(faces), 3), np.int32)
    count = 0
    mask = len(table) - 1
    for f in range(len(faces)):
        a, b, c = index[faces[f, 0]], index[faces[f, 1]], index[faces[f, 2]]
        if a == b or b == c or c == a:
            continue
        if b < a and b < c:
            a, b, c = b, c, a
        elif c < a and c < b:
            a, b, c = c, a, b
        slot = _mixed(a, b, c, mask)
        while table[slot] >= 0:
            g = table[slot]
            if out[g, 0] == a and out[g, 1] == b and out[g, 2] == c:
                break
            slot = (slot + 1) & mask
        if table[slot] < 0:
            table[slot] = count
            out[count, 0], out[count, 1], out[count, 2] = a, b, c
            count += 1
    return out[:count].copy()


@kernel
def edge_keys(faces, vertices):
    """One number for each use of an edge; its lowest bit is the direction."""
    keys = np.empty(3 * len(faces), np.int64)
    for f in range(len(faces)):
        for side in range(3):
            a, b = np.int64(faces[f, side]), np.int64(faces[f, (side + 1) % 3])
            keys[3 * f + side] = ((a * vertices + b) << 1) if a < b else ((b * vertices + a) << 1) | 1
    return keys


@kernel
def faulty(keys):
    """Edges (keys without direction) that are no plain seams, from `keys` sorted.

    Returns those that are used more often in one direction than in the other; whether each of these is used twice in
    the same direction; and those used more than twice.
    """
    unmatched, twisted, crowded = (
        np.empty(len(keys), np.int64),
        np.empty(len(keys), np.bool_),
        np.empty(len(keys), np.int64),
    )
    count, many, at = 0, 0, 0
    while at < len(keys):
        edge, balance, first = keys[at] >> 1, 0, at
        while at < len(keys) and keys[at] >> 1 == edge:
            balance += 1 - 2 * (keys[at] & 1)
            at += 1
        if balance != 0:
            unmatched[count], twisted[count] = edge, at - first == 2
            count += 1
        if at - first > 2:
            crowded[many] = edge
            many += 1
    return unmatched[:count].copy(), twisted[:count].copy(), crowded[:many].copy()


@kernel
def connected(faces, vertices):
    """Number of the connected piece of each of so many vertices, ascending with its first, and how many there are."""
    parent = np.arange(vertices).astype(np.int32)
    for f in range(len(faces)):
        join(parent, faces[f, 0], faces[f, 1])
        join(parent, faces[f, 1], faces[f, 2])
    return parent, numbered(parent)


@kernel
def patched(keys, order):
    """Number of the patch of each triangle, those that share an edge that no third has, and how many patches there are.

    `keys` are those of `edge_keys`, and `order` sorts them.
    """
    parent = np.arange(len(keys) // 3).astype(np.int32)
    at = 0
    while at < len(order):
        after = at + 1
        while after < len(order) and keys[order[after]] >> 1 == keys[order[at]] >> 1:
            after += 1
        if after == at + 2:
            join(parent, order[at] // 3, order[at + 1] // 3)
        at = after
    return parent, numbered(parent)


@kernel
def torn(keys, order, patch, count):
    """True for each of so many patches that has an edge which it uses more often in one direction; as `patched`."""
    out = np.zeros(count, np.bool_)
    at = 0
    while at < len(order):
        after = at + 1
        while after < len(order) and keys[order[after]] >> 1 == keys[order[at]] >> 1:
            after += 1
        for i in range(at, after):
            balance = 0
            for j in range(at, after):
                if patch[order[j] // 3] == patch[order[i] // 3]:
                    balance += 1 - 2 * (keys[order[j]] & 1)
            out[patch[order[i] // 3]] |= balance != 0
        at = after
    return out


@helper
def _doubled_area(vertices, i, j, k):
    ux, uy, uz = vertices[j, 0] - vertices[i, 0], vertices[j, 1] - vertices[i, 1], vertices[j, 2] - vertices[i, 2]
    vx, vy, vz = vertices[k, 0] - vertices[i, 0], vertices[k, 1] - vertices[i, 1], vertices[k, 2] - vertices[i, 2]
    nx, ny, nz = uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx
    return math.sqrt(nx * nx + ny * ny + nz * nz)


@kernel
def areas(vertices, faces):
    """Area of each triangle."""
    out = np.empty(len(faces))
    for f in range(len(faces)):
        out[f] = _doubled_area(vertices, faces[f, 0], faces[f, 1], faces[f, 2]) / 2.0
    return out


@kernel
def boxes(vertices, faces, piece, count):
    """Lowest and highest corner of so many pieces, ``[count, 2, 3]``; `piece` is that of each triangle."""
    out = np.empty((count, 2, 3))
    out[:, 0], out[:, 1] = np.inf, -np.inf
    for f in range(len(faces)):
        for corner in range(3):
            for axis in range(3):
                x = vertices[faces[f, corner], axis]
                out[piece[f], 0, axis] = min(out[piece[f], 0, axis], x)
                out[piece[f], 1, axis] = max(out[piece[f], 1, axis], x)
    return out


@kernel
def slivers(vertices, faces):
    """True for triangles whose doubled area is below 1e-12 of their longest edge squared."""
    out = np.empty(len(faces), np.bool_)
    for f in range(len(faces)):
        i, j, k = faces[f, 0], faces[f, 1], faces[f, 2]
        longest = 0.0
        for a, b in ((i, j), (j, k), (k, i)):
            d = 0.0
            for axis in range(3):
                d += (vertices[a, axis] - vertices[b, axis]) ** 2
            longest = max(longest, d)
        out[f] = not _doubled_area(vertices, i, j, k) > 1e-12 * longest
    return out
