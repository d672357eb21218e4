"""The command line: every subcommand is a thin layer over a function that Python users call too.

Bad input is answered with one sentence on standard error and exit status 2, never with a traceback. Commands import
what they need when they run, so that help and completion wait for none of it.
"""

from __future__ import annotations

import atexit
import os
import sys
from contextlib import suppress
from typing import Annotated

import typer

from scenectl.console.lazy import group
from scenectl.version import __version__
from scenes.errors import UserError

COMMANDS = (
    "check", "run", "score", "view", "edit", "goals", "schema", "scenes", "bake", "body", "train", "bench", "help",
)  # fmt: skip

app = typer.Typer(
    cls=group("scenectl.cli", *COMMANDS),
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
    help="A room, a sentence and goals in; a human motion that meets them out.",
)


@app.callback(invoke_without_command=True)
def _root(version: Annotated[bool, typer.Option("--version", help="Print the version and leave.")] = False) -> None:
    if version:
        typer.echo(__version__)
        raise typer.Exit


def main() -> None:
    """Entry point of the `scenectl` command; exits with 2 for bad input."""
    try:
        app(prog_name="scenectl")
    except UserError as error:
        _leave(str(error))
    except BrokenPipeError:  # `scenectl goals | head` is no fault
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        sys.exit(0)
    except OSError as error:
        name = f" '{error.filename}'" if error.filename else ""
        _leave(f"cannot use{name}: {error.strerror or error}")
    except MemoryError:
        _leave("not enough memory; use a smaller resolution, a shorter motion or fewer samples")


def entry() -> None:
    """The `scenectl` process: `main`, and then an end at once.

    Taking torch, VTK and their hundreds of thousands of objects apart takes up to a second, and leaves nothing behind
    that the system would not free; what is to be done at the end (`atexit`) is done, and all output is written.
    """
    status: int | str | None = 0
    try:
        main()
    except SystemExit as leaving:
        status = leaving.code
    atexit._run_exitfuncs()
    for stream in (sys.stdout, sys.stderr):
        with suppress(OSError, ValueError):  # a pipe that was closed, as by `| head`
            stream.flush()
    os._exit(status if isinstance(status, int) else int(status is not None))


def _leave(sentence: str) -> None:
    from scenectl.console.console import complain

    complain(sentence)
    sys.exit(2)


if __name__ == "__main__":
    entry()
