"""The group of all commands, as typer reads it."""

from __future__ import annotations

from typing import Annotated

import typer

from scenectl.console.lazy import group
from scenectl.version import __version__


def commands(*names: str) -> typer.Typer:
    """The group of commands that are files of this folder, listed in this order."""
    app = typer.Typer(
        cls=group("scenectl.cli", *names),
        no_args_is_help=True,
        pretty_exceptions_enable=False,
        rich_markup_mode=None,
        help="A room, a sentence and goals in; a human motion that meets them out.",
    )
    app.callback(invoke_without_command=True)(_root)
    return app


def _root(version: Annotated[bool, typer.Option("--version", help="Print the version and leave.")] = False) -> None:
    if version:
        typer.echo(__version__)
        raise typer.Exit
