"""`scenectl help`."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated

import typer

from scenectl.console.console import out, table as columns

if TYPE_CHECKING:
    from scenectl.tasks.keys import Table


def help(
    words: Annotated[
        list[str] | None, typer.Argument(metavar="[COMMAND | task [TABLE]]", help="What to tell about.")
    ] = None,
) -> None:
    """Tell about a command, or about the keys of a task file: help task, help task walk."""
    match words or []:
        case ["task"]:
            _tell_tables()
        case ["task", name]:
            _tell_keys(name)
        case names:
            from scenectl.cli import COMMANDS
            from scenectl.cli.root import commands  # which lists this command

            commands(*COMMANDS)([*names, "--help"], prog_name="scenectl")


def _tell_tables() -> None:
    from scenectl.tasks.keys import tables

    whole, *others = tables().values()
    _tell(whole)
    out.print()
    lines = columns("table", "meaning")
    for each in others:
        lines.add_row(f"[{each.name}]", each.summary)
    out.print(lines)
    out.print("\nscenectl help task TABLE shows the keys of one.")


def _tell_keys(name: str) -> None:
    from scenectl.tasks.keys import table

    told = table(name)
    out.print(f"[{told.name}]: {told.summary}\n")
    _tell(told)


def _tell(told: Table) -> None:
    lines = columns("key", "type", "default", "unit", "meaning")
    for key in told.keys:
        lines.add_row(key.name, key.type, key.default, key.unit, key.meaning)
    out.print(lines)
    if told.more:
        out.print(f"({told.more})")
