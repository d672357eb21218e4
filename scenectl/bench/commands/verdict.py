"""`scenectl bench verdict`."""

from __future__ import annotations

from typing import Annotated

import typer

from scenectl.bench.commands.shared import alone, wrote
from scenectl.console.options import DATA, Data, Json, Seed


def verdict(
    data: Data = DATA,
    motions: Annotated[int, typer.Option(min=1, help="Recorded motions that are drawn.")] = 200,
    seed: Seed = 0,
    split: Annotated[str, typer.Option(help="Of the collection: 'test', 'val' or 'train'.")] = "test",
    json_file: Json = None,
) -> None:
    """The verdict both ways: recorded motions are believable, and absurdities made from them are called."""
    from scenectl.bench.studies.verdict import bench_verdict
    from scenectl.console.console import show

    result = alone(lambda engine: bench_verdict(data, motions, seed, split, engine), json_file)
    show(
        {
            "summary": result["summary"],
            "rows": [row for row in result["rows"] if row["made"] == "recorded" and row["called"]],
        },
        columns=("motion", "source", "checks", "sentence"),
    )
    wrote(json_file)
