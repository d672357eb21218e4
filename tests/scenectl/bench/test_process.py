"""Processes that benches start import nothing from the working directory, and the code that is running here."""

from __future__ import annotations

import ast
import json
import subprocess
from pathlib import Path

import pytest

import scenectl
from scenectl.bench.process import environment, python
from scenectl.bench.scenes.query import _measured_elsewhere
from scenectl.bench.studies.startup import _process

PACKAGE = Path(scenectl.__file__).parent
WHERE = "import json, numpy, scenectl; print(json.dumps([numpy.__file__, scenectl.__file__]))"


@pytest.fixture
def hostile(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A working directory full of names that we import; what is imported there leaves a trace."""
    for name in ("numpy", "torch", "scenectl", "scenes", "typer", "json", "rich"):
        (tmp_path / f"{name}.py").write_text(f"open({str(tmp_path / 'run')!r}, 'w'); raise SystemExit(7)")
    monkeypatch.chdir(tmp_path)
    return tmp_path / "run"


@pytest.mark.parametrize("paths", [None, "", ":", "elsewhere:"])
def test_nothing_is_imported_from_the_working_directory(
    paths: str | None, hostile: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    if paths is None:
        monkeypatch.delenv("PYTHONPATH", raising=False)
    else:
        monkeypatch.setenv("PYTHONPATH", paths)
    done = subprocess.run(python("-c", WHERE), env=environment(), capture_output=True, text=True, check=True)
    assert json.loads(done.stdout)[1] == scenectl.__file__ and not hostile.exists()


def test_benches_run_elsewhere(hostile: Path) -> None:
    rows = _measured_elsewhere(("doorway", 16, 1, 0, [10], ["walk"]))
    assert rows and not hostile.exists()
    _process("help", ["--help"], "")
    assert not hostile.exists()


def test_python_is_started_in_one_place_only() -> None:
    for path in PACKAGE.rglob("*.py"):
        names = {f"{node.value.id}.{node.attr}" for node in ast.walk(ast.parse(path.read_text(encoding="utf-8")))
                 if isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name)}  # fmt: skip
        assert "sys.executable" not in names or path.name == "process.py", path
