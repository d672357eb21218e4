"""Disjoint sets of numbers: each links to a lower member of its set, the root to itself."""

from __future__ import annotations

from scenes.kernels import helper


@helper
def root(parent, n):
    """The lowest number of the set that n is in."""
    while parent[n] != n:
        parent[n] = parent[parent[n]]
        n = parent[n]
    return n


@helper
def join(parent, a, b):
    """Unite two sets: the root is their lowest number."""
    a, b = root(parent, a), root(parent, b)
    if a < b:
        parent[b] = a
    elif b < a:
        parent[a] = b


@helper
def numbered(parent):
    """Replace each node's link by the number of its set, ascending with the root, the lowest node of the set."""
    count = 0
    for n in range(len(parent)):
        if parent[n] == n:
            parent[n] = count
            count += 1
        else:  # links point down: what the link points at has been numbered
            parent[n] = parent[parent[n]]
    return count
