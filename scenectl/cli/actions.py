"""`scenectl actions`."""

from __future__ import annotations

from typing import Annotated

import typer

from scenectl.cli.clock import importing
from scenectl.console.console import listed, out, table, titled
from scenectl.console.options import AllowCode, allow


def actions(
    name: Annotated[str | None, typer.Argument(help="Show everything about one action.")] = None,
    allow_code: AllowCode = None,
) -> None:
    """List the actions that a script can use."""
    with importing():
        from scenectl.tasks.actions import actions as registered, get_action

    allow(allow_code)
    if name is None:
        lines = table("action", "meaning")
        for spec in registered():
            lines.add_row(spec.name, spec.summary)
        out.print(lines)
        out.print("\nscenectl actions NAME shows its parameters.")
        return
    spec = get_action(name)
    out.print(titled(spec.name, f": {spec.summary}"))
    out.print(listed(spec.parameters))
    finds = "in any posture" if spec.posture is None else spec.posture
    out.print(f"it finds the body {finds}; every action also takes name and [[action.goal]] tables")
