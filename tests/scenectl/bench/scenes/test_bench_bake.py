"""The comparison of bakers: the same nodes for all, costs from processes of their own, nothing hidden."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh

from scenectl.bench.engine import Engine
from scenectl.bench.scenes import bake as bench, meshes, peers
from scenectl.bench.scenes.bake import bench_bake, plot
from scenectl.bench.scenes.peers import OURS, TOOLS, Cube, Run, timed
from scenes.errors import UserError
from scenes.mesh.mesh import Mesh
from scenes.mesh.primitives import Box
from scenes.mesh.surface import Surface
from scenes.sdf.bake import bake
from scenes.sdf.lattice import Lattice

CENTRE = np.array([0.13, -0.04, 0.21])


def ball_cube(nodes: int = 28, spacing: float = 0.1) -> Cube:
    ball = trimesh.creation.icosphere(4, 1.0)
    return Cube(np.asarray(ball.vertices) + CENTRE, np.asarray(ball.faces, np.int64), spacing, nodes)


@pytest.fixture
def box_file(tmp_path: Path) -> str:
    box = Box((0.1, 0.2, 0.3), (1, 0.6, 0.4)).mesh()
    path = tmp_path / "box.ply"
    trimesh.Trimesh(box.vertices, box.faces, process=False).export(path)
    return str(path)


Timed = Callable[[str, Path, Path, float], Run]


@pytest.fixture
def in_process(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """Every tool is ours in this process, a second slower each time; the list tells who ran."""
    ran: list[str] = []

    def fake(tool: str, cube: Path, grid: Path, timeout: float) -> Run:
        ran.append(tool)
        np.save(grid, TOOLS[OURS].bake(peers._load(str(cube))))
        return Run(float(len(ran)), 1.0, 100.0, 90.0)

    monkeypatch.setattr(bench, "timed", fake)
    return ran


# ------------------------------------------------------------------------------------------------------------- tools


@pytest.mark.parametrize("name", TOOLS)
def test_every_tool_answers_at_our_nodes(name: str) -> None:
    """A grid that is off by half a voxel, scaled, or of the other sign would show near the ball's surface."""
    if not TOOLS[name].installed:
        pytest.skip(f"{name} is not installed")
    cube = ball_cube()
    points = next(cube.points()).reshape(28, 28, 28, 3)
    exact = np.linalg.norm(points - CENTRE, axis=-1) - 1
    values = TOOLS[name].bake(cube)
    near = np.abs(exact) < 1.9 * cube.spacing  # ours is exact up to two voxels from the triangles
    assert np.abs(values - exact)[near].max() < 0.05 * cube.spacing
    assert ((values > 0) == (exact > 0))[np.abs(exact) > 0.05 * cube.spacing].all()


def test_points_are_the_nodes_of_the_lattice_in_its_order() -> None:
    cube = Cube(np.zeros((3, 3)), np.array([[0, 1, 2]]), 0.25, 9)
    lattice = Lattice((-1.0, -1.0, -1.0), 0.25, (9, 9, 9))
    assert np.allclose(next(cube.points()), lattice.nodes_at(np.arange(729)), atol=1e-12)
    chunks = list(cube.points(np.float32, chunk=200))
    assert len(chunks) > 3
    assert np.allclose(np.concatenate(chunks), next(cube.points()), atol=1e-6)


def test_a_tool_runs_in_a_process_of_its_own_and_leaves_its_grid(tmp_path: Path) -> None:
    cube = ball_cube(16, 0.2)
    peers.store(cube, tmp_path / "cube.npz")
    run = timed("open3d", tmp_path / "cube.npz", tmp_path / "grid.npy", 120)
    assert run.note == ""
    assert run.cpu_s is not None and run.cpu_s > 0 and run.wall_s is not None and run.wall_s > 0
    assert run.peak_mb is not None and run.base_mb is not None and run.peak_mb >= run.base_mb > 20
    grid = np.load(tmp_path / "grid.npy")
    assert grid.dtype == np.float32 and np.array_equal(grid, TOOLS["open3d"].bake(cube))


def test_a_tool_that_takes_too_long_or_fails_says_so(tmp_path: Path) -> None:
    peers.store(ball_cube(), tmp_path / "cube.npz")
    late = timed(OURS, tmp_path / "cube.npz", tmp_path / "grid.npy", 0.02)
    assert late == Run(note="over 0.02 s")
    failed = timed("libigl_fwn", tmp_path / "missing.npz", tmp_path / "grid.npy", 120)
    assert failed.cpu_s is None and failed.note.startswith("failed: FileNotFoundError")


# -------------------------------------------------------------------------------------------------------- comparison


def test_tools_take_turns_and_medians_are_kept(box_file: str, in_process: list[str], tmp_path: Path) -> None:
    engine = Engine(file=tmp_path / "bake.json")
    result = bench_bake([box_file], [OURS, "open3d"], 24, runs=3, engine=engine)
    assert in_process == [OURS, "open3d"] * 3
    ours, other = result["rows"]
    assert (ours["cpu_s"], other["cpu_s"]) == (3.0, 4.0)  # medians of 1 3 5 and 2 4 6
    assert ours["mesh"] == "box" and ours["kind"] == "closed" and ours["runs"] == 3 and ours["triangles"] == 12
    assert ours["near_error_voxels"] < 1e-4 and ours["sign_errors"] == 0 and ours["impossible_flips"] == 0
    summary = result["summary"]
    assert summary["cpu_ratio"] == {"box": pytest.approx(4 / 3)} and summary["fewest_flips"] == {}
    assert summary["sign_errors_closed"] == summary["impossible_flips_closed"] == 0
    assert summary["near_error_voxels"] == ours["near_error_voxels"]
    assert set(summary["tools"]) == {OURS, "open3d"}
    assert json.loads(json.dumps(result)) == result
    assert bench_bake([box_file], [OURS, "open3d"], 24, runs=3, engine=engine) == result  # rows are kept
    assert len(in_process) == 6


def test_inaccurate_tools_are_no_measure(box_file: str, in_process: list[str], monkeypatch: pytest.MonkeyPatch) -> None:
    honest: Timed = bench.timed

    def shifted(tool: str, cube: Path, grid: Path, timeout: float) -> Run:
        run = honest(tool, cube, grid, timeout)
        if tool == "libigl_fwn":
            np.save(grid, np.roll(np.load(grid), 1, axis=0))
        return run

    monkeypatch.setattr(bench, "timed", shifted)
    result = bench_bake([box_file], [OURS, "libigl_fwn", "open3d"], 24, runs=1)
    assert [row["near_error_voxels"] > 0.5 for row in result["rows"]] == [False, True, False]
    assert result["summary"]["cpu_ratio"] == {"box": 3.0}


def test_a_tool_that_failed_is_not_tried_again(box_file: str, monkeypatch: pytest.MonkeyPatch) -> None:
    calls: list[str] = []

    def late(tool: str, cube: Path, grid: Path, timeout: float) -> Run:
        calls.append(tool)
        return Run(note="over 1 s")

    monkeypatch.setattr(bench, "timed", late)
    result = bench_bake([box_file], ["open3d"], 16, runs=3)
    (row,) = result["rows"]
    assert calls == ["open3d"] and row["cpu_s"] is None and row["near_error_voxels"] is None and row["runs"] == 0
    assert row["note"] == "over 1 s" and result["summary"]["cpu_ratio"] == {}


def test_turned_signs_are_no_error_of_others_but_one_of_ours(
    in_process: list[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """A room faces inward: what is free in it is our rule, which others do not know."""
    honest: Timed = bench.timed

    def turned(tool: str, cube: Path, grid: Path, timeout: float) -> Run:
        run = honest(tool, cube, grid, timeout)
        np.save(grid, -np.load(grid))
        return run

    monkeypatch.setattr(bench, "timed", turned)
    box = Box((0, 0, 0), (4, 3, 4)).mesh()
    monkeypatch.setattr(bench, "mesh_named", lambda name: Mesh(box.vertices, box.faces[:, ::-1], "room"))
    ours, other = bench_bake(["room"], [OURS, "open3d"], 20, runs=1)["rows"]
    assert ours["rule"] == "inside"
    assert ours["sign_errors"] > 100 and other["sign_errors"] == 0


def test_missing_tools_and_meshes_are_named(
    in_process: list[str], monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    found = peers.util.find_spec
    monkeypatch.setattr(peers.util, "find_spec", lambda name: None if name == "igl" else found(name))
    monkeypatch.setattr(bench, "KNOWN", {name: meshes.KNOWN[name] for name in ("living_room", "bundled_corridor")})
    monkeypatch.chdir(tmp_path)
    result = bench_bake((), ["libigl_fwn", OURS], 16, runs=1)
    assert [row["mesh"] for row in result["rows"]] == ["bundled_corridor"]
    skipped = result["summary"]["skipped"]
    assert skipped["libigl_fwn"] == "not installed" and "does not exist" in skipped["living_room"]
    with pytest.raises(UserError, match="none is installed; pip install"):
        bench_bake(["cad"], ["libigl_fwn"])


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("--tool", "open3"), "unknown tool 'open3'; did you mean 'open3d'?"),
        (("--mesh", "statu"), "unknown mesh 'statu'; did you mean 'statue'?"),
        (("--mesh", "gone.ply"), "does not exist"),
        (("--resolution", "4"), "bake resolution is 4"),
    ],
)
def test_mistakes_are_told(scenectl: Any, arguments: tuple[str, ...], message: str) -> None:
    said = scenectl("bench", "bake", *arguments)
    assert said.status == 2 and message in said.err


def test_the_command_keeps_table_figures_and_picture(
    scenectl: Any, box_file: str, in_process: list[str], tmp_path: Path
) -> None:
    said = scenectl(
        "bench", "bake", "--mesh", box_file, "--tool", "open3d", "--tool", OURS, "--runs", 1, "--resolution", 16,
        "--json", tmp_path / "bake.json", "--plot", tmp_path / "bake.png",
    )  # fmt: skip
    assert said.status == 0 and "cpu_ratio" in said.out and "open3d 1.00 s of CPU" in said.err
    assert [row["tool"] for row in json.loads((tmp_path / "bake.json").read_text())["rows"]] == ["open3d", OURS]
    assert (tmp_path / "bake.png").read_bytes().startswith(b"\x89PNG")


def test_a_picture_of_nothing_is_still_a_picture(tmp_path: Path) -> None:
    plot({"summary": {"resolution": 16}, "rows": []}, tmp_path / "empty.png")
    assert (tmp_path / "empty.png").is_file()


# ------------------------------------------------------------------------------------------------------------ meshes


@pytest.mark.parametrize("triangles", [12, 30, 48, 200, 1000])
def test_subdividing_keeps_the_surface(triangles: int) -> None:
    box = Box((0, 0, 0), (1, 2, 3)).mesh()
    fine = meshes.subdivided(box, triangles)
    surface = Surface.of(fine)
    assert len(fine.faces) == triangles and surface.closed
    areas = np.linalg.norm(np.cross(*np.diff(fine.triangles, axis=1).swapaxes(0, 1)), axis=1) / 2
    assert areas.sum() == pytest.approx(22.0)
    assert np.einsum("nc,nc->n", fine.triangles[:, 0], np.cross(*fine.triangles[:, 1:].swapaxes(0, 1))).sum() / 6 == (
        pytest.approx(6.0)
    )


def test_generated_meshes_are_what_they_are_called() -> None:
    assert Surface.of(meshes.cad()).closed and len(meshes.cad().faces) > 1000
    figure = meshes.statue(40)
    assert Surface.of(figure).closed and bake(figure, 16, cache=None).grid.values[0, 0, 0] > 0
    for make in (meshes.soup_random, meshes.soup_shapes):
        soup = make(40)
        assert Surface.of(soup).kind == "open" and soup.digest == make(40).digest
    assert set(meshes.KNOWN) >= {"subdivided_1m4", "statue_2m", "bundled_living_room", "office_large"}
