"""Where the time of a command goes, from the start of its process on."""

from __future__ import annotations

import gc
import os
import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path

_LOADED = time.perf_counter()


@contextmanager
def importing() -> Iterator[None]:
    """Within the block, nothing looks for garbage: imports make hundreds of thousands of objects and none of it."""
    gc.disable()
    try:
        yield
    finally:
        gc.enable()


def since_start() -> float:
    """Wall-clock seconds since the process was started; since this file was imported, where the system can't say."""
    try:
        fields = Path("/proc/self/stat").read_text().rpartition(")")[2].split()
        started = int(fields[19]) / os.sysconf("SC_CLK_TCK")  # field 22 of proc(5), counted from 1 before the ")"
        return time.clock_gettime(time.CLOCK_BOOTTIME) - started
    except (OSError, AttributeError, ValueError, IndexError):  # not Linux
        return time.perf_counter() - _LOADED


def told(laps: Mapping[str, float], total: float) -> str:
    """Laps (s) in one line, with what none of them covers and the total; those too short to show are left out."""
    parts = {**laps, "the rest": total - sum(laps.values())}
    (name, seconds), *others = ((name, seconds) for name, seconds in parts.items() if seconds >= 0.05)
    more = "".join(f", {name} {seconds:.1f}" for name, seconds in others)
    return f"time: {name} {seconds:.1f} s{more} ({total:.1f} s in all)"
