"""`scenectl bench data`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from scenectl.bench.commands.shared import alone, shown, wrote
from scenectl.console.options import DATA, Data, Json, Seed


def data(
    data: Data = DATA,
    config: Annotated[str, typer.Option(help="compact, permissive, paper, or a recipe (TOML).")] = "compact",
    page: Annotated[Path | None, typer.Option("--page", help="Folder to write the page to, with its pictures.")] = None,
    seed: Seed = 0,
    json_file: Json = None,
) -> None:
    """What a recipe trains on: hours, clips and share of the draws of every kind, and a picture of each."""
    from scenectl.bench.models.data import bench_data

    shown(
        alone(lambda engine: bench_data(data, config, seed, page, engine), json_file),
        json_file,
        ("kind", "hours", "clips", "median_s", "found_or_made", "share_2s", "share_4s", "share_8s"),
    )
    wrote(page and page / "data.md")
