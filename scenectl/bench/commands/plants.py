"""`scenectl bench plants`."""

from __future__ import annotations

from typing import Annotated

import typer

from scenectl.bench.commands.shared import alone, shown
from scenectl.console.options import DATA, Data, Json


def plants(
    data: Data = DATA,
    split: Annotated[str, typer.Option(help="Of the recorded motions: train, val or test.")] = "test",
    json_file: Json = None,
) -> None:
    """Speeds of feet while recorded people walk: where standing ends and swinging begins."""
    from scenectl.bench.studies.plants import bench_plants

    shown(alone(lambda engine: bench_plants(data, split, engine), json_file), json_file)
