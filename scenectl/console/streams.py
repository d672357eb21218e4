"""Standard output and standard error of the process, whatever they lead to."""

from __future__ import annotations

import io
import os
import sys
import warnings
from typing import Any

from scenes.errors import Remark

_NAMES = {1: "standard output", 2: "standard error"}


class _Output(io.FileIO):
    """What nobody reads any more goes nowhere: a reader that leaves, as in `| head`, changes nothing of what is done.

    An error of the system, such as a full disk, names the stream; on standard error there is nobody to tell.
    """

    def write(self, data: Any) -> int:
        try:
            return super().write(data)
        except OSError as error:
            if not isinstance(error, BrokenPipeError) and self.fileno() != 2:
                raise OSError(error.errno, error.strerror, _NAMES[self.fileno()]) from error
            nowhere = os.open(os.devnull, os.O_WRONLY)
            os.dup2(nowhere, self.fileno())
            os.close(nowhere)
            return len(data)


def prepare() -> None:
    """Let all text be printable, closed streams lead nowhere, and warnings be a line each, without our source."""
    for number in (0, 1, 2):
        try:
            os.fstat(number)
        except OSError:  # closed: the next file that is opened would be taken for it
            os.set_inheritable(os.open(os.devnull, os.O_RDWR), True)
    sys.stdout, sys.stderr = _opened(1, sys.stdout), _opened(2, sys.stderr)
    warnings.showwarning = _warned


def _opened(number: int, before: Any) -> io.TextIOWrapper:
    """The stream, in the encoding that Python chose; what that lacks is written as an escape."""
    buffered = io.BufferedWriter(_Output(number, "w", closefd=False))
    encoding = "utf-8" if before is None else before.encoding
    lines = number == 2 or os.isatty(number)
    return io.TextIOWrapper(buffered, encoding, errors="backslashreplace", line_buffering=lines)


def _warned(message: Warning | str, category: type[Warning], filename: str, lineno: int, *_: Any, **__: Any) -> None:
    """A `Remark` is for users; warnings of libraries are for their authors, and shown where -W asks for them."""
    if issubclass(category, Remark) or sys.warnoptions:
        from scenectl.console.console import err

        err.print(f"scenectl: {message}")
