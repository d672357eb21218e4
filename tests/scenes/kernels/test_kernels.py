"""Kernels run wherever they are: in a child of a process that ran them, and where nothing can be kept on disk."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

import scenes.kernels

FORK = """
import os
from scenes.mesh.primitives import Box
from scenes.sdf.bake import bake
box = Box((0, 0, 0), (1, 1, 1)).mesh()
before = bake(box, 24, cache=None, threads=3).grid.values
child = os.fork()
after = bake(box, 24, cache=None, threads=3).grid.values
if child == 0:
    os._exit(0 if (before == after).all() else 1)
raise SystemExit(os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]))
"""

KERNEL = "from scenes.kernels import kernel\n\n\n@kernel\ndef twice(x):\n    return 2 * x\n"


def made(folder: Path, name: str) -> scenes.kernels.Kernel:
    """A kernel in a file of its own, as numba keeps machine code by file."""
    import importlib.util

    folder.mkdir(exist_ok=True)
    path = folder / f"{name}.py"
    path.write_text(KERNEL)
    spec = importlib.util.spec_from_file_location(name, path)
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    found: scenes.kernels.Kernel = module.twice
    return found


def test_a_child_that_was_forked_bakes_as_its_parent_does() -> None:
    subprocess.run([sys.executable, "-c", FORK], check=True, timeout=60)


def test_a_child_waits_for_no_compilation_of_its_parent() -> None:
    with scenes.kernels._LOCK:
        child = os.fork()
        if child == 0:
            os._exit(0 if scenes.kernels._LOCK.acquire(blocking=False) else 1)
    assert os.waitpid(child, 0)[1] == 0


def test_machine_code_is_kept_beside_the_source(tmp_path: Path) -> None:
    first = made(tmp_path, "kept")
    assert first(3) == 6 and first.compiled.stats.cache_misses
    again = made(tmp_path, "kept")
    assert again(3) == 6 and again.compiled.stats.cache_hits and not again.compiled.stats.cache_misses


def test_where_no_folder_can_be_written_kernels_are_compiled_each_time(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "folder").mkdir()
    (tmp_path / "folder" / "__pycache__").touch()  # as in a read-only install
    monkeypatch.setenv("HOME", os.devnull)
    monkeypatch.setenv("XDG_CACHE_HOME", os.devnull)
    assert made(tmp_path / "folder", "nowhere")(3) == 6


@pytest.mark.parametrize("suffix", [".nbi", ".nbc"])
def test_damaged_machine_code_is_compiled_and_kept_anew(suffix: str, tmp_path: Path) -> None:
    assert made(tmp_path, "damaged")(3) == 6
    (file,) = (tmp_path / "__pycache__").glob(f"*{suffix}")
    file.write_bytes(file.read_bytes()[:-20])
    assert made(tmp_path, "damaged")(3) == 6
    whole = made(tmp_path, "damaged")
    assert whole(3) == 6 and whole.compiled.stats.cache_hits


def test_a_full_disk_costs_time_only(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def full(*_: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("numba.core.caching.IndexDataCacheFile._save_data", full)
    assert made(tmp_path, "full")(3) == 6
