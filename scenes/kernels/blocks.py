"""Sparse blocks: which triangles are near, exact distances from few of them, how fine a cell has to be, and queries.

Lengths are voxels of the fine lattice. A cell spans `CELL` of them along each axis, a brick `BRICK` cells. A cell of
level n is divided into 2^n parts along each axis; one of level 0 has no block and is read from the coarse nodes.
"""

from __future__ import annotations

import math

import numpy as np

from scenes.kernels import helper, kernel
from scenes.kernels.query import left, trilinear
from scenes.kernels.triangles import framed, planar_squared, squared_distance

CELL = 8
BRICK = 8
SIDE = CELL * BRICK
LEVELS = 3
STEPS = 1024
"""Stored numbers are multiples of the fine spacing over this."""

_SOLID = np.float32(0.5)  # share of the depth by which a distance inside a solid may err
_FEW = 12  # triangles from which on a cell is measured in eight parts


@kernel
def near_bricks(vertices, faces, shape, reach):
    """Which triangles come within `reach` of each brick, at least: offsets ``[bricks + 1]``, triangles ascending."""
    nx, ny, nz = shape
    radius = SIDE * math.sqrt(3.0) / 2.0 + reach
    counts = np.zeros(nx * ny * nz, np.int64)
    offsets, members = _listed(counts)
    for _ in range(2):  # count, then list
        counts[:] = 0
        for f in range(len(faces)):
            low_x, high_x = _span(vertices, faces, f, 0, reach, nx)
            low_y, high_y = _span(vertices, faces, f, 1, reach, ny)
            low_z, high_z = _span(vertices, faces, f, 2, reach, nz)
            single = low_x == high_x and low_y == high_y and low_z == high_z
            frame = framed(vertices, faces, f)
            for x in range(low_x, high_x + 1):
                for y in range(low_y, high_y + 1):
                    for z in range(low_z, high_z + 1):
                        cx, cy, cz = SIDE * (x + 0.5), SIDE * (y + 0.5), SIDE * (z + 0.5)
                        if not single and math.sqrt(squared_distance(frame, cx, cy, cz)) > radius:
                            continue
                        _entered(offsets, members, counts, (x * ny + y) * nz + z, f)
        if len(members) == 0:
            offsets, members = _listed(counts)
    return offsets, members


@helper
def _listed(counts):
    """Where the list of each place begins, ``[len(counts) + 1]``, and room for what all of them hold."""
    offsets = np.zeros(len(counts) + 1, np.int64)
    offsets[1:] = np.cumsum(counts)
    return offsets, np.empty(offsets[-1], np.int32)


@helper
def _entered(offsets, members, counts, place, f):
    """Count a triangle at a place, and enter it where there is room."""
    if len(members) > 0:
        members[offsets[place] + counts[place]] = f
    counts[place] += 1


@helper
def _span(vertices, faces, f, axis, reach, count):
    """First and last brick along an axis that a triangle's bounds come within `reach` of."""
    a, b, c = vertices[faces[f, 0], axis], vertices[faces[f, 1], axis], vertices[faces[f, 2], axis]
    low, high = math.floor((min(a, b, c) - reach) / SIDE), math.floor((max(a, b, c) + reach) / SIDE)
    return max(low, 0), min(high, count - 1)


@kernel
def over_columns(vertices, faces, nx, nz):
    """Which triangles lie above or below each column of bricks: offsets ``[columns + 1]`` and triangles, ascending."""
    counts = np.zeros(nx * nz, np.int64)
    offsets, members = _listed(counts)
    for _ in range(2):  # count, then list
        counts[:] = 0
        for f in range(len(faces)):
            low_x, high_x = _span(vertices, faces, f, 0, 1.0, nx)
            low_z, high_z = _span(vertices, faces, f, 2, 1.0, nz)
            for x in range(low_x, high_x + 1):
                for z in range(low_z, high_z + 1):
                    if _misses(vertices, faces, f, SIDE * (x + 0.5), SIDE * (z + 0.5), SIDE / 2 + 1.0):
                        continue
                    _entered(offsets, members, counts, x * nz + z, f)
        if len(members) == 0:
            offsets, members = _listed(counts)
    return offsets, members


@helper
def _misses(vertices, faces, f, x, z, half):
    """True where one side of a triangle, seen along y, has the triangle and a square on different sides."""
    for corner in range(3):
        i, j, k = faces[f, corner], faces[f, (corner + 1) % 3], faces[f, (corner + 2) % 3]
        nx, nz = vertices[j, 2] - vertices[i, 2], vertices[i, 0] - vertices[j, 0]
        other = (vertices[k, 0] - vertices[i, 0]) * nx + (vertices[k, 2] - vertices[i, 2]) * nz
        middle = (x - vertices[i, 0]) * nx + (z - vertices[i, 2]) * nz
        reach = half * (abs(nx) + abs(nz))
        if (other >= 0.0 and middle + reach < 0.0) or (other <= 0.0 and middle - reach > 0.0):
            return True
    return False


# ----------------------------------------------------------------------------------------------------------- measuring


@helper
def _row(frames, t):
    r = frames[t]
    return (
        r[0], r[1], r[2], r[3], r[4], r[5], r[6], r[7], r[8], r[9], r[10], r[11], r[12], r[13], r[14], r[15], r[16],
    )  # fmt: skip


@kernel
def _culled(frames, given, count, x, y, z, half, band, away, kept):
    """Those of `given` that may be the nearest to some point of a cube, into `kept`; 0 where none is within `band`.

    If t is nearest to a point p of the cube and s to its centre c, |c t| <= |p t| + R <= |p s| + R <= |c s| + 2 R.
    """
    radius = half * math.sqrt(3.0)
    least = np.inf
    for at in range(count):
        away[at] = math.sqrt(squared_distance(_row(frames, given[at]), x, y, z))
        least = min(least, away[at])
    if least - radius > band:
        return 0
    number = 0
    for at in range(count):
        if away[at] <= least + 2.0 * radius + 1e-6:
            kept[number] = given[at]
            number += 1
    return number


@kernel
def _measured(frames, given, count, corner, low, nodes, out, best):
    """Distances from some triangles on the nodes ``low <= node < low + nodes`` of a brick at `corner`."""
    for x in range(low[0], low[0] + nodes[0]):
        px = float(corner[0] + x)
        for y in range(low[1], low[1] + nodes[1]):
            py = float(corner[1] + y)
            pz = float(corner[2] + low[2])
            best[:] = np.inf
            for at in range(count):
                frame = _row(frames, given[at])
                ax, ay, az, ux, uy, uz, vx, vy, vz, nx, ny, nz, length, cx, cy, over_ac, over_bc = frame
                dx, dy = px - ax, py - ay
                n0, u0, v0 = dx * nx + dy * ny, dx * ux + dy * uy, dx * vx + dy * vy
                for z in range(len(best)):
                    dz = pz + z - az
                    n = n0 + dz * nz
                    flat = planar_squared(u0 + dz * uz, v0 + dz * vz, length, cx, cy, over_ac, over_bc, 1.0)
                    best[z] = min(best[z], n * n + flat)
            row = out[x, y]
            for z in range(nodes[2]):
                row[low[2] + z] = math.sqrt(best[z])


@kernel
def brick_distances(vertices, faces, members, corner, band, out, near):
    """Exact distances on all nodes of the cells of a brick that come within `band` of a triangle.

    Args:
        members: triangles near the brick.
        corner: fine node at which the brick begins, three integers.
        out: ``[SIDE + 1] * 3`` float32; other nodes are left alone.
        near: ``[BRICK] * 3`` uint8, 1 for those cells.

    Returns:
        whether there are any.
    """
    near[:] = 0
    count = len(members)
    frames = np.empty((count, 17))
    for at in range(count):
        frames[at] = framed(vertices, faces, members[at])
    lists = np.empty((5, count), np.int32)
    away = np.empty(count)
    best8, best9 = np.empty(8), np.empty(9)
    counts = np.zeros(5, np.int64)
    everyone = np.arange(count).astype(np.int32)
    half = SIDE / 2.0
    cx, cy, cz = corner[0] + half, corner[1] + half, corner[2] + half
    counts[0] = _culled(frames, everyone, count, cx, cy, cz, half, band, away, lists[0])
    if counts[0] == 0:
        return False
    m, found = 0, False
    while m < BRICK**3:  # cells along a Morton curve: what encloses a cell is culled before it
        x = (m >> 2 & 1) | (m >> 4 & 2) | (m >> 6 & 4)
        y = (m >> 1 & 1) | (m >> 3 & 2) | (m >> 5 & 4)
        z = (m & 1) | (m >> 2 & 2) | (m >> 4 & 4)
        skip = 0
        for depth in range(1, 4):
            cells = BRICK >> depth
            if m % cells**3 == 0:
                half = CELL * cells / 2.0
                cx, cy, cz = corner[0] + CELL * x + half, corner[1] + CELL * y + half, corner[2] + CELL * z + half
                given, kept = lists[depth - 1], lists[depth]
                counts[depth] = _culled(frames, given, counts[depth - 1], cx, cy, cz, half, band, away, kept)
                if counts[depth] == 0:
                    skip = cells**3
                    break
        if skip > 0:
            m += skip
            continue
        near[x, y, z] = 1
        found = True
        low = (CELL * x, CELL * y, CELL * z)
        if counts[3] <= _FEW:
            nodes = (CELL + 1, CELL + 1, CELL + 1)
            _measured(frames, lists[3], counts[3], corner, low, nodes, out, best9)
        else:
            _in_parts(frames, lists, counts, corner, low, out, away, best8[:5])
        m += 1
    return found


@kernel
def _in_parts(frames, lists, counts, corner, low, out, away, best):
    """Measure one cell in eight parts, each from the triangles that it needs."""
    half = CELL / 4.0
    step = CELL // 2
    for part in range(8):
        i, j, k = part >> 2, part >> 1 & 1, part & 1
        start = (low[0] + step * i, low[1] + step * j, low[2] + step * k)
        cx, cy, cz = corner[0] + start[0] + half, corner[1] + start[1] + half, corner[2] + start[2] + half
        counts[4] = _culled(frames, lists[3], counts[3], cx, cy, cz, half, np.inf, away, lists[4])
        _measured(frames, lists[4], counts[4], corner, start, (step + i, step + j, step + k), out, best)


# -------------------------------------------------------------------------------------------------------------- signs


@kernel
def signed_by_rays(counts, first, low, high, distance):
    """Turn distances of a brick negative where the winding number of the lines along y is outside ``low .. high``.

    Args:
        counts: ``[x, z, y]`` winding numbers of the whole column.
        first: fine node along y at which the brick begins.
    """
    n = distance.shape[0]
    for x in range(n):
        for z in range(n):
            for y in range(n):
                w = counts[x, z, first + y]
                if not low <= w <= high:
                    distance[x, y, z] = -distance[x, y, z]


@kernel
def summed(counts):
    """Crossings become winding numbers along the last axis, in place."""
    for x in range(counts.shape[0]):
        for z in range(counts.shape[1]):
            w = 0
            for y in range(counts.shape[2]):
                w -= counts[x, z, y]
                counts[x, z, y] = w


@kernel
def filled(coarse, out):
    """Put distances between the coarse nodes of a brick (voxels) on those of its nodes that have not been measured."""
    for i in range(BRICK):
        for j in range(BRICK):
            for k in range(BRICK):
                for x in range(CELL + 1):
                    for y in range(CELL + 1):
                        for z in range(CELL + 1):
                            a, b, c = CELL * i + x, CELL * j + y, CELL * k + z
                            if np.isinf(out[a, b, c]):
                                out[a, b, c] = trilinear(coarse, i, j, k, 1, x / CELL, y / CELL, z / CELL)


@kernel
def settled(spacing, near, distance, coarse, keep):
    """Corners of near cells are measured: give them (m) to the coarse nodes, which give their signs first if `keep`."""
    for i in range(BRICK):
        for j in range(BRICK):
            for k in range(BRICK):
                if near[i, j, k]:
                    for corner in range(8):
                        x, y, z = i + (corner >> 2), j + (corner >> 1 & 1), k + (corner & 1)
                        d = distance[CELL * x, CELL * y, CELL * z]
                        if keep and (d < 0) != (coarse[x, y, z] < 0):
                            d = -d
                            distance[CELL * x, CELL * y, CELL * z] = d
                        coarse[x, y, z] = d * spacing


# ------------------------------------------------------------------------------------------------------------- levels


@helper
def _suffices(v, x0, y0, z0, level, tolerance, slope):
    """Whether a cell of this level is true to `v` on all fine nodes."""
    s = CELL >> level
    one = np.float32(1.0) / np.float32(s)
    for i in range(x0, x0 + CELL, s):
        for j in range(y0, y0 + CELL, s):
            for k in range(z0, z0 + CELL, s):
                for x in range(s + 1):
                    for y in range(s + 1):
                        fx, fy = x * one, y * one
                        # the ends of this row in the interpolant
                        a = v[i, j, k] + (v[i + s, j, k] - v[i, j, k]) * fx
                        b = v[i, j + s, k] + (v[i + s, j + s, k] - v[i, j + s, k]) * fx
                        c = v[i, j, k + s] + (v[i + s, j, k + s] - v[i, j, k + s]) * fx
                        d = v[i, j + s, k + s] + (v[i + s, j + s, k + s] - v[i, j + s, k + s]) * fx
                        begin = a + (b - a) * fy
                        step = (c + (d - c) * fy - begin) * one
                        row = v[i + x, j + y]
                        worst = np.float32(0.0)
                        for z in range(s + 1):
                            true = row[k + z]
                            allowed = max(tolerance, slope * true, -_SOLID * true)
                            worst = max(worst, abs(begin + step * z - true) - allowed)
                        if worst > 0:
                            return False
    return True


@kernel
def chosen(v, near, tolerance, slope, level):
    """For each near cell the lowest level whose interpolant errs by `tolerance` or `slope` times the distance at most.

    Inside solids, where no body is, half of the distance is allowed: thin walls cost most otherwise. The finest level
    is right by definition. Returns how many cells have each level.
    """
    counts = np.zeros(LEVELS + 1, np.int64)
    tolerance, slope = np.float32(tolerance), np.float32(slope)
    for i in range(BRICK):
        for j in range(BRICK):
            for k in range(BRICK):
                level[i, j, k] = 0
                if near[i, j, k]:
                    n = 0
                    while n < LEVELS and not _suffices(v, CELL * i, CELL * j, CELL * k, n, tolerance, slope):
                        n += 1
                    level[i, j, k] = n
                    counts[n] += 1
    return counts


@kernel
def gathered(v, level, wanted, cells, values):
    """Nodes of the cells of one level, in multiples of 1 / `STEPS`, and where those cells lie in the brick."""
    n, s = (1 << wanted) + 1, CELL >> wanted
    at = 0
    for i in range(BRICK):
        for j in range(BRICK):
            for k in range(BRICK):
                if level[i, j, k] != wanted:
                    continue
                cells[at, 0], cells[at, 1], cells[at, 2] = i, j, k
                for x in range(n):
                    for y in range(n):
                        for z in range(n):
                            d = v[CELL * i + s * x, CELL * j + s * y, CELL * k + s * z]
                            values[at, x, y, z] = np.int16(round(min(max(d * STEPS, -32767.0), 32767.0)))
                at += 1


@helper
def _level(index, x, y, z):
    """Level of a cell; the finest for what is outside the grid, which constrains nothing."""
    if x < 0 or y < 0 or z < 0 or x >= index.shape[0] or y >= index.shape[1] or z >= index.shape[2]:
        return LEVELS
    return index[x, y, z] % LEVELS + 1 if index[x, y, z] >= 0 else 0


@kernel
def joined(index, cells, level, values, begin, end):
    """Make the interpolant continuous: what cells share takes the interpolant of the coarsest among them.

    Edges first, for which the four cells around them count, then the inner nodes of faces. Blocks change only their
    own nodes and look only at the levels of others, so that their order does not matter.
    """
    n = 1 << level
    levels = _turned(index)
    for at in range(begin, end):
        nodes = _turned(values[at])
        for axis in range(3):
            i, x, y, z = levels[axis], cells[at, axis], cells[at, (axis + 1) % 3], cells[at, (axis + 2) % 3]
            for side in range(4):
                a, b = side >> 1, side & 1
                beside, above = y + 2 * a - 1, z + 2 * b - 1
                least = min(_level(i, x, beside, z), _level(i, x, y, above), _level(i, x, beside, above))
                if least < level:
                    _straighten(nodes[axis][:, a * n, b * n], 1 << (level - least))
        for axis in range(3):
            i, x, y, z = levels[axis], cells[at, axis], cells[at, (axis + 1) % 3], cells[at, (axis + 2) % 3]
            for side in range(2):
                least = _level(i, x + 2 * side - 1, y, z)
                if least < level:
                    _flatten(nodes[axis][side * n], 1 << (level - least))


@helper
def _turned(v):
    """Views of an array that begin with its first, second and third axis, the others following in a ring."""
    return v.transpose((0, 1, 2)), v.transpose((1, 2, 0)), v.transpose((2, 0, 1))


@helper
def _straighten(row, s):
    """The nodes of an edge become linear between every `s`-th."""
    for t in range(1, len(row) - 1):
        if t % s:
            first = t // s * s
            low, high = float(row[first]), float(row[first + s])
            row[t] = np.int16(round(low + (high - low) * (t - first) / s))


@helper
def _flatten(face, s):
    """The inner nodes of a face become bilinear between every `s`-th."""
    n = len(face) - 1
    for a in range(1, n):
        for b in range(1, n):
            if a % s == 0 and b % s == 0:
                continue
            i, j = a // s * s, b // s * s
            x, y = (a - i) / s, (b - j) / s
            k, m = min(i + s, n), min(j + s, n)
            low = float(face[i, j]) * (1 - y) + float(face[i, m]) * y
            high = float(face[k, j]) * (1 - y) + float(face[k, m]) * y
            face[a, b] = np.int16(round(low + (high - low) * x))


@kernel
def adopted(index, cells, level, blocks, values):
    """Nodes that several blocks share take the number of the first cell that stores them.

    Args:
        cells: of the blocks in `values`, all of one `level`.
        blocks: those of all levels.
    """
    n, s = 1 << level, CELL >> level
    for at in range(len(values)):
        for a in range(n + 1):
            for b in range(n + 1):
                for c in range(n + 1):
                    if 0 < a < n and 0 < b < n and 0 < c < n:
                        continue
                    x, y, z = CELL * cells[at, 0] + s * a, CELL * cells[at, 1] + s * b, CELL * cells[at, 2] + s * c
                    values[at, a, b, c] = _first(index, blocks, x, y, z, values[at, a, b, c])


@helper
def _first(index, blocks, x, y, z, otherwise):
    """What the first cell that stores a fine node has there."""
    for i in range((x - 1) // CELL, x // CELL + 1):
        for j in range((y - 1) // CELL, y // CELL + 1):
            for k in range((z - 1) // CELL, z // CELL + 1):
                if i < 0 or j < 0 or k < 0 or i >= index.shape[0] or j >= index.shape[1] or k >= index.shape[2]:
                    continue
                number = index[i, j, k]
                if number < 0:
                    continue
                s = CELL >> (number % LEVELS + 1)
                a, b, c = x - CELL * i, y - CELL * j, z - CELL * k
                if a % s == 0 and b % s == 0 and c % s == 0:
                    return blocks[number % LEVELS][number // LEVELS, a // s, b // s, c // s]
    return otherwise


# ------------------------------------------------------------------------------------------------------------ queries


@helper
def _split(local, cells):
    """Cell and place in it, 0 to 1, of a coordinate that is clamped to the grid."""
    cell = min(int(local), cells - 1)
    return cell, local - cell


@helper
def _collapsed(v, i, j, k, x, y, z, unit, out):
    """Trilinear value and its derivatives by cell, times `unit`, into ``out[4]``."""
    v000, v001, v010, v011 = float(v[i, j, k]), float(v[i, j, k + 1]), float(v[i, j + 1, k]), float(v[i, j + 1, k + 1])
    i += 1
    v100, v101, v110, v111 = float(v[i, j, k]), float(v[i, j, k + 1]), float(v[i, j + 1, k]), float(v[i, j + 1, k + 1])
    z00, z01, z10, z11 = v001 - v000, v011 - v010, v101 - v100, v111 - v110
    f00, f01, f10, f11 = v000 + z00 * z, v010 + z01 * z, v100 + z10 * z, v110 + z11 * z
    y0, y1 = f01 - f00, f11 - f10
    f0, f1 = f00 + y0 * y, f10 + y1 * y
    low, high = z00 + (z01 - z00) * y, z10 + (z11 - z10) * y
    out[0] = (f0 + (f1 - f0) * x) * unit
    out[1] = (f1 - f0) * unit
    out[2] = (y0 + (y1 - y0) * x) * unit
    out[3] = (low + (high - low) * x) * unit


@kernel
def queried(points, begin, end, origin, spacing, coarse, index, blocks, beyond, margin, value, gradient):
    """Value (m) and gradient at ``points[begin:end]``; `spacing` is that of the coarse nodes.

    Outside the grid as `left` says.
    """
    found = np.empty(4)
    unit = spacing / CELL / STEPS
    cells = (index.shape[0], index.shape[1], index.shape[2])
    for p in range(begin, end):
        lx = (float(points[p, 0]) - origin[0]) / spacing
        ly = (float(points[p, 1]) - origin[1]) / spacing
        lz = (float(points[p, 2]) - origin[2]) / spacing
        if np.isnan(lx + ly + lz):  # infinity minus infinity too
            value[p] = np.nan
            gradient[p] = np.nan
            continue
        cx = min(max(lx, 0.0), float(cells[0]))
        cy = min(max(ly, 0.0), float(cells[1]))
        cz = min(max(lz, 0.0), float(cells[2]))
        i, x = _split(cx, cells[0])
        j, y = _split(cy, cells[1])
        k, z = _split(cz, cells[2])
        number = index[i, j, k]
        parts = 1
        if number < 0:
            _collapsed(coarse, i, j, k, x, y, z, 1.0, found)
        else:
            level, at = number % LEVELS, number // LEVELS
            parts = 2 << level
            a, x = _split(x * parts, parts)
            b, y = _split(y * parts, parts)
            c, z = _split(z * parts, parts)
            _collapsed(blocks[level][at], a, b, c, x, y, z, unit, found)
        over = parts / spacing
        ox, oy, oz = (lx - cx) * spacing, (ly - cy) * spacing, (lz - cz) * spacing
        value[p] = found[0]
        squared, turn, share = ox * ox + oy * oy + oz * oz, 0.0, 1.0
        if squared != 0.0:
            squared += 2.0 * margin * (abs(ox) + abs(oy) + abs(oz))
            value[p], turn, share = left(found[0], squared, beyond)
        # Along an axis on which a point was clamped the interpolant is constant, and only the way there changes.
        gradient[p, 0] = found[1] * over * share if ox == 0.0 else (ox + math.copysign(margin, ox)) * turn
        gradient[p, 1] = found[2] * over * share if oy == 0.0 else (oy + math.copysign(margin, oy)) * turn
        gradient[p, 2] = found[3] * over * share if oz == 0.0 else (oz + math.copysign(margin, oz)) * turn
