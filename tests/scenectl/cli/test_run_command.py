"""`scenectl run` says where its time went, from the start of the process on."""

from __future__ import annotations

import re
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from scenectl.cli.clock import since_start, told

Run = Callable[..., Any]


def test_the_laps_of_a_run_add_up(scenectl: Run, tiny_generator: None, tmp_path: Path) -> None:
    (tmp_path / "task.toml").write_text('prompt = "a person walks"\nseconds = 4.0\n')
    said = scenectl("run", tmp_path / "task.toml", "-o", tmp_path / "out", "--no-preview", "--allow-unmet")
    (line,) = [line for line in said.out.splitlines() if line.startswith("time: ")]
    *laps, total = (float(number) for number in re.findall(r"\d+\.\d", line))
    assert line.startswith("time: imports ") and line.endswith(" s in all)")
    assert sum(laps) == pytest.approx(total, abs=0.05 * (len(laps) + 4))


def test_what_no_lap_covers_is_told_and_what_takes_no_time_is_not() -> None:
    line = told({"imports": 1.94, "planning": 0.41, "writing": 0.01}, 2.86)
    assert line == "time: imports 1.9 s, planning 0.4, the rest 0.5 (2.9 s in all)"


def test_the_clock_starts_with_the_process() -> None:
    code = "import time; time.sleep(1); from scenectl.cli.clock import since_start; print(since_start())"
    begin = time.perf_counter()
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert 1.0 < float(done.stdout) <= time.perf_counter() - begin + 0.02  # the system counts in hundredths


def test_where_the_system_does_not_tell_the_clock_starts_with_the_import(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delattr(time, "CLOCK_BOOTTIME")
    assert 0 < since_start() < 3600
