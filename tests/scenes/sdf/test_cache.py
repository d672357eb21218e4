"""A bake that is killed at any moment leaves the old cache or the new one, never half of one."""

from __future__ import annotations

import os
import random
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import torch

from scenes.errors import UserError
from scenes.mesh.primitives import Box
from scenes.sdf.bake import bake
from scenes.sdf.grid import SdfGrid

KILLS = 25

# One warm process forks a child for every kill: each child only writes, and needs no second to start.
NURSERY = """
import importlib, os, signal, sys, time
from pathlib import Path
from scenes.mesh.primitives import Box
baking = importlib.import_module("scenes.sdf.bake")
folder = Path(sys.argv[1])
os.sched_setaffinity(0, [min(os.sched_getaffinity(0))])  # one processor, no threads: a fork would lose them
box = Box((0, 0, 0), (1, 1, 1)).mesh()
small, large = (baking.bake(Box((0, 0, 0), (1, 1, side)).mesh(), 64, cache=None, threads=1) for side in (0.6, 1.0))
baking.bake(box, 32, cache=None, thickness=0.1, threads=1)
first = 0
for line in sys.stdin:
    delay, first = float(line), first + 1000
    begun, begin = os.pipe()
    child = os.fork()
    if child == 0:
        os.write(begin, b"!")
        for step in range(first, first + 1000):
            baking._store(folder / "rewritten.npz", "key", (small, large)[step % 2])
            baking.bake(box, 32, cache=folder, thickness=1e-6 * step, threads=1)
        os._exit(0)
    os.read(begun, 1)
    os.close(begun), os.close(begin)
    time.sleep(delay)
    os.kill(child, signal.SIGKILL)
    os.waitpid(child, 0)
    print("killed", flush=True)
"""


def contents(path: Path) -> dict[str, bytes]:
    with np.load(path, allow_pickle=False) as data:  # reading an array checks its CRC
        return {name: data[name].tobytes() for name in data.files}


def test_a_killed_bake_leaves_whole_files_only(tmp_path: Path) -> None:
    mesh = Box((0, 0, 0), (1, 2, 1)).mesh()
    bake(mesh, 48, cache=tmp_path)
    (old,) = tmp_path.glob("*.npz")
    before = old.read_bytes()
    rng = random.Random(0)
    seen: dict[Path, bytes] = {}
    rewritten, struck = set(), set[str]()
    with subprocess.Popen(
        [sys.executable, "-c", NURSERY, str(tmp_path)], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    ) as nursery:
        assert nursery.stdin is not None and nursery.stdout is not None
        for _ in range(KILLS):
            print(rng.uniform(0.0, 0.2), file=nursery.stdin, flush=True)
            assert nursery.stdout.readline() == "killed\n"
            assert old.read_bytes() == before
            struck |= {path.name for path in tmp_path.glob(".*.tmp")}
            for path in set(tmp_path.glob("*.npz")) - seen.keys():
                values = contents(path)["values"]
                if path.name == "rewritten.npz":
                    rewritten.add(values)
                else:
                    seen[path] = values
        nursery.stdin.close()
    assert 1 <= len(rewritten) <= 2  # one of the two, each time
    assert len(seen) > 5
    assert struck  # some kills struck while a file was written: otherwise this test shows nothing

    bake(mesh, 48, cache=tmp_path)  # it is there already: nothing is written
    assert not list(tmp_path.glob(".*.tmp"))


def test_leftovers_that_cannot_be_deleted_do_no_harm(tmp_path: Path) -> None:
    left = tmp_path / f".{'0' * 64}.npz.abcd_123.tmp"
    left.mkdir()  # no file: it cannot be unlinked
    os.utime(left, (0, 0))
    bake(Box((0, 0, 0), (1, 1, 1)).mesh(), 16, cache=tmp_path)
    assert len(list(tmp_path.glob("*.npz"))) == 1


def replaced(path: Path, **arrays: object) -> None:
    """The cached bake with some of its arrays exchanged, whole and with true checksums."""
    with np.load(path) as data:
        kept = {name: data[name] for name in data.files}
    np.savez(path, allow_pickle=True, **{**kept, **arrays})  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("origin", np.array([1e300, 0.0, 0.0])),
        ("origin", np.array([1, 2, 3])),
        ("values", np.zeros((9, 9, 9))),  # float64
        ("values", np.zeros((9, 9, 9), np.complex64)),
        ("values", np.full((9, 9, 9), 1e30, np.float32)),
        ("values", np.zeros((9, 9), np.float32)),
        ("spacing", np.array(True)),
        ("spacing", np.array(1e300)),
        ("spacing", np.array(1e-300)),
        ("beyond", np.array(0.5)),
        ("margin", np.array(-1.0)),
        ("rule", np.array(3)),
        ("doubts", np.array(["x"], dtype=object)),
        ("confidence", np.zeros(7, np.uint8)),
        ("boundary_edges", np.array("many")),
        ("inward", np.array(2.5)),
    ],
)
def test_a_cached_bake_of_another_type_is_made_again(tmp_path: Path, name: str, value: np.ndarray) -> None:
    mesh = Box((0, 0, 0), (1, 2, 1)).mesh()
    first = bake(mesh, 16, cache=tmp_path)
    (path,) = tmp_path.glob("*.npz")
    before = contents(path)
    replaced(path, **{name: value})
    again = bake(mesh, 16, cache=tmp_path)
    assert torch.equal(again.grid.values, first.grid.values) and again.doubts == first.doubts
    assert contents(path) == before
    if name not in ("rule", "doubts", "confidence", "boundary_edges", "inward"):
        again.grid.save(tmp_path / "grid.npz")
        replaced(tmp_path / "grid.npz", **{name: value})
        with pytest.raises(UserError, match=r"grid\.npz"):
            SdfGrid.load(tmp_path / "grid.npz")
