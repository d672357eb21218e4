"""What can be stood on: where vertical lines cross triangles, how steep that is, and which of it hangs together.

Heights come as ``[X, Z, K]``, K surfaces over one another in every cell, ascending, NaN where a cell has fewer.
"""

from __future__ import annotations

import math

import numpy as np

from scenes.kernels import helper, kernel

BASE = 3
"""Cells to either side over which a slope is measured."""

_EDGE = 1e-9  # shares of a triangle, and cells, by which a line may miss and still count


@kernel
def crossings(vertices, faces, flat, x0, z0, cell, nx, nz):
    """Where the vertical lines through the cells' centres cross triangles.

    Returns numbers of the cells (x * nz + z), heights, and whether the triangle's normal has at least `flat` of its
    length along y, whichever way it faces. A line through an edge crosses both triangles.
    """
    count = np.int64(0)
    for f in range(len(faces)):
        count += _crossed(vertices, faces[f], flat, x0, z0, cell, nx, nz, np.empty(0, np.int64), np.empty(0), None, 0)
    cells, heights, level = np.empty(count, np.int64), np.empty(count), np.empty(count, np.bool_)
    count = 0
    for f in range(len(faces)):
        count += _crossed(vertices, faces[f], flat, x0, z0, cell, nx, nz, cells, heights, level, count)
    return cells, heights, level


@helper
def _crossed(vertices, face, flat, x0, z0, cell, nx, nz, cells, heights, level, at):
    """Lines that cross one triangle, stored from `at` where `level` is given."""
    a, b, c = vertices[face[0]], vertices[face[1]], vertices[face[2]]
    ux, uy, uz, vx, vy, vz = b[0] - a[0], b[1] - a[1], b[2] - a[2], c[0] - a[0], c[1] - a[1], c[2] - a[2]
    area = ux * vz - vx * uz
    if area == 0.0:
        return 0
    length = math.sqrt((uy * vz - uz * vy) ** 2 + area**2 + (ux * vy - uy * vx) ** 2)
    first = max(math.ceil((min(a[0], b[0], c[0]) - x0) / cell - _EDGE), 0)
    last = min(math.floor((max(a[0], b[0], c[0]) - x0) / cell + _EDGE), nx - 1)
    low = max(math.ceil((min(a[2], b[2], c[2]) - z0) / cell - _EDGE), 0)
    high = min(math.floor((max(a[2], b[2], c[2]) - z0) / cell + _EDGE), nz - 1)
    count = 0
    for i in range(first, last + 1):
        px = x0 + cell * i - a[0]
        for j in range(low, high + 1):
            pz = z0 + cell * j - a[2]
            u, v = (px * vz - vx * pz) / area, (ux * pz - px * uz) / area
            if u < -_EDGE or v < -_EDGE or u + v > 1.0 + _EDGE:
                continue
            if level is not None:
                cells[at + count], heights[at + count] = i * nz + j, a[1] + u * uy + v * vy
                level[at + count] = abs(area) >= flat * length
            count += 1
    return count


@helper
def nearest(heights, x, z, y):
    """Which surface of a cell is nearest to a height; -1 where there is none."""
    best = -1
    for k in range(heights.shape[2]):
        if not math.isnan(heights[x, z, k]) and (best < 0 or abs(heights[x, z, k] - y) < abs(heights[x, z, best] - y)):
            best = k
    return best


@helper
def _below(heights, x, z, y):
    """The height of the highest surface of a cell that is no higher than y; NaN where there is none."""
    found = np.nan
    for k in range(heights.shape[2]):
        if heights[x, z, k] <= y:
            found = heights[x, z, k]
    return found


@kernel
def under(heights, x0, z0, cell, points, main, slack, found):
    """Heights of the ground under points ``[n, 3]``, the nearest that is lower than `slack` above each of them.

    Where a point's height is NaN, the ground nearest to `main`. Between the centres of four cells it is bilinear over
    those that differ by no more than a cell from the nearest centre's: slopes are smooth, and steps stay steps. What
    lies outside the map, or over none, stays as it is in `found`.
    """
    nx, nz, _ = heights.shape
    for n in range(len(points)):
        gx, gz, y = (points[n, 0] - x0) / cell, (points[n, 2] - z0) / cell, points[n, 1] + slack
        if not (-0.5 <= gx <= nx - 0.5 and -0.5 <= gz <= nz - 0.5):
            continue
        i, j = min(int(gx + 0.5), nx - 1), min(int(gz + 0.5), nz - 1)
        if math.isnan(y):
            k = nearest(heights, i, j, main)
            here = heights[i, j, k] if k >= 0 else np.nan
        else:
            here = _below(heights, i, j, y)
        if math.isnan(here):
            continue
        gx, gz = min(max(gx, 0.0), nx - 1.0), min(max(gz, 0.0), nz - 1.0)
        total, weight = 0.0, 0.0
        for a in range(2):
            for b in range(2):
                p, q = min(int(gx) + a, nx - 1), min(int(gz) + b, nz - 1)
                share = abs(1 - a - gx + int(gx)) * abs(1 - b - gz + int(gz))
                k = nearest(heights, p, q, here)
                if k >= 0 and abs(heights[p, q, k] - here) <= cell:
                    total, weight = total + share * (heights[p, q, k] - here), weight + share
        found[n] = here + total / weight if weight > 0 else here


@kernel
def steep(heights, cell, step, limit):
    """Whether each surface rises by more than `limit` (m/m).

    Along either axis it is followed over `BASE` cells to both sides, as long as it changes by no more than `step` from
    one to the next. A slope is where both the mean and the median of the changes are one: the mean forgives noise, the
    median steps.
    """
    nx, nz, layers = heights.shape
    result = np.zeros(heights.shape, np.bool_)
    changes = np.empty(2 * BASE)
    for i in range(nx):
        for j in range(nz):
            for k in range(layers):
                if math.isnan(heights[i, j, k]):
                    continue
                for median in (False, True):  # what is flat by the means needs no medians
                    slope = _slope(heights, i, j, k, 0, step, median, changes) ** 2
                    slope += _slope(heights, i, j, k, 1, step, median, changes) ** 2
                    result[i, j, k] = slope > (limit * cell) ** 2
                    if not result[i, j, k]:
                        break
    return result


@helper
def _slope(heights, i, j, k, axis, step, median, changes):
    """Change of height from cell to cell along one axis around a cell: the mean, or the median where that is less."""
    count = _followed(heights, i, j, k, axis, step, changes)
    if count < 2:
        return 0.0
    total = 0.0
    for n in range(count):
        total += changes[n]
    mean = total / count
    if not median:
        return mean
    middle = np.median(changes[:count])
    return min(abs(mean), abs(middle)) if mean * middle > 0 else 0.0


@helper
def _followed(heights, i, j, k, axis, step, changes):
    """Changes of height from cell to cell along one axis around a cell; how many there are."""
    nx, nz, _ = heights.shape
    count = 0
    for way in (-1, 1):
        x, z, layer = i, j, k
        for _ in range(BASE):
            p, q = (x + way, z) if axis == 0 else (x, z + way)
            if not (0 <= p < nx and 0 <= q < nz):
                break
            on = nearest(heights, p, q, heights[x, z, layer])
            if on < 0 or abs(heights[p, q, on] - heights[x, z, layer]) > step:
                break
            changes[count] = way * (heights[p, q, on] - heights[x, z, layer])
            count += 1
            x, z, layer = p, q, on
    return count


@kernel
def grown(heights, seeds, limit):
    """Surfaces that hang together with some, one a cell: from seeds ``[X, Z]`` (-1 for none) over rises up to `limit`.

    What is reached in fewer cells takes a cell first.
    """
    nx, nz, _ = heights.shape
    result = seeds.copy()
    queue = np.empty(nx * nz, np.int64)
    end = 0
    for i in range(nx):
        for j in range(nz):
            if seeds[i, j] >= 0:
                queue[end] = i * nz + j
                end += 1
    begin = 0
    while begin < end:
        i, j = queue[begin] // nz, queue[begin] % nz
        begin += 1
        here = heights[i, j, result[i, j]]
        for p, q in ((i - 1, j), (i + 1, j), (i, j - 1), (i, j + 1)):
            if 0 <= p < nx and 0 <= q < nz and result[p, q] < 0:
                k = nearest(heights, p, q, here)
                if k >= 0 and abs(heights[p, q, k] - here) <= limit:
                    result[p, q] = k
                    queue[end] = p * nz + q
                    end += 1
    return result
