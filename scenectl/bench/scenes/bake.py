"""Our baker beside other tools that turn meshes into signed distances: cost, accuracy, contradictions.

Every tool bakes the same cube of nodes in processes of its own, in turn; each grid is held against the same oracle.
"""

from __future__ import annotations

import tempfile
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, fields, replace
from pathlib import Path
from statistics import median
from typing import Any

import numpy as np
import torch

from scenectl.bench.engine import ENGINE, Engine, Result, Row
from scenectl.bench.scenes.meshes import KNOWN, mesh_named
from scenectl.bench.scenes.peers import OURS, TOOLS, Cube, Run, store, timed
from scenectl.generators.base import Progress
from scenes.errors import UserError, did_you_mean
from scenes.mesh.mesh import Mesh
from scenes.sdf.accuracy import Accuracy, Oracle
from scenes.sdf.bake import sided
from scenes.sdf.free_space import Sides
from scenes.sdf.grid import SdfGrid
from scenes.sdf.lattice import Lattice
from scenes.sdf.settings import check_resolution

ACCURATE = 0.01
"""Voxels: a tool whose distances near the surface are worse is no measure of how fast one can be."""
PADDING = 0.1
SAMPLES = 10_000


def bench_bake(
    meshes: Sequence[str] = (),
    tools: Sequence[str] = (),
    resolution: int = 256,
    runs: int = 3,
    timeout: float | int = 900.0,
    engine: Engine = ENGINE,
) -> Result:
    """Bake cubes around meshes with every tool, one after the other.

    Args:
        meshes: names of `KNOWN` or files; default, all that are at hand.
        tools: names of `TOOLS`; default, all. Those that are not installed are left out.
        resolution: nodes along each axis of the cube.
        runs: of each tool on each mesh, in turn (A, B, C, A, B, C); costs are their medians.
        timeout: seconds after which a bake, with its imports, is given up and not tried again.
        engine: tells progress, keeps the rows of every mesh and goes on from them.

    Raises:
        UserError: an unknown mesh or tool, no tool that is installed, or a resolution out of range.
    """
    check_resolution(resolution)
    chosen, skipped = _installed(tools or tuple(TOOLS))
    names = tuple(dict.fromkeys(meshes or KNOWN))
    settings = {"resolution": resolution, "runs": runs, "timeout_s": timeout}
    versions = {name: TOOLS[name].version for name in chosen}

    def baked(case: tuple[float, Mesh]) -> list[Row]:
        return _rounds(*case, chosen, resolution, runs, timeout, engine.progress)

    return engine.run(
        _at_hand(names, bool(meshes), skipped),
        baked,
        lambda rows: settings | {"tools": versions, "skipped": dict(skipped)} | summary(rows),
        {"bench": "bake", "meshes": names, "tools": versions, **settings},
        len(names),
    )


def _rounds(
    done: float, mesh: Mesh, tools: Sequence[str], resolution: int, runs: int, timeout: float | int, progress: Progress
) -> list[Row]:
    """A row for each tool, after so many rounds in which each bakes the mesh once; `done` is what is told with it."""
    progress(f"{mesh.name}: {len(mesh.faces)} triangles, exact distances and winding numbers", done)
    with tempfile.TemporaryDirectory(prefix="scenectl-bake-") as folder:
        contest = Contest.of(mesh, resolution, Path(folder))
        for _ in range(runs):
            for tool in tools:
                run = contest.run(tool, timeout)
                if run is not None:
                    progress(f"{mesh.name}: {tool} {run.note or f'{run.cpu_s:.2f} s of CPU'}", done)
        return [contest.row(tool) for tool in tools]


def _installed(names: Sequence[str]) -> tuple[list[str], dict[str, str]]:
    for name in names:
        if name not in TOOLS:
            raise UserError(f"unknown tool '{name}'{did_you_mean(name, TOOLS)}")
    chosen = [name for name in dict.fromkeys(names) if TOOLS[name].installed]
    skipped = {name: "not installed" for name in names if name not in chosen}
    if not chosen:
        raise UserError(f"of the tools {', '.join(names)} none is installed; pip install 'scenectl[peers]'")
    return chosen, skipped


def _at_hand(names: Sequence[str], asked: bool, skipped: dict[str, str]) -> Iterator[tuple[str, tuple[float, Mesh]]]:
    """The meshes by name, each with the fraction of those before it.

    A mesh that cannot be had is an error where it was `asked` for; else the reason goes into `skipped`.
    """
    for number, name in enumerate(names):
        try:
            mesh = mesh_named(name)
        except UserError as error:
            if asked:
                raise
            skipped[name] = str(error)
            continue
        yield mesh.name, (number / len(names), mesh)


@dataclass(frozen=True, eq=False)
class Contest:
    """One mesh that tools bake in turn, and what came of it so far.

    Attributes:
        mesh: the triangles.
        lattice: the cube of nodes.
        sides: the same, cleaned, and which space is free.
        oracle: the truth at some nodes.
        folder: where the cube and the grids lie for a while.
        runs: of each tool, in order.
        accuracy: of the first grid of each tool.
    """

    mesh: Mesh
    lattice: Lattice
    sides: Sides
    oracle: Oracle
    folder: Path
    runs: dict[str, list[Run]]
    accuracy: dict[str, Accuracy]

    @classmethod
    def of(cls, mesh: Mesh, resolution: int, folder: Path) -> Contest:
        """Ask the oracle, and put the cube where the tools find it."""
        lattice = Lattice.cube(mesh.bounds, resolution, PADDING)
        middle = lattice.bounds.mean(axis=0)
        store(Cube(mesh.vertices - middle, mesh.faces, lattice.spacing, resolution), folder / "cube.npz")
        sides = sided(mesh, "auto", lattice)
        return cls(mesh, lattice, sides, Oracle.of(sides, lattice, SAMPLES), folder, {}, {})

    def run(self, tool: str, timeout: float | int) -> Run | None:
        """Bake once more; None where the tool has failed before, because then it would again."""
        earlier = self.runs.setdefault(tool, [])
        if any(run.note for run in earlier):
            return None
        file = self.folder / "grid.npy"
        run = timed(tool, self.folder / "cube.npz", file, timeout)
        if not run.note and tool not in self.accuracy:
            self.accuracy[tool] = self._judged(tool, np.load(file))
        file.unlink(missing_ok=True)
        earlier.append(run)
        return run

    def _judged(self, tool: str, values: np.ndarray) -> Accuracy:
        """Accuracy of a grid; others' may have either sign throughout, as they know no free-space rule."""
        origin = torch.tensor(self.lattice.origin, dtype=torch.float64)
        found = self.oracle.judge(SdfGrid(torch.from_numpy(values), origin, self.lattice.spacing))
        if tool == OURS:
            return found
        turned = self.oracle.judge(SdfGrid(torch.from_numpy(-values), origin, self.lattice.spacing))
        return replace(found, sign_errors=min(found.sign_errors, turned.sign_errors))

    def row(self, tool: str) -> Row:
        """Medians of a tool's costs, and its accuracy; None for what could not be measured."""
        runs = self.runs[tool]
        costs = {name: _median([getattr(run, name) for run in runs]) for name in ("cpu_s", "wall_s", "peak_mb")}
        found = self.accuracy.get(tool)
        figures = dict.fromkeys(field.name for field in fields(Accuracy)) if found is None else found.row()
        return {
            "mesh": self.mesh.name,
            "tool": tool,
            **costs,
            "near_error_voxels": figures.pop("near_error_voxels"),
            "impossible_flips": figures.pop("impossible_flips"),
            **figures,
            "base_mb": _median([run.base_mb for run in runs]),
            "triangles": len(self.mesh.faces),
            "kind": self.sides.surface.kind,
            "rule": self.sides.rule.name,
            "runs": len([run for run in runs if not run.note]),
            "note": next((run.note for run in runs if run.note), ""),
            "each": [asdict(run) for run in runs],
        }


def _median(figures: Sequence[float | None]) -> float | None:
    known = [figure for figure in figures if figure is not None]
    return median(known) if known else None


def summary(rows: Sequence[Row]) -> dict[str, Any]:
    """Our worst figures, and how we compare on each mesh.

    `cpu_ratio` is how many times our CPU-seconds the fastest accurate tool takes; `fewest_flips`, of open meshes, is
    whether no other tool has fewer impossible flips.
    """
    ours = {row["mesh"]: row for row in rows if row["tool"] == OURS and row["cpu_s"] is not None}
    closed = [row for row in ours.values() if row["kind"] == "closed"]
    ratios: dict[str, float] = {}
    fewest: dict[str, bool] = {}
    for name, own in ours.items():
        peers = [row for row in rows if row["mesh"] == name and row["tool"] != OURS and row["cpu_s"] is not None]
        if accurate := [row["cpu_s"] for row in peers if row["near_error_voxels"] < ACCURATE]:
            ratios[name] = min(accurate) / own["cpu_s"]
        if peers and own["kind"] == "open":
            fewest[name] = all(own["impossible_flips"] <= row["impossible_flips"] for row in peers)
    return {
        "near_error_voxels": max((row["near_error_voxels"] for row in ours.values()), default=None),
        "sign_errors_closed": sum(row["sign_errors"] for row in closed),
        "impossible_flips_closed": sum(row["impossible_flips"] for row in closed),
        "cpu_ratio": ratios,
        "fewest_flips": fewest,
    }


def plot(result: Mapping[str, Any], path: Path) -> None:
    """Bars of CPU-seconds for every mesh (PNG): ours, accurate tools and inaccurate ones in three colours."""
    from matplotlib.figure import Figure
    from matplotlib.patches import Patch

    from scenes.files import atomic_write

    rows = [row for row in result["rows"] if row["cpu_s"] is not None]
    names = list(dict.fromkeys(row["mesh"] for row in rows))
    across = min(3, max(1, len(names)))
    down = max(1, -(-len(names) // across))
    figure = Figure(figsize=(5.2 * across, 0.6 + 2.9 * down), layout="constrained")
    panels = figure.subplots(down, across, squeeze=False, sharex=True).flat
    for panel, name in zip(panels, names, strict=False):
        own = sorted((row for row in rows if row["mesh"] == name), key=lambda row: -row["cpu_s"])
        bars = panel.barh([row["tool"] for row in own], [row["cpu_s"] for row in own], color=[_colour(r) for r in own])
        labels = [
            f"{r['cpu_s']:.3g} s, error {r['near_error_voxels']:.0e}, flips {r['impossible_flips']:,}" for r in own
        ]
        panel.bar_label(bars, labels, padding=3, fontsize=7)
        panel.set_title(f"{name}, {own[0]['triangles']:,} triangles, {own[0]['kind']}", fontsize=9, loc="left")
        panel.tick_params(labelsize=8, labelbottom=True)
        panel.spines[["top", "right"]].set_visible(False)
        panel.set_xscale("log")
    for panel in panels:  # those that no mesh fills
        panel.set_visible(False)
    if rows:
        costs = [row["cpu_s"] for row in rows]
        figure.axes[0].set_xlim(min(costs) / 2, max(costs) * 40)
    legend = {"scenectl": _OWN, f"near error under {ACCURATE} voxels": _GOOD, "worse": _POOR}
    figure.legend(
        [Patch(color=colour) for colour in legend.values()],
        list(legend),
        loc="outside upper right",
        ncols=3,
        fontsize=8,
    )
    figure.supxlabel(f"CPU-seconds for {result['summary']['resolution']} nodes along each axis", fontsize=9)
    with atomic_write(path) as file:
        figure.savefig(file, format="png", dpi=110)


_OWN, _GOOD, _POOR = "#c0392b", "#4a6fa5", "#c9ced6"


def _colour(row: Row) -> str:
    return _OWN if row["tool"] == OURS else _GOOD if row["near_error_voxels"] < ACCURATE else _POOR
