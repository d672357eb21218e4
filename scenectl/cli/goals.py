"""`scenectl goals`."""

from __future__ import annotations

from typing import Annotated

import typer

from scenectl.cli.clock import importing
from scenectl.console.console import listed, out, table, titled
from scenectl.console.options import AllowCode, allow


def goals(
    name: Annotated[str | None, typer.Argument(help="Show everything about one goal.")] = None,
    allow_code: AllowCode = None,
) -> None:
    """List the goals that a task can use."""
    with importing():
        from objectives import get_goal, goals as registered

    allow(allow_code)
    if name is None:
        lines = table("goal", "unit", "meaning")
        for spec in registered():
            lines.add_row(spec.name, spec.unit, spec.summary)
        out.print(lines)
        out.print("\nscenectl goals NAME shows its parameters.")
        return
    spec = get_goal(name)
    out.print(titled(spec.name, f" ({spec.unit}): {spec.summary}"))
    out.print(listed(spec.parameters))
    out.print(
        f"kernel {spec.kernel}, reduction {spec.reduction}, scale {spec.scale:g}, tolerance {spec.tolerance:g} "
        f"{spec.unit}; every goal also takes name, weight, tolerance, at, window, sometime, kernel and reduction"
    )
