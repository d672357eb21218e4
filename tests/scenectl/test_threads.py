"""Torch's threads: as many as asked for within a block, as before after it, in whichever order torch was imported."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Iterator
from contextvars import copy_context
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest
import torch

import scenectl as sc
from scenectl.threads import threads, use
from scenes.errors import UserError


@pytest.fixture(autouse=True)
def four() -> Iterator[None]:
    before = torch.get_num_threads()
    torch.set_num_threads(4)
    yield
    torch.set_num_threads(before)


def test_one_unless_asked_and_as_before_afterwards() -> None:
    with threads() as number:
        assert number == torch.get_num_threads() == 1
    assert torch.get_num_threads() == 4
    with threads(3) as number:
        assert number == torch.get_num_threads() == 3
    assert torch.get_num_threads() == 4


def test_an_inner_block_that_asks_for_nothing_keeps_what_the_outer_one_asked_for() -> None:
    with threads(3), threads() as number:
        assert number == torch.get_num_threads() == 3
    with threads(), threads(2), threads() as number:
        assert number == torch.get_num_threads() == 2
    with threads() as number:  # nothing is left of what was asked for
        assert number == 1


def test_a_failure_puts_them_back() -> None:
    with pytest.raises(RuntimeError), threads(2), threads():
        raise RuntimeError
    assert torch.get_num_threads() == 4
    with threads() as number:
        assert number == 1


@pytest.mark.parametrize(("asked", "found"), [(None, 1), (2, 2)])
def test_a_run_generates_on_one_thread_or_those_of_its_task(tiny: ModuleType, asked: int | None, found: int) -> None:
    seen = []

    class Watched(tiny.TinyGenerator):  # type: ignore[misc, name-defined]
        def generate(self, *words: Any, **settings: Any) -> Any:
            seen.append(torch.get_num_threads())
            return super().generate(*words, **settings)

    sc.run(sc.Task(prompt="a person walks", seconds=3.0, generator={"threads": asked}), generator=Watched())
    assert seen == [found] and torch.get_num_threads() == 4


@pytest.mark.parametrize("first", ["import torch, scenectl", "import scenectl, torch"])
def test_importing_scenectl_leaves_threads_and_environment_alone(first: str) -> None:
    code = f"""import os
before = dict(os.environ)
{first}
import scenectl.pipeline.run
assert torch.get_num_threads() == 2 and dict(os.environ) == before"""
    plain = {key: value for key, value in os.environ.items() if key != "OMP_WAIT_POLICY"}
    subprocess.run([sys.executable, "-c", code], check=True, env={**plain, "OMP_NUM_THREADS": "2"})


@pytest.mark.parametrize(("given", "found"), [({}, "PASSIVE"), ({"OMP_WAIT_POLICY": "ACTIVE"}, "ACTIVE")])
def test_training_lets_threads_sleep_unless_told_otherwise(given: dict[str, str], found: str, tmp_path: Path) -> None:
    code = f"""import atexit, os, sys
sys.argv = ["scenectl", "train", "nothing", "--data", {str(tmp_path)!r}]
atexit.register(lambda: print(os.environ["OMP_WAIT_POLICY"]))
from scenectl.cli.app import main
main()"""
    plain = {key: value for key, value in os.environ.items() if key != "OMP_WAIT_POLICY"}
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, env={**plain, **given})
    assert done.returncode == 2 and done.stdout.split() == [found]


def test_what_a_user_sets_once_holds_where_nothing_is_asked_for() -> None:
    def seen() -> tuple[int, int, int]:
        use(3)
        with threads() as inner, threads(2) as other:
            pass
        return inner, other, torch.get_num_threads()

    assert copy_context().run(seen) == (3, 2, 3)  # in a context of its own, so that other tests see none of it


def test_a_decorated_function_runs_on_one_thread_at_every_call() -> None:
    count = threads()(torch.get_num_threads)
    assert [count(), count()] == [1, 1] and torch.get_num_threads() == 4


@pytest.mark.parametrize("number", [0, -1, 100_000])
def test_a_number_that_cannot_be_is_refused(number: int) -> None:
    before = torch.get_num_threads()
    with pytest.raises(UserError, match="give 1 to"), threads(number):
        pass
    with pytest.raises(UserError, match="give 1 to"):
        use(number)
    assert torch.get_num_threads() == before
