"""Command-line tests run in this process, with a generator that needs no weights."""

from __future__ import annotations

import importlib.util
import sys
from collections.abc import Callable
from pathlib import Path
from types import ModuleType
from typing import NamedTuple

import pytest

_spec = importlib.util.spec_from_file_location("tiny", Path(__file__).with_name("tiny.py"))
assert _spec is not None and _spec.loader is not None
_tiny = importlib.util.module_from_spec(_spec)
sys.modules["tiny"] = _tiny
_spec.loader.exec_module(_tiny)


class Said(NamedTuple):
    status: int
    out: str
    err: str


@pytest.fixture(scope="session")
def tiny() -> ModuleType:
    return _tiny


@pytest.fixture
def tiny_generator(monkeypatch: pytest.MonkeyPatch) -> None:
    """`load_generator` gives a tiny one for any weights."""
    for room in ("scenectl.pipeline.run", "scenectl.generators"):  # the first imports the second's real one
        monkeypatch.setattr(f"{room}.load_generator", lambda *args, **kwargs: _tiny.TinyGenerator())


@pytest.fixture
def scenectl(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> Callable[..., Said]:
    """Run the command line: exit status, standard output and standard error."""
    from scenectl.cli.app import main

    def run(*arguments: object) -> Said:
        monkeypatch.setattr(sys, "argv", ["scenectl", *map(str, arguments)])
        capsys.readouterr()
        with pytest.raises(SystemExit) as leaving:
            main()
        said = capsys.readouterr()
        code = leaving.value.code
        return Said(code if isinstance(code, int) else 0, said.out, said.err)

    return run
