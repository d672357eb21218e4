"""What Ctrl-C does: one line and exit status 130, whatever is running."""

from __future__ import annotations

import os
import signal
import sys
from types import FrameType
from typing import Any

STATUS = 128 + signal.SIGINT
"""As shells count it."""


def watch() -> None:
    """From now on an interrupt raises KeyboardInterrupt, and ends the process at once where that could be lost.

    It is lost in the middle of imports, which libraries wrap in a bare `except`, and in callbacks of the interpreter,
    which print and go on. Where interrupts are ignored, as under `nohup`, they stay so.
    """
    if signal.getsignal(signal.SIGINT) is signal.default_int_handler:
        signal.signal(signal.SIGINT, _interrupted)
        sys.unraisablehook = _unraisable


def tell() -> None:
    """Say so, with the cursor shown and the progress bar's line cleared."""
    os.write(2, (b"\r\x1b[2K\x1b[?25h" if os.isatty(2) else b"") + b"scenectl: interrupted\n")


def _interrupted(number: int, frame: FrameType | None) -> None:
    while frame is not None:
        if frame.f_code.co_filename.startswith("<frozen importlib"):
            _end()
        frame = frame.f_back
    raise KeyboardInterrupt


def _unraisable(caught: Any) -> None:
    if caught.exc_type is KeyboardInterrupt:
        _end()
    sys.__unraisablehook__(caught)


def _end() -> None:
    tell()
    os._exit(STATUS)
