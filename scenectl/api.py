"""Runs and scores as `import scenectl` offers them: with a preview that `Result.save` draws."""

from __future__ import annotations

from functools import wraps
from pathlib import Path
from typing import Any

from scenectl.pipeline import run as pipeline
from scenectl.pipeline.results import Result


@wraps(pipeline.run)
def run(*given: Any, **named: Any) -> Result:
    """`scenectl.pipeline.run.run`, whose results draw a preview."""
    return pipeline.run(*given, **{"drawer": draw, **named})


@wraps(pipeline.score)
def score(*given: Any, **named: Any) -> Result:
    """`scenectl.pipeline.run.score`, whose results draw a preview."""
    return pipeline.score(*given, **{"drawer": draw, **named})


def draw(result: Result, png: Path) -> None:
    """The preview of a result."""
    from scenectl.view import draw_result  # VTK takes a second to import

    draw_result(result, png)
