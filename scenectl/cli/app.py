"""The command line: every subcommand is a thin layer over a function that Python users call too.

Bad input is answered with one sentence on standard error and exit status 2, never with a traceback. Commands import
what they need when they run, so that help and completion wait for none of it.
"""

from __future__ import annotations

import atexit
import os
import signal
import sys
from contextlib import suppress

from scenectl.cli import COMMANDS, interrupts


def main() -> None:
    """Run the command that the arguments name; exits with 2 for bad input."""
    # typer takes a tenth of a second, in which `entry` can be interrupted already
    from scenectl.cli.root import commands
    from scenes.errors import UserError

    try:
        commands(*COMMANDS)(prog_name="scenectl")
    except UserError as error:
        _leave(str(error))
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
    interrupts.watch()
    status: int | str | None = 0
    try:
        from scenectl.console import streams

        streams.prepare()
        main()
    except SystemExit as leaving:
        status = leaving.code
    except KeyboardInterrupt:
        status = interrupts.STATUS
    signal.signal(signal.SIGINT, signal.SIG_DFL)
    if status == interrupts.STATUS:
        interrupts.tell()
    atexit._run_exitfuncs()
    for stream in (sys.stdout, sys.stderr):
        with suppress(OSError, ValueError):  # a disk that was full before
            stream.flush()
    os._exit(status if isinstance(status, int) else int(status is not None))


def _leave(sentence: str) -> None:
    from scenectl.console.console import complain

    complain(sentence)
    sys.exit(2)


if __name__ == "__main__":
    entry()
