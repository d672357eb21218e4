"""Runs of many lengths in one process, and the memory that it holds after each tenth of them."""

from __future__ import annotations

from pathlib import Path

import pytest

from scenectl.bench.studies.memory import SECONDS, STATM, bench_memory
from scenes.errors import UserError


@pytest.fixture
def task(tmp_path: Path) -> Path:
    path = tmp_path / "task.toml"
    path.write_text('prompt = "a person walks"\nseconds = 1.8\n')
    return path


@pytest.mark.skipif(not STATM.exists(), reason="Linux tells how much memory is in use")
def test_memory_is_told_after_each_tenth_of_the_runs(task: Path) -> None:
    result = bench_memory(task, 14)
    rows, summary = result["rows"], result["summary"]
    assert [row["runs"] for row in rows] == [2, 3, 5, 6, 7, 9, 10, 12, 13, 14]
    assert summary["runs"] == 14 and summary["grew_mb"] == rows[-1]["resident_mb"] - rows[0]["resident_mb"]
    assert all(row["resident_mb"] > 50 for row in rows)  # torch alone takes more


def test_lengths_are_many_and_mixed() -> None:
    assert len(set(SECONDS)) == 61 and min(SECONDS) == 2.0 and 7.9 < max(SECONDS) < 8.1
    assert min(abs(a - b) for a, b in zip(SECONDS, SECONDS[1:], strict=False)) > 0.4


def test_too_few_runs_are_refused(task: Path) -> None:
    with pytest.raises(UserError, match="give 10 or more"):
        bench_memory(task, 9)
