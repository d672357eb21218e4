"""Nodes that must have the same sign, and the best cut where a mesh leaves that open.

No surface passes between neighbouring nodes whose edge crosses no triangle. Where they are also more than a voxel from
surfaces together, not even a crack can lie between them.
"""

from __future__ import annotations

import numpy as np

from scenes.kernels import helper, kernel
from scenes.kernels.sets import join, numbered, root

JOINED = 8
"""Flag of a node that has been joined to a neighbour, beside the flags 1, 2, 4 of crossed edges towards -z, -y, -x."""

_APART = 1.001
_IMPOSSIBLE = 1.01


@helper
def _neighbour(crossed, shape, n, side):
    """The neighbour of node n on one of six sides if there is one and the edge to it crosses no triangle, else -1."""
    rows, depth = shape[1], shape[2]
    axis = side % 3
    if axis == 0:
        at, length, step, flag = n % depth, depth, 1, 1
    elif axis == 1:
        at, length, step, flag = n // depth % rows, rows, depth, 2
    else:
        at, length, step, flag = n // (depth * rows), shape[0], depth * rows, 4
    if side < 3:
        return n - step if at > 0 and crossed[n] & flag == 0 else -1
    return n + step if at < length - 1 and crossed[n + step] & flag == 0 else -1


@kernel
def regions(distance, crossed, shape, parent):
    """Number the regions of constant sign, ascending with their first node, into `parent`; returns how many."""
    for n in range(len(distance)):
        parent[n] = n
        for side in range(3):
            q = _neighbour(crossed, shape, n, side)
            if q >= 0 and distance[n] + distance[q] > _APART:
                join(parent, n, q)
                crossed[n] |= JOINED
                crossed[q] |= JOINED
    for n in range(len(distance)):
        if crossed[n] & JOINED == 0:  # beside a surface: go with the neighbour on this side of it that is farthest away
            best, farthest = -1, distance[n]
            for side in range(6):
                q = _neighbour(crossed, shape, n, side)
                if q >= 0 and distance[q] > farthest:
                    best, farthest = q, distance[q]
            if best >= 0:
                join(parent, n, best)
    return numbered(parent)


@kernel
def tally(region, votes, distance, count):
    """Votes for free and for solid in each region, and its node farthest from any surface."""
    free, solid = np.zeros(count, np.int64), np.zeros(count, np.int64)
    deepest = np.full(count, -1, np.int64)
    for n in range(len(region)):
        r = region[n]
        free[r] += votes[n] & 15
        solid[r] += votes[n] >> 4
        if deepest[r] < 0 or distance[n] > distance[deepest[r]]:
            deepest[r] = n
    return free, solid, deepest


@helper
def _unite(parent, label, n, q):
    """Join the sets of two nodes unless their labels contradict each other."""
    a, b = root(parent, n), root(parent, q)
    if a != b and (label[a] == 0 or label[b] == 0 or label[a] == label[b]):
        low, high = min(a, b), max(a, b)
        parent[high] = low
        label[low] = max(label[low], label[high])


@kernel
def flood(order, distance, crossed, shape, label, parent):
    """Grow labelled nodes (1 free, 2 solid) into the unlabelled from wide places to narrow ones.

    Sets with different labels meet where the way between them is narrowest, and stay apart. A node joins its widest
    neighbour first, or a set that came through a crack would run on beside the wall. `parent` is -1 everywhere before,
    and -1 or a root after; a root's label is that of its set.
    """
    for n in order:
        parent[n] = n
        widest = -1
        for side in range(6):
            q = _neighbour(crossed, shape, n, side)
            if q >= 0 and parent[q] >= 0 and (widest < 0 or distance[q] > distance[widest]):
                widest = q
        if widest >= 0:
            _unite(parent, label, n, widest)
            for side in range(6):
                q = _neighbour(crossed, shape, n, side)
                if q >= 0 and q != widest and parent[q] >= 0 and parent[q] != parent[n]:
                    _unite(parent, label, n, q)
    for n in order:
        parent[n] = root(parent, n)


@kernel
def nearest(crossed, shape, torn, label):
    """Give nodes of `torn` without a label that of the labelled one that the fewest edges lead to, in place."""
    queue = np.empty(len(label), np.int32)
    count = 0
    for n in range(len(label)):
        if torn[n] and label[n] != 0:
            queue[count] = n
            count += 1
    at = 0
    while at < count:
        n = queue[at]
        at += 1
        for side in range(6):
            q = _neighbour(crossed, shape, n, side)
            if q >= 0 and torn[q] and label[q] == 0:
                label[q] = label[n]
                queue[count] = q
                count += 1


@kernel
def borders(distance, crossed, shape, parent, sort, air, wall):
    """For each set: its edges to nodes of another sort through open air, and its edges that cross a triangle."""
    for n in range(len(parent)):
        if parent[n] < 0:
            continue
        for side in range(6):
            q = _neighbour(crossed, shape, n, side)
            if q < 0:
                wall[parent[n]] += 1
            elif sort[q] != sort[n] and sort[q] != 0 and distance[n] + distance[q] > _IMPOSSIBLE:
                air[parent[n]] += 1


@kernel
def weighed(region, purity, votes, free, confidence):
    """Share of the evidence (rays, and the region as a whole) that agrees with each node's sign, in percent."""
    for n in range(len(region)):
        for_free, for_solid = votes[n] & 15, votes[n] >> 4
        agree = for_free if free[n] else for_solid
        confidence[n] = np.uint8(round(100.0 * (agree + purity[region[n]]) / (for_free + for_solid + 1.0)))
