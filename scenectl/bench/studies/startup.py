"""How long commands take from an empty process, beside `import torch`, which most of them cannot do without."""

from __future__ import annotations

import os
import statistics
import subprocess
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path

from scenectl.bench.engine import ENGINE, Engine, Result, Row
from scenectl.bench.process import environment, python
from scenectl.generators.base import Progress
from scenes.errors import UserError

TORCH = "import torch"
"""The row that ratios are to."""
FAMILIES = ("torch", "numpy", "scipy", "numba", "pydantic", "trimesh", "pyvista", "vtkmodules", "open3d", "matplotlib")
"""Packages whose imports take long enough to be worth a column."""
_MAIN = "from scenectl.cli.app import entry; entry()"
_TELL = "import atexit, sys; atexit.register(lambda: print('imported', *sys.modules, file=sys.stderr)); "


def bench_startup(check: str | Path, run: str | Path, repeats: int = 7, engine: Engine = ENGINE) -> Result:
    """Fresh processes in turn: `import torch`, help, completion, the check of a task and the run of another.

    Args:
        check: a task without a mesh.
        run: a task, run with its own samples and a preview.
        repeats: of each; the median counts.
        engine: tells progress, keeps rows and goes on from them.

    Returns:
        ``{"summary", "rows"}``: a row for each command with its seconds (wall clock, and CPU), their ratio to those of
        `import torch`, and which large packages it imports. Raises UserError for a command that fails.
    """
    return engine.run(
        [("start-up", repeats)],
        lambda number: _measured(check, run, number, engine.progress),
        _summary,
        {"bench": "startup", "check": check, "run": run, "repeats": repeats},
    )


def _measured(check: str | Path, run: str | Path, repeats: int, progress: Progress) -> list[Row]:
    """A row for each command; they take turns."""
    with tempfile.TemporaryDirectory() as folder:
        commands: dict[str, list[str]] = {
            TORCH: [],
            "help": ["--help"],
            "run --help": ["run", "--help"],
            "bench --help": ["bench", "--help"],
            "completion": [],
            "check": ["check", str(check)],
            "run": ["run", str(run), "-o", folder, "--allow-unmet"],
        }
        times: dict[str, list[tuple[float, float]]] = {name: [] for name in commands}
        imported = {name: _packages(name, words) for name, words in commands.items()}
        for done in range(repeats):
            for name, words in commands.items():
                progress(name, done / repeats)
                times[name].append(_timed(name, words))
    wall = {name: statistics.median(each[0] for each in times[name]) for name in commands}
    cpu = {name: statistics.median(each[1] for each in times[name]) for name in commands}
    return [
        {
            "command": name,
            "seconds": wall[name],
            "cpu_s": cpu[name],
            "ratio": wall[name] / wall[TORCH],
            "cpu_ratio": cpu[name] / cpu[TORCH],
            "imports": imported[name],
        }
        for name in commands
    ]


def _summary(rows: Sequence[Row]) -> dict[str, float]:
    wall = {row["command"]: row["seconds"] for row in rows}
    keys = {name: name.replace(" --", "_").replace(" ", "_") for name in wall if name != TORCH}
    ratios = {f"{key}_ratio": wall[name] / wall[TORCH] for name, key in keys.items()}
    return {"import_torch_s": wall[TORCH], "run_s": wall["run"], **ratios}


def _timed(name: str, words: list[str]) -> tuple[float, float]:
    """Wall-clock and CPU seconds of one process."""
    before, begin = os.times(), time.perf_counter()
    _process(name, words, "")
    wall, after = time.perf_counter() - begin, os.times()
    spent = (after.children_user - before.children_user) + (after.children_system - before.children_system)
    return wall, spent


def _packages(name: str, words: list[str]) -> str:
    """Which of `FAMILIES` a command imports; its first run, which also fills caches, tells."""
    said = next(line for line in _process(name, words, _TELL).splitlines() if line.startswith("imported "))
    top = {module.partition(".")[0] for module in said.split()[1:]}
    return " ".join(package for package in FAMILIES if package in top)


def _process(name: str, words: list[str], first: str) -> str:
    """Run a command in a fresh process; what it says on standard error."""
    code = first + (TORCH if name == TORCH else _MAIN)
    more = (
        {} if name != "completion" else {"_SCENECTL_COMPLETE": "complete_bash", "COMP_WORDS": "sc", "COMP_CWORD": "1"}
    )
    done = subprocess.run(
        python("-c", code, *words), env={**environment(), **more}, capture_output=True, text=True, check=False
    )
    if done.returncode != 0:
        lines = [line for line in done.stderr.strip().splitlines() if not line.startswith("imported ")] or [""]
        raise UserError(f"'scenectl {' '.join(words)}' failed: {lines[-1]}")
    return done.stderr
