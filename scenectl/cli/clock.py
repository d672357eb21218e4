"""Seconds since the process began, imports included, which no clock inside a program sees."""

from __future__ import annotations

import os
import time
from pathlib import Path

_LOADED = time.perf_counter()


def since_start() -> float:
    """Wall-clock seconds since the process was started; since this file was imported, where the system can't say."""
    try:
        fields = Path("/proc/self/stat").read_text().rpartition(")")[2].split()
        started = int(fields[19]) / os.sysconf("SC_CLK_TCK")  # field 22 of proc(5), counted from 1 before the ")"
        return time.clock_gettime(time.CLOCK_BOOTTIME) - started
    except (OSError, AttributeError, ValueError, IndexError):  # not Linux
        return time.perf_counter() - _LOADED


def told(laps: dict[str, float], total: float) -> str:
    """Where the time went, in a line: each lap's seconds, what none of them saw, and the total."""
    laps = {**laps, "the rest": total - sum(laps.values())}
    shown = [f"{name} {seconds:.1f}" for name, seconds in laps.items() if round(seconds, 1) > 0]
    first, *others = shown
    return f"time: {', '.join([f'{first} s', *others])} ({total:.1f} s in all)"
