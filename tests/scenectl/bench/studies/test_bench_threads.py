"""Generations on one thread and on many, on a machine as it is and beside busy processes."""

from __future__ import annotations

from pathlib import Path

import pytest

from scenectl.bench.studies.threads import SETTINGS, bench_threads
from scenes.errors import UserError


@pytest.fixture
def task(tmp_path: Path) -> Path:
    path = tmp_path / "task.toml"
    path.write_text('prompt = "a person walks"\nseconds = 1.8\n')
    return path


def test_settings_are_timed_alone_and_beside_others(task: Path) -> None:
    chosen = ("one thread", "all threads, asleep while they wait")  # those that spin take minutes
    assert set(chosen) < set(SETTINGS)
    result = bench_threads(task, 1, 1, 100.0, settings=chosen)
    one, many = result["rows"]
    assert (one["setting"], many["setting"]) == chosen and list(result["summary"])[-2:] == list(chosen)
    assert one["threads"] == 1 and many["threads"] >= min(2, result["summary"]["processors"])
    for row in (one, many):
        assert not row["given_up"] and 0 < row["quiet_s"] < 100 and 0 < row["busy_s"] < 100
        assert row["busy_over_quiet"] == row["busy_s"] / row["quiet_s"]
    assert many["quiet_over_first"] == many["quiet_s"] / one["quiet_s"]


def test_what_takes_too_long_is_given_up(task: Path) -> None:
    (row,) = bench_threads(task, 4, 3, 0.001, settings=("one thread",))["rows"]
    assert row["given_up"] and row["quiet_s"] == 0.001 and row["busy_s"] is None


def test_a_task_that_cannot_run_is_told(tmp_path: Path) -> None:
    with pytest.raises(UserError, match="does not exist"):
        bench_threads(tmp_path / "nope.toml")
