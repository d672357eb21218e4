"""`scenectl schema`."""

from __future__ import annotations

import json
from typing import Annotated

import typer

from scenectl.cli.clock import importing
from scenectl.console.options import AllowCode, allow
from scenes.errors import UserError, did_you_mean

KINDS = ("task", "report")


def schema(
    kind: Annotated[str, typer.Argument(metavar="task|report", help="Task files (TOML), or report.json.")],
    allow_code: AllowCode = None,
) -> None:
    """Print the JSON Schema of task files, with every goal and generator that is known, or of report.json."""
    if kind not in KINDS:
        raise UserError(f"there is no schema '{kind}'{did_you_mean(kind, KINDS)}; there are {' and '.join(KINDS)}")
    with importing():
        from scenectl.pipeline.tables import ReportTable
        from scenectl.tasks.json_schema import task_schema

    allow(allow_code)
    found = task_schema() if kind == "task" else ReportTable.model_json_schema()
    typer.echo(json.dumps(found, indent=1, allow_nan=False))
