"""`scenectl bench bake`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from scenectl.bench.commands.shared import alone, shown, wrote
from scenectl.console.console import say
from scenectl.console.options import Json


def bake(
    mesh: Annotated[list[str] | None, typer.Option(help="A known mesh or a file; repeatable. Default: all.")] = None,
    tool: Annotated[list[str] | None, typer.Option(help="A tool; repeatable. Default: all installed.")] = None,
    resolution: Annotated[int, typer.Option(help="Nodes along each axis.")] = 256,
    runs: Annotated[int, typer.Option(min=1, help="Of each tool on each mesh, in turn; medians count.")] = 3,
    timeout: Annotated[float, typer.Option(min=0.01, help="Seconds after which a bake is given up.")] = 900.0,
    json_file: Json = None,
    plot_file: Annotated[Path | None, typer.Option("--plot", help="Draw CPU-seconds to this PNG file.")] = None,
) -> None:
    """Bakes beside those of other tools (extra 'peers'): CPU-seconds, memory, errors, contradictions."""
    from scenectl.bench.scenes.bake import bench_bake, plot

    result = alone(
        lambda engine: bench_bake(mesh or (), tool or (), resolution, runs, timeout, engine), json_file, progress=say
    )
    columns = (
        "mesh", "tool", "cpu_s", "wall_s", "peak_mb", "near_error_voxels", "impossible_flips", "far_error_voxels",
        "sign_errors", "base_mb", "triangles", "runs", "note",
    )  # fmt: skip
    shown(result, json_file, columns)
    if plot_file is not None:
        plot(result, plot_file)
        wrote(plot_file)
