"""A building of five storeys, and what its blocks cost: time, memory, errors against the oracle, queries."""

from __future__ import annotations

import json
import math
import subprocess
import sys
import time
from collections.abc import Sequence
from statistics import median
from typing import Any

import numpy as np
import torch

from scenectl.bench.engine import ENGINE, Engine, Result, Row
from scenectl.bench.process import environment, python
from scenectl.generators.base import Progress
from scenectl.threads import threads
from scenes.errors import UserError
from scenes.mesh.content import joined
from scenes.mesh.mesh import Mesh
from scenes.mesh.surface import Surface
from scenes.sdf.bake import bake
from scenes.sdf.bake_blocks import bake_blocks
from scenes.sdf.blocks import SdfBlocks

WIDTH, HEIGHT, STOREYS = 50.0, 20.0, 5
_STOREY = HEIGHT / STOREYS
_SLAB, _OUTER, _INNER = 0.3, 0.35, 0.14  # thickness of floors, outer and inner walls (m)
_POINTS = 11_760  # 196 frames of 60 points


def building(seed: int = 0, width: float = WIDTH) -> Mesh:
    """Storeys of 4 m with rooms, doors, windows, two staircases, pillars and furniture; one closed mesh.

    Args:
        seed: of the plan.
        width: metres along x and z, 10 or more.
    """
    import manifold3d

    rng = np.random.default_rng(seed)
    add, cut = [], []
    for storey in range(STOREYS):
        floor = storey * _STOREY
        lines = [_walls(rng, width), _walls(rng, width)]
        wells = storey > 0
        for i in range(len(lines[0]) - 1):
            for k in range(len(lines[1]) - 1):
                low = np.array([lines[0][i][1], floor + _SLAB, lines[1][k][1]])
                high = np.array([lines[0][i + 1][0], floor + _STOREY - (0.1 if storey == STOREYS - 1 else 0.0), 0.0])
                high[2] = lines[1][k + 1][0]
                cut.append(_box(low, high))
                cut += _openings(rng, low, high, width)
                if min(high[0] - low[0], high[2] - low[2]) > 2.0:
                    add += _furniture(rng, low, high)
        for corner in (0.4, width - 7.4):  # staircases, and the holes above them
            if wells:
                cut.append(_box((corner, floor - 0.01, corner), (corner + 1.3, floor + _SLAB + 0.01, corner + 5.4)))
            add += _stairs(corner, floor) if storey < STOREYS - 1 else []
    shell = _box((0, 0, 0), (width, HEIGHT, width))
    carved = shell - manifold3d.Manifold.batch_boolean(cut, manifold3d.OpType.Add)
    pieces = joined([_triangles(solid) for solid in (carved, *add)])
    return Mesh(*pieces, f"building {width:g} x {HEIGHT:g} x {width:g} m")


def _walls(rng: np.random.Generator, width: float) -> list[tuple[float, float]]:
    """Both sides of the walls along one axis, outer ones included."""
    inner, at = [], _OUTER
    while width - at > 8.5:
        at += float(rng.uniform(3.5, 7.0))
        inner.append((at - _INNER / 2, at + _INNER / 2))
    return [(0.0, _OUTER), *inner, (width - _OUTER, width)]


def _openings(rng: np.random.Generator, low: np.ndarray, high: np.ndarray, width: float) -> list[Any]:
    """A door through the walls towards +x and +z, and windows where these or those opposite are outer ones."""
    found = []
    for axis in (0, 2):
        along = 2 - axis
        room = high[along] - low[along]
        at = low[along] + rng.uniform(0.2, max(0.3, room - 1.2))
        outer = high[axis] > width - 2 * _OUTER
        for side, is_window in ((high[axis], outer), (low[axis] - _OUTER, low[axis] < 2 * _OUTER)):
            if side != high[axis] and not is_window:
                continue
            size = np.array([0.0, 1.4 if is_window else 2.1, 0.0])
            begin = np.array([0.0, low[1] + (0.9 if is_window else 0.0), 0.0])
            begin[axis], size[axis] = side - 0.01, _OUTER + 0.02
            begin[along], size[along] = at, (min(1.8, room - 0.4) if is_window else 0.9)
            found.append(_box(begin, begin + size))
    return found


def _stairs(corner: float, floor: float) -> list[Any]:
    """Twenty steps up one storey."""
    rise, going = _STOREY / 20, 0.25
    return [
        _box(
            (corner + 0.1, floor + _SLAB - 0.005 + max(0, n - 1) * rise, corner + 0.2 + n * going),
            (corner + 1.2, floor + _SLAB + (n + 1) * rise, corner + 0.2 + (n + 1) * going + 0.02),
        )
        for n in range(19)
    ]


def _furniture(rng: np.random.Generator, low: np.ndarray, high: np.ndarray) -> list[Any]:
    """A table with chairs, shelves, a lamp, a pillar and boxes, where they fit."""
    import manifold3d

    size, y = high - low, low[1] - 0.005
    x, z = low[0] + size[0] * rng.uniform(0.35, 0.65), low[2] + size[2] * rng.uniform(0.35, 0.65)
    turn = float(rng.choice([0.0, 0.0, 90.0, rng.uniform(0, 90)]))
    table = [_box((-0.8, 0.71, -0.45), (0.8, 0.74, 0.45))]
    table += [_box((a - 0.025, 0, b - 0.025), (a + 0.025, 0.72, b + 0.025)) for a in (-0.74, 0.74) for b in (-0.4, 0.4)]
    for side in (-1, 1):
        chair = [_box((-0.22, 0.43, -0.22), (0.22, 0.46, 0.22)), _box((-0.22, 0.44, 0.19), (0.22, 0.9, 0.22))]
        chair += [
            _box((a - 0.02, 0, b - 0.02), (a + 0.02, 0.44, b + 0.02)) for a in (-0.19, 0.19) for b in (-0.19, 0.19)
        ]
        table += [part.rotate((0, 90 - 90 * side, 0)).translate((0, 0, side * 0.75)) for part in chair]
    found = [part.rotate((0, turn, 0)).translate((x, y, z)) for part in table]
    shelf = [_box((0, h, 0), (1.2, h + 0.02, 0.3)) for h in (0.05, 0.45, 0.85, 1.25, 1.65)]
    shelf += [_box((a, 0, 0), (a + 0.02, 1.8, 0.3)) for a in (0.0, 1.18)]
    found += [part.translate((low[0] + 0.3, y, high[2] - 0.36)) for part in shelf]
    lamp = manifold3d.Manifold.sphere(0.18, 20).translate((x, low[1] + 2.4, z))
    pillar = manifold3d.Manifold.cylinder(size[1] + 0.01, 0.2, 0.2, 32).rotate((-90, 0, 0))
    found += [lamp, pillar.translate((high[0] - 0.6, y, high[2] - 0.6))]
    for _ in range(3):
        a, b = rng.uniform(low[[0, 2]] + 0.6, high[[0, 2]] - 0.6)
        edge = rng.uniform(0.2, 0.6, 3)
        found.append(_box((0, 0, 0), edge).rotate((0, float(rng.uniform(0, 90)), 0)).translate((a, y, b)))
    return found


def _box(low: Sequence[float | int] | np.ndarray, high: Sequence[float | int] | np.ndarray) -> Any:
    import manifold3d

    low, high = np.asarray(low, dtype=np.float64), np.asarray(high, dtype=np.float64)
    return manifold3d.Manifold.cube(tuple(high - low)).translate(tuple(low))


def _triangles(solid: Any) -> tuple[np.ndarray, np.ndarray]:
    mesh = solid.to_mesh64()
    return np.asarray(mesh.vert_properties)[:, :3], np.asarray(mesh.tri_verts).astype(np.int64)


# ------------------------------------------------------------------------------------------------------------ measuring


def bench_building(spacing: float = 0.02, width: float = WIDTH, seed: int = 0, engine: Engine = ENGINE) -> Result:
    """Bake a building in a process of its own, and compare its blocks with libigl's distances and a dense grid's speed.

    Args:
        spacing: of the finest nodes, metres.
        width: of the building, metres.
        seed: of its plan and of the points that are compared.
        engine: tells progress, keeps what was measured and takes it again.
    """

    def measured(width: float) -> list[Row]:
        return [_measured(spacing, width, seed, engine.progress)]

    settings = {"bench": "building", "spacing": spacing, "width": width, "seed": seed}
    found = engine.run([("building", width)], measured, lambda rows: rows[0], settings)
    return {**found, "rows": []}


def _measured(spacing: float, width: float, seed: int, progress: Progress) -> Row:
    import tempfile
    from pathlib import Path

    with tempfile.TemporaryDirectory() as folder:
        where = Path(folder) / "blocks.npz"
        progress("baking", 0.1)
        call = python("-m", "scenectl.bench.scenes.building", str(where), str(spacing), str(width), str(seed))
        done = subprocess.run(call, env=environment(), capture_output=True, text=True, check=False)
        if done.returncode:
            raise UserError(f"the building could not be baked: {(done.stderr.strip().splitlines() or ['killed'])[-1]}")
        facts = json.loads(done.stdout)
        field = SdfBlocks.load(where)
    mesh = building(seed, width)
    progress("comparing", 0.6)
    errors = _errors(field, mesh, seed)
    progress("asking", 0.9)
    return {
        "size_m": " x ".join(f"{length:g}" for length in np.ptp(mesh.bounds, axis=0).round(3)),
        "triangles": len(mesh.faces),
        "spacing_m": spacing,
        "dense_mb": 4 * math.prod(field.shape) / 1e6,
        "grid_mb": field.nbytes / 1e6,
        **facts,
        "blocks": " + ".join(str(len(of_level)) for of_level in field.blocks),
        "finest_share": field.finest,
        **errors,
        **_speed(field, mesh, seed),
    }


def _errors(field: SdfBlocks, mesh: Mesh, seed: int, samples: int = 6000) -> dict[str, Any]:
    """Errors (m, voxels) at points near the surface and at points anywhere, and wrong signs among both."""
    surface, rng = Surface.of(mesh), np.random.default_rng(seed)
    on = surface.points_on(surface.by_area(samples, rng), rng) + surface.centre
    near = on + rng.normal(0.0, 2 * field.spacing, (samples, 3))
    anywhere = rng.uniform(mesh.bounds[0], mesh.bounds[1], size=(samples, 3))
    points = np.concatenate([near, anywhere])
    exact = surface.unsigned_distance(points)
    solid = np.abs(surface.winding_fast(points)) > 0.5
    found = field.distance(torch.from_numpy(points)).numpy()
    error = np.abs(found - np.where(solid, -exact, exact))
    close, air = exact <= 2 * field.spacing, ~solid
    voxels = error / field.spacing
    wrong = (solid != (found < 0)) & (exact > 0.25 * field.spacing)
    return {
        "near_mean_error_voxels": float(voxels[close].mean()),
        "near_99_percent_voxels": float(np.quantile(voxels[close], 0.99)),
        "near_max_error_voxels": float(voxels[close].max()),
        "air_mean_error_m": float(error[air & ~close].mean()),
        "air_99_percent_m": float(np.quantile(error[air & ~close], 0.99)),
        "air_max_error_m": float(error[air & ~close].max()),
        "solid_mean_error_m": float(error[~air & ~close].mean()),
        "sign_errors": f"{int(wrong.sum())} of {len(points)}",
    }


def _speed(field: SdfBlocks, mesh: Mesh, seed: int) -> dict[str, float]:
    """Median milliseconds of a value with its gradient at `_POINTS` points, beside a dense grid of 256 nodes."""
    dense = bake(mesh, 256, cache=None).grid
    low, high = mesh.bounds
    walk = np.random.default_rng(seed).uniform(low, low + np.minimum(high - low, 4.0), (_POINTS, 3))
    points = torch.from_numpy(walk).float().requires_grad_()
    times: dict[str, list[float]] = {"blocks": [], "dense": []}
    with threads(1):
        for name, grid in 25 * (("blocks", field), ("dense", dense)):
            begin = time.perf_counter()
            torch.autograd.grad(grid.distance(points).sum(), points)
            times[name].append(1000 * (time.perf_counter() - begin))
    return {f"query_{name}_ms": median(taken) for name, taken in times.items()}


def _bake_here(path: str, spacing: str, width: str, seed: str) -> None:
    """What the process of its own does: bake, and print what that took as JSON."""
    import resource

    mesh = building(int(seed), float(width))
    bake_blocks(building(int(seed), 10.0), 0.1, cache=None)  # compiled code comes from the disk, or is put there
    begin, used = time.perf_counter(), time.process_time()
    field = bake_blocks(mesh, float(spacing), cache=None).grid
    facts = {"bake_wall_s": time.perf_counter() - begin, "bake_cpu_s": time.process_time() - used}
    facts["peak_rss_mb"] = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1000
    field.save(path)
    print(json.dumps(facts))


if __name__ == "__main__":
    _bake_here(*sys.argv[1:])
