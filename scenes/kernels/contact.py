"""How steep a grid's interpolant is, block by block, and where it is least on the way of a segment."""

from __future__ import annotations

import math

import numpy as np

from scenes.kernels import helper, kernel
from scenes.kernels.query import left, trilinear

SIDE = 4
"""Voxels along the edge of a block."""

NEAR = SIDE - 1
"""So many voxels from a point, all edges of a voxel belong to the point's block or its neighbours."""

SMALLEST = 2.0**-60
"""Half of the smallest patch: points within it cannot be told apart."""

STACK = 128  # a patch is halved 60 times along both sides at most, and each halving leaves one more to look at


@kernel
def steepened(values, spacing, begin, end, slopes):
    """Range of differences between nodes, by blocks ``slopes[begin:end]``: least along x, y, z, then greatest.

    An edge belongs to the block of its first node.
    """
    nx, ny, nz = values.shape
    mx, my, mz, _ = slopes.shape
    over = 1.0 / spacing
    for bx in range(begin, end):
        for x in range(bx * SIDE, nx if bx == mx - 1 else bx * SIDE + SIDE):
            up = min(x + 1, nx - 1)  # of the last node there is no edge, and its difference 0 does no harm
            for y in range(ny):
                by, right = min(y // SIDE, my - 1), min(y + 1, ny - 1)
                for z in range(nz):
                    into, here = slopes[bx, by, min(z // SIDE, mz - 1)], values[x, y, z]
                    dx, dy = (values[up, y, z] - here) * over, (values[x, right, z] - here) * over
                    dz = (values[x, y, min(z + 1, nz - 1)] - here) * over
                    into[0], into[3] = min(into[0], dx), max(into[3], dx)
                    into[1], into[4] = min(into[1], dy), max(into[4], dy)
                    into[2], into[5] = min(into[2], dz), max(into[5], dz)


@helper
def _split(x, size):
    """Voxel, share in it and what lies outside, in voxels; what is not a number lies in voxel 0 and outside it."""
    inside = x if x > 0.0 else 0.0
    inside = inside if inside < size - 1.0 else size - 1.0
    cell = min(np.int64(inside), size - 2)
    return cell, inside - cell, x - inside


@helper
def _sampled(values, origin, spacing, beyond, margin, slopes, x, y, z):
    """Value at a point, and the range of the gradient within NEAR voxels of it."""
    i, u, ox = _split((x - origin[0]) / spacing, values.shape[0])
    j, v, oy = _split((y - origin[1]) / spacing, values.shape[1])
    k, w, oz = _split((z - origin[2]) / spacing, values.shape[2])
    value = float(trilinear(values, i, j, k, 1, u, v, w))
    squared = spacing * spacing * (ox * ox + oy * oy + oz * oz)
    if squared != 0.0:
        squared += 2.0 * margin * spacing * (abs(ox) + abs(oy) + abs(oz))
        value = left(value, squared, beyond)[0]
    return value, slopes[i // SIDE, j // SIDE, k // SIDE]


@helper
def _at(ends, n, axis, s, t):
    """Coordinate of the point at share s of the segment and share t of the way, and its three derivatives."""
    a0, b0, a1, b1 = ends[n, 0, axis], ends[n, 1, axis], ends[n, 2, axis], ends[n, 3, axis]
    first, last = a0 + (b0 - a0) * s, a1 + (b1 - a1) * s
    along = (b0 - a0) * (1.0 - t) + (b1 - a1) * t
    return first + (last - first) * t, along, last - first, b1 - a1 - b0 + a0


@helper
def _length(x, y, z):
    return math.sqrt(x * x + y * y + z * z)


@helper
def _fall(slopes, x, y, z):
    """The least that a value can change by on the way (x, y, z)."""
    along_x = min(slopes[0] * x, slopes[3] * x)
    return along_x + min(slopes[1] * y, slopes[4] * y) + min(slopes[2] * z, slopes[5] * z)


@helper
def _halved(stack, top, s, t, hs, ht, along):
    """Put both halves of the patch around (s, t) on the stack, cut along the segment or else along the way."""
    ds, dt = (0.5 * hs, 0.0) if along else (0.0, 0.5 * ht)
    stack[top, 0], stack[top, 1] = s - ds, t - dt
    stack[top + 1, 0], stack[top + 1, 1] = s + ds, t + dt
    stack[top, 2] = stack[top + 1, 2] = hs - ds
    stack[top, 3] = stack[top + 1, 3] = ht - dt


@kernel
def lowest(values, origin, spacing, beyond, margin, slopes, widest, ends, enough, tolerance, begin, end, shares):
    """Where on segments ``begin .. end``, each on its way, the interpolant is least: branch and bound, depth first.

    Args:
        values, origin, spacing, beyond, margin: of the grid.
        slopes: range of the gradient in each block and its neighbours.
        widest: range of it everywhere.
        ends: a0, b0, a1, b1 of every segment, ``[n, 4, 3]``.
        enough: a segment whose least is above this needs no exact figure, ``[n]``.
        tolerance: what is found exceeds the least by this at most.
        shares: of segment and way, ``[n, 2]``, written.
    """
    stack = np.empty((STACK, 4))
    for n in range(begin, end):
        best = np.inf
        shares[n, 0] = shares[n, 1] = 0.5
        stack[0, 0] = stack[0, 1] = stack[0, 2] = stack[0, 3] = 0.5
        top = 1
        for corner in range(4):  # where a segment slants, one of its ends is least
            s, t = float(corner % 2), float(corner // 2)
            x, y, z = _at(ends, n, 0, s, t)[0], _at(ends, n, 1, s, t)[0], _at(ends, n, 2, s, t)[0]
            value, _ = _sampled(values, origin, spacing, beyond, margin, slopes, x, y, z)
            if value < best:
                best = value
                shares[n, 0], shares[n, 1] = s, t
        while top > 0:
            top -= 1
            s, t, hs, ht = stack[top, 0], stack[top, 1], stack[top, 2], stack[top, 3]
            x, ux, vx, wx = _at(ends, n, 0, s, t)
            y, uy, vy, wy = _at(ends, n, 1, s, t)
            z, uz, vz, wz = _at(ends, n, 2, s, t)
            value, near = _sampled(values, origin, spacing, beyond, margin, slopes, x, y, z)
            if value < best:
                best = value
                shares[n, 0], shares[n, 1] = s, t
            # The patch reaches furthest at one of its corners, and there the value can have fallen most.
            ux, uy, uz, vx, vy, vz = hs * ux, hs * uy, hs * uz, ht * vx, ht * vy, ht * vz
            wx, wy, wz = hs * ht * wx, hs * ht * wy, hs * ht * wz
            ax, ay, az = ux + vx + wx, uy + vy + wy, uz + vz + wz
            bx, by, bz = ux - vx - wx, uy - vy - wy, uz - vz - wz
            cx, cy, cz = vx - ux - wx, vy - uy - wy, vz - uz - wz
            dx, dy, dz = wx - ux - vx, wy - uy - vy, wz - uz - vz
            reach = max(_length(ax, ay, az), _length(bx, by, bz), _length(cx, cy, cz), _length(dx, dy, dz))
            known = near if reach <= NEAR * spacing else widest
            bound = value + min(
                _fall(known, ax, ay, az), _fall(known, bx, by, bz), _fall(known, cx, cy, cz), _fall(known, dx, dy, dz)
            )
            if not (bound < best - tolerance and bound < enough[n]) or max(hs, ht) < SMALLEST:
                continue
            along = ht < SMALLEST or (hs >= SMALLEST and _length(ux, uy, uz) >= _length(vx, vy, vz))
            _halved(stack, top, s, t, hs, ht, along)
            top += 2
