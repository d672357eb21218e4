"""The query bench: every method answers the same question, and the rows say what was asked."""

from __future__ import annotations

from pathlib import Path

import pytest
import torch

from scenectl.bench.scenes.query import COUNTS, PATTERNS, bench_query, make_points, methods, plot
from scenes.errors import UserError
from scenes.sdf.bake import bake
from scenes.sdf.lattice import Lattice
from scenes.world.scene import bundled


def test_every_method_answers_the_same_question() -> None:
    mesh = bundled("pillars").meshes[0]
    grid = bake(mesh, lattice=Lattice.cube(mesh.bounds, 32, padding=0.1)).grid
    points = make_points(grid, 500, "uniform")
    found = methods(grid, mesh, points)
    value, gradient = found["scenectl"]()
    for name in ("grid_sample", "torch"):
        other, slope = found[name]()
        torch.testing.assert_close(other, value, atol=1e-4, rtol=0)
        # rounding puts a point that lies on a face into either voxel, whose gradients differ
        assert ((slope - gradient).abs().amax(-1) < 1e-3).double().mean() > 0.98


@pytest.mark.parametrize("pattern", PATTERNS)
def test_points_are_many_single_and_in_the_grid(pattern: str) -> None:
    mesh = bundled("living_room").meshes[0]
    grid = bake(mesh, lattice=Lattice.cube(mesh.bounds, 16, padding=0.1)).grid
    points = make_points(grid, COUNTS[0] + 7, pattern)
    low, high = torch.from_numpy(grid.bounds).float()
    assert points.shape == (COUNTS[0] + 7, 3) and points.dtype == torch.float32 and points.is_contiguous()
    assert (points == points.clamp(low, high)).all(-1).double().mean() > 0.99
    assert torch.equal(points, make_points(grid, COUNTS[0] + 7, pattern))


def test_rows_and_summary(tmp_path: Path) -> None:
    threads = torch.get_num_threads()
    result = bench_query("pillars", resolution=16, repeats=1, counts=(2000, 4000), patterns=PATTERNS)
    assert torch.get_num_threads() == threads
    assert {(row["points"], row["pattern"]) for row in result["rows"]} == {
        (n, p) for n in (2000, 4000) for p in PATTERNS
    }
    assert {"scenectl", "grid_sample", "torch"} <= {row["method"] for row in result["rows"]}
    seconds = {(row["pattern"], row["method"]): row["seconds"] for row in result["rows"] if row["points"] == 4000}
    ratios = [seconds[p, "grid_sample"] / seconds[p, "scenectl"] for p in PATTERNS]
    assert result["summary"]["speedup_4000"] == pytest.approx(min(ratios))
    plot(result, tmp_path / "query.png")
    assert (tmp_path / "query.png").read_bytes()[:4] == b"\x89PNG"
    with pytest.raises(UserError, match="unknown pattern 'unifrm'; did you mean 'uniform'"):
        bench_query("pillars", patterns=("unifrm",))
    with pytest.raises(UserError, match="repeats"):
        bench_query("pillars", repeats=0)


def test_fresh_processes_measure_each_by_itself_and_the_least_counts() -> None:
    result = bench_query("pillars", resolution=16, repeats=1, counts=(2000,), processes=2)
    summary, rows = result["summary"], result["rows"]
    assert [row["method"] for row in rows] == 2 * ["scenectl", "grid_sample"]
    assert {row["process"] for row in rows} == {1, 2} and summary["processes"] == 2 and summary["threads"] == 1
    each = [float(ratio) for ratio in summary["speedup_2000_each"].split(", ")]
    assert len(each) == 2 and summary["speedup_2000"] == pytest.approx(min(each), abs=0.006)
    assert summary["processor"] and summary["torch_kernels"] and summary["processors"] >= 1
    with pytest.raises(UserError, match="unknown bundled scene 'pilars'; did you mean 'pillars'"):
        bench_query("pilars", resolution=16, repeats=1, counts=(2000,), processes=2)
