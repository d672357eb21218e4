"""The command line: every subcommand is a thin layer over a function that Python users call too."""

from __future__ import annotations

import typer

import scenectl

app = typer.Typer(no_args_is_help=True, add_completion=False, pretty_exceptions_enable=False)


@app.callback(invoke_without_command=True)
def _root(version: bool = typer.Option(False, "--version", help="Print the version and leave.")) -> None:
    """A room, a sentence and goals in; a human motion that meets them out."""
    if version:
        typer.echo(scenectl.__version__)
        raise typer.Exit


def main() -> None:
    """Entry point of the `scenectl` command."""
    app()
