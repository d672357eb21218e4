"""`scenectl bench limits`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from scenectl.bench.commands.shared import alone, shown, wrote
from scenectl.console.options import DATA, Data, Json


def limits(
    data: Data = DATA,
    write: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Store them: scenectl/measures/believability/limits.json.")
    ] = None,
    json_file: Json = None,
) -> None:
    """What people stay within: quantiles of what the verdict's checks measure on training clips."""
    from scenectl.bench.studies import limits as study

    result = alone(lambda engine: study.bench_limits(data, engine), json_file)
    shown(result, json_file, ("check", "unit", "limit", "quantile", "clips", "q50", "q95", "q99", "q99.5", "q99.9"))
    if write is not None:
        study.write(result["stored"], write)
        wrote(write)
