"""`scenectl help`: an overview, commands, and the keys of task files."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

Run = Callable[..., Any]


def test_help_alone_is_the_overview(scenectl: Run) -> None:
    said = scenectl("help")
    assert said.status == 0 and said.out == scenectl("--help").out and "scenectl" in said.out
    assert "--regenerate" in scenectl("help", "edit").out
    assert scenectl("help", "bench", "rooms").out.split()[:4] == ["Usage:", "scenectl", "bench", "rooms"]


def test_help_tells_the_keys_of_tasks(scenectl: Run) -> None:
    said = scenectl("help", "task")
    assert said.status == 0 and "prompt" in said.out and "[walk]" in said.out
    said = scenectl("help", "task", "walk")
    assert said.status == 0 and "half_width" in said.out and "of the corridor around the path (m)" in said.out
    said = scenectl("help", "task", "wlak")
    assert said.status == 2 and "no table 'wlak'; did you mean 'walk'?" in said.err
    said = scenectl("help", "rum")
    assert said.status == 2 and "No such command 'rum'. Did you mean 'run'?" in said.err
