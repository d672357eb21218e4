"""Fresh processes of commands, beside `import torch`."""

from __future__ import annotations

from pathlib import Path

import pytest

from scenectl.bench.studies.startup import TORCH, bench_startup
from scenes.errors import UserError


def test_commands_are_timed_in_processes_of_their_own(tmp_path: Path) -> None:
    task = tmp_path / "task.toml"
    task.write_text('prompt = "a person walks"\nseconds = 1.8\n')
    result = bench_startup(task, task, 1)
    rows = {row["command"]: row for row in result["rows"]}
    assert rows[TORCH]["ratio"] == 1.0 and "torch" in rows[TORCH]["imports"]
    assert not {"torch", "numpy"} & set(f"{rows['help']['imports']} {rows['completion']['imports']}".split())
    assert {"torch", "pydantic"} <= set(rows["check"]["imports"].split()) <= set(rows["run"]["imports"].split())
    assert result["summary"]["check_ratio"] == rows["check"]["seconds"] / rows[TORCH]["seconds"]
    assert rows["run"]["seconds"] > rows["help"]["seconds"] > 0 and rows["help"]["cpu_s"] > 0


def test_a_command_that_fails_is_told(tmp_path: Path) -> None:
    with pytest.raises(UserError, match=r"nope\.toml' does not exist"):
        bench_startup(tmp_path / "nope.toml", tmp_path / "nope.toml", 1)
