"""Value and gradient of a distance grid at many points: processor seconds of one thread, beside other libraries."""

from __future__ import annotations

import importlib
import json
import os
import platform
import subprocess
import sys
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch import Tensor

from scenectl.bench.engine import ENGINE, Engine, Result, Row
from scenectl.bench.process import environment, python
from scenectl.threads import threads
from scenes.body.body import DEFAULT_BODY
from scenes.errors import UserError, did_you_mean
from scenes.files import atomic_write
from scenes.mesh.mesh import Mesh
from scenes.motion.bones import rest_pose
from scenes.sdf.bake import bake
from scenes.sdf.grid import SdfGrid, interpolate
from scenes.sdf.lattice import Lattice
from scenes.world.scene import bundled

FRAMES, SAMPLES = 196, 60
COUNTS = (FRAMES * SAMPLES, 32 * FRAMES * SAMPLES)
"""One motion of 196 frames and 60 points on the body, and a batch of 32: 11,760 and 376,320 points."""

PATTERNS = ("body", "uniform")
"""Points on people who walk, as goals ask for them; or anywhere in the grid, which is all waiting for memory."""

COMPARED = ("scenectl", "grid_sample")
"""The methods whose ratio is the speedup."""

Method = Callable[[], Any]


def bench_query(
    scene: str = "living_room",
    resolution: int = 256,
    repeats: int = 15,
    seed: int = 0,
    counts: tuple[int, ...] = COUNTS,
    patterns: tuple[str, ...] = ("body",),
    processes: int = 1,
    engine: Engine = ENGINE,
) -> Result:
    """Every method on the same grid of ``resolution ** 3`` nodes and the same float32 points, one thread.

    Methods take turns, and the median counts, in seconds that the process spent on a processor: what waiting for one
    takes says nothing about a method. All but `open3d` give value and gradient. `grid_sample` is torch's,
    with the points' change of units (a user's points are metres) and its backward; `torch` is our formula in torch.
    `open3d` runs where it can be imported, and gives exact distances to the triangles instead, and no gradient.

    With several `processes` each measures by itself, one after the other, in a fresh interpreter, and only the two
    methods whose ratio is wanted.

    Returns:
        `rows` of process, points, pattern, method, seconds, and `summary`: the machine, and for each count the smallest
        of the patterns' ratios of `grid_sample` to `scenectl`, of every process and the least of all.
    """
    for pattern in patterns:
        if pattern not in PATTERNS:
            raise UserError(f"unknown pattern '{pattern}'{did_you_mean(pattern, PATTERNS)}")
    if repeats < 1 or min(counts) < 1 or processes < 1:
        raise UserError(f"{repeats} repeats of {counts} points in {processes} processes; give 1 or more")
    bundled(scene)  # raises UserError for an unknown name
    asked = (scene, resolution, repeats, seed, counts, patterns)

    def measured(process: int) -> list[Row]:
        found = _measured(*asked) if processes == 1 else _measured_elsewhere(asked)
        return [{"process": process, **row} for row in found]

    def summary(rows: Sequence[Row]) -> dict[str, Any]:
        about = {"scene": scene, "resolution": resolution, "repeats": repeats, **machine()}
        return {**about, "processes": processes, "threads": 1, **_speedups(rows, counts, patterns, processes)}

    cases = [(f"process {process}", process) for process in range(1, processes + 1)]
    return engine.run(cases, measured, summary, {"bench": "query", "asked": asked, "processes": processes})


def _speedups(
    rows: Sequence[Row], counts: Sequence[int], patterns: Sequence[str], processes: int
) -> dict[str, float | str]:
    """For each count how many times faster than `grid_sample`: the least of patterns and processes, and of each."""
    found: dict[str, float | str] = {}
    for count in counts:
        ratios = [min(_ratio(rows, count, p, 1 + process) for p in patterns) for process in range(processes)]
        if processes > 1:
            found[f"speedup_{count}_each"] = ", ".join(f"{ratio:.2f}" for ratio in ratios)
        found[f"speedup_{count}"] = min(ratios)
    return found


def machine() -> dict[str, Any]:
    """The processor by its name, what torch's own kernels use of it, how many there are, and how busy they were."""
    named = [line for line in _lines(Path("/proc/cpuinfo")) if line.startswith("model name")]
    return {
        "processor": named[0].split(":", 1)[1].strip() if named else platform.processor() or platform.machine(),
        "torch_kernels": torch.backends.cpu.get_cpu_capability(),
        "processors": len(os.sched_getaffinity(0)),
        "load": round(os.getloadavg()[0], 2),
    }


def _lines(path: Path) -> list[str]:
    return path.read_text(encoding="utf-8", errors="replace").splitlines() if path.is_file() else []


def _measured(
    scene: str,
    resolution: int,
    repeats: int,
    seed: int,
    counts: Sequence[int],
    patterns: Sequence[str],
    names: Sequence[str] | None = None,
) -> list[dict[str, Any]]:
    """Rows of points, pattern, method, seconds, measured in this process: of all methods, or of those named."""
    mesh = bundled(scene).meshes[0]
    grid = bake(mesh, lattice=Lattice.cube(mesh.bounds, resolution, padding=0.1)).grid
    rows = []
    with threads(1):
        for count, pattern in ((c, p) for c in counts for p in patterns):
            points = make_points(grid, count, pattern, seed)
            found = methods(grid, mesh, points, names)
            seconds = _medians(found, repeats, calls=max(1, 200_000 // count))
            rows += [
                {"points": count, "pattern": pattern, "method": method, "seconds": value}
                for method, value in seconds.items()
            ]
    return rows


def _measured_elsewhere(asked: tuple[Any, ...]) -> Any:
    """The same from a process of its own, for `COMPARED` alone."""
    call = python("-m", "scenectl.bench.scenes.query", json.dumps((*asked, COMPARED)))
    done = subprocess.run(call, env=environment(), capture_output=True, text=True, check=False)
    if done.returncode:
        raise UserError(f"a process could not measure: {(done.stderr.strip().splitlines() or ['killed'])[-1]}")
    return json.loads(done.stdout.splitlines()[-1])


def methods(grid: SdfGrid, mesh: Mesh, points: Tensor, names: Sequence[str] | None = None) -> dict[str, Method]:
    """What can run here, by name; each call evaluates `points` ``[n, 3]`` (m) afresh and returns value and gradient."""
    found: dict[str, Method] = {
        "scenectl": lambda: _with_gradient(grid.distance, points),
        "grid_sample": lambda: _with_gradient(_grid_sample(grid), points),
        "torch": lambda: interpolate(points, grid.values, grid, with_gradient=True),
    }
    if names is not None:
        return {name: found[name] for name in names}
    if open3d := _imported("open3d"):
        found["open3d"] = _open3d(open3d, mesh, points)
    return found


def make_points(grid: SdfGrid, count: int, pattern: str, seed: int = 0) -> Tensor:
    """Points ``[count, 3]`` (m, float32): "uniform" in the grid, or on the bodies of people who walk through it."""
    noise = torch.Generator().manual_seed(seed)
    low, high = (torch.from_numpy(corner) for corner in grid.bounds)
    if pattern == "uniform":
        return (low + torch.rand(count, 3, generator=noise, dtype=torch.float64) * (high - low)).float()
    walkers = -(-count // (FRAMES * SAMPLES))
    chosen = torch.linspace(0, DEFAULT_BODY.count - 1, SAMPLES).round().long()
    body = DEFAULT_BODY.points_of(_walk(walkers, noise))[..., chosen, :]
    centre, half = (low + high) / 2, (high - low) / 2
    floor = centre - half * torch.tensor([0.0, 1.0, 0.0])
    return (floor + body).reshape(-1, 3)[:count].float().contiguous()


def _walk(walkers: int, noise: torch.Generator) -> Tensor:
    """Joints ``[walkers, FRAMES, 22, 3]`` (m) that swing while they walk to and fro around the origin at 1.2 m/s."""
    rest = rest_pose(DEFAULT_BODY.skeleton)
    rest[:, 1] -= rest[:, 1].min()
    phase, heading = 2 * torch.pi * torch.rand(2, walkers, 1, generator=noise, dtype=torch.float64)
    seconds = torch.arange(FRAMES, dtype=torch.float64) / 20
    swing = torch.sin(2 * torch.pi * 0.9 * seconds + phase)[..., None]  # two steps a cycle
    reach = rest[:, 0].sign() * (rest[:, 1] - rest[0, 1]).abs() * 0.35
    along = 1.5 * torch.asin(torch.sin(0.8 * seconds + phase))[..., None] + swing * reach
    ahead = torch.stack([heading.sin(), torch.zeros_like(heading), heading.cos()], dim=-1)
    return rest + along[..., None] * ahead[:, :, None]


def _with_gradient(function: Callable[[Tensor], Tensor], points: Tensor) -> tuple[Tensor, Tensor]:
    moving = points.detach().requires_grad_()
    value = function(moving)
    value.sum().backward()
    assert moving.grad is not None
    return value, moving.grad


def _grid_sample(grid: SdfGrid) -> Callable[[Tensor], Tensor]:
    low, high = (torch.from_numpy(corner).float() for corner in grid.bounds)
    volume, scale = grid.values[None, None], 2 / (high - low)

    def sample(points: Tensor) -> Tensor:
        unit = ((points - low) * scale - 1).flip(-1)[None, None, None]  # grid_sample wants z, y, x
        value = torch.nn.functional.grid_sample(volume, unit, align_corners=True, padding_mode="border")
        return value[0, 0, 0, 0]

    return sample


def _imported(name: str) -> Any:
    try:
        return importlib.import_module(name)
    except Exception:  # missing, or broken by a library of the system: either way it cannot be measured
        return None


def _open3d(open3d: Any, mesh: Mesh, points: Tensor) -> Method:
    scene = open3d.t.geometry.RaycastingScene(nthreads=1)
    scene.add_triangles(
        open3d.core.Tensor(mesh.vertices.astype(np.float32)), open3d.core.Tensor(mesh.faces.astype(np.uint32))
    )
    query = open3d.core.Tensor(points.numpy())
    return lambda: scene.compute_signed_distance(query, nthreads=1).numpy()


def _medians(found: dict[str, Method], repeats: int, calls: int) -> dict[str, float]:
    """Median processor seconds of a call of each method; they take turns of several calls.

    Each turn begins with a call that does not count: a solver calls again and again, and finds its own data in the
    caches rather than another library's.
    """
    times: dict[str, list[float]] = {name: [] for name in found}
    for _ in range(repeats):
        for name, run in found.items():
            run()
            began = time.process_time()
            for _ in range(calls):
                run()
            times[name].append((time.process_time() - began) / calls)
    return {name: float(np.median(values)) for name, values in times.items()}


def _ratio(rows: Sequence[Row], count: int, pattern: str, process: int) -> float:
    case = (process, count, pattern)
    seconds = {r["method"]: r["seconds"] for r in rows if (r["process"], r["points"], r["pattern"]) == case}
    return float(seconds["grid_sample"] / seconds["scenectl"])


def plot(result: dict[str, Any], path: Path) -> None:
    """Bars of nanoseconds a point, written to an image file."""
    from matplotlib.figure import Figure  # without pyplot, so that no window system is asked for

    rows = [row for row in result["rows"] if row["process"] == 1]
    cases = list(dict.fromkeys((row["points"], row["pattern"]) for row in rows))
    names = list(dict.fromkeys(row["method"] for row in rows))
    figure = Figure(figsize=(8, 4.5), layout="constrained")
    axes = figure.subplots()
    for i, name in enumerate(names):
        seconds = {(row["points"], row["pattern"]): row["seconds"] for row in rows if row["method"] == name}
        at = [c + (i - (len(names) - 1) / 2) * 0.8 / len(names) for c, case in enumerate(cases) if case in seconds]
        heights = [1e9 * seconds[case] / case[0] for case in cases if case in seconds]
        axes.bar(at, heights, 0.8 / len(names), label=name)
    axes.set_xticks(range(len(cases)), [f"{count:,} points\n{pattern}" for count, pattern in cases])
    axes.set_ylabel("ns a point, one thread")
    axes.set_yscale("log")
    axes.legend()
    with atomic_write(path) as file:
        figure.savefig(file, format=path.suffix.lstrip(".") or "png", dpi=150)


if __name__ == "__main__":
    print(json.dumps(_measured(*json.loads(sys.argv[1]))))
