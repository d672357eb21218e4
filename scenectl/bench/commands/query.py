"""`scenectl bench query`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from scenectl.bench.commands.shared import alone, shown, wrote
from scenectl.console.options import Json, Seed


def query(
    scene: Annotated[str, typer.Option(help="The bundled scene whose grid is asked.")] = "living_room",
    resolution: Annotated[int, typer.Option(help="Nodes along every side.")] = 256,
    pattern: Annotated[list[str] | None, typer.Option(help="body or uniform; repeatable. Default: body.")] = None,
    repeats: Annotated[int, typer.Option(min=1, help="Turns of each method; the median counts.")] = 15,
    processes: Annotated[int, typer.Option(min=1, help="Fresh processes that measure, one after the other.")] = 1,
    seed: Seed = 0,
    json_file: Json = None,
    plot_file: Annotated[Path | None, typer.Option("--plot", help="Draw the rows to this PNG, PDF or SVG.")] = None,
) -> None:
    """Value and gradient at many points, one thread, beside torch's grid_sample and others."""
    from scenectl.bench.scenes.query import COUNTS, bench_query, plot

    patterns = tuple(pattern or ("body",))
    result = alone(
        lambda engine: bench_query(scene, resolution, repeats, seed, COUNTS, patterns, processes, engine), json_file
    )
    shown(result, json_file)
    if plot_file is not None:
        plot(result, plot_file)
        wrote(plot_file)
