"""Files are whole or absent, and a disk that is full is named by the file that did not fit."""

from __future__ import annotations

import os
import signal
import stat
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch

from objectives import Term
from scenectl.bench.engine import Engine
from scenectl.export import bvh
from scenectl.export.animation import Animation
from scenectl.export.settings import Settings
from scenectl.generators.mscot.training.stages import MSCoTRecipe
from scenectl.tasks.task import load_task
from scenectl.training.recipe import load_recipe
from scenes.body.gltf import read_rig
from scenes.body.proxies import Proxies
from scenes.body.urdf import read_urdf
from scenes.errors import UserError
from scenes.files import (
    MOST_BYTES,
    atomic_write,
    read_array,
    read_arrays,
    read_bytes,
    read_json,
    read_text,
    read_toml,
    sweep,
    write_json,
)
from scenes.mesh.mesh import load_mesh
from scenes.mesh.primitives import Box
from scenes.motion.bones import rest_pose
from scenes.motion.motion import Motion
from scenes.motion.skeleton import HUMANML3D
from scenes.sdf.bake import bake
from scenes.sdf.grid import SdfGrid

FULL = "cannot write '{}': No space left on device"


def person() -> Motion:
    return Motion(torch.as_tensor(rest_pose(HUMANML3D), dtype=torch.float32).expand(40, 22, 3).clone())


def png(path: Path) -> None:
    from PIL import Image

    with atomic_write(path) as file:  # as `scenectl.view.stage.write` does
        Image.fromarray(np.zeros((300, 300, 3), np.uint8)).save(file, format="PNG", compress_level=0)


WRITES: dict[str, Callable[[Path], Any]] = {
    "motion.npz": lambda path: person().save(path),
    "report.json": lambda path: write_json({"a": [1.0] * 10_000}, path),
    "small.json": lambda path: write_json({}, path),
    "grid.npz": lambda path: bake(Box((0, 0, 0), (1, 1, 1)).mesh(), 16, cache=None).grid.save(path),
    "walk.bvh": lambda path: bvh.write([Animation.of(person())[0]], path, Settings()),
    "preview.png": png,
}


@contextmanager
def full_disk(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """Temporary files can be made, as an inode costs nothing, and nothing fits into them."""

    def made(path: Path) -> tuple[int, Path]:
        name = path.with_name(f".{path.name}.0.tmp")
        name.touch()
        return os.open("/dev/full", os.O_WRONLY), name

    with monkeypatch.context() as patch:
        patch.setattr("scenes.files._temporary", made)
        yield


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="needs a device that is always full")
@pytest.mark.parametrize("name", WRITES)
@pytest.mark.filterwarnings("error")  # such as an exception that a half-written archive raises when it is collected
def test_a_full_disk_is_one_sentence_that_names_the_file(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / name
    path.write_bytes(b"the old one")
    with full_disk(monkeypatch), pytest.raises(UserError) as caught:
        WRITES[name](path)
    assert str(caught.value) == FULL.format(path)
    assert os.listdir(tmp_path) == [name] and path.read_bytes() == b"the old one"


def test_a_disk_that_is_full_only_at_the_end_names_the_file_too(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(handle: int) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(os, "fsync", full)
    for name, write in WRITES.items():
        with pytest.raises(UserError, match=rf"cannot write '.*{name}': No space left on device"):
            write(tmp_path / name)
    assert os.listdir(tmp_path) == []


def test_what_else_the_system_refuses_names_the_file(tmp_path: Path) -> None:
    (tmp_path / "folder").mkdir()
    with pytest.raises(UserError, match=r"cannot write '.*folder': it is a folder; give the path of a file"):
        write_json({}, tmp_path / "folder")
    (tmp_path / "file").touch()
    with pytest.raises(UserError, match=r"cannot write '.*below.json': (Not a directory|File exists)"):
        write_json({}, tmp_path / "file" / "below.json")
    assert sorted(os.listdir(tmp_path)) == ["file", "folder"]


@pytest.mark.parametrize("name", WRITES)
def test_what_is_no_file_is_never_replaced(name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    pipe, link = tmp_path / name, tmp_path / f"link to {name}"
    os.mkfifo(pipe)
    link.symlink_to(pipe)
    monkeypatch.setattr("scenes.files._temporary", None)  # nothing is written beside it either
    for path in (pipe, link):
        with pytest.raises(UserError, match=rf"cannot write '.*{name}': it is a pipe; give the path of a file"):
            WRITES[name](path)
    assert pipe.is_fifo() and link.is_symlink()
    with pytest.raises(UserError, match=f"cannot write '{os.devnull}': it is a device"):
        WRITES[name](Path(os.devnull))
    assert Path(os.devnull).is_char_device()


def test_what_a_link_leads_to_is_replaced_and_the_link_stays(tmp_path: Path) -> None:
    (tmp_path / "there").mkdir()
    for name in ("old.json", "new.json"):
        (tmp_path / name).symlink_to(Path("there", name))
    (tmp_path / "there" / "old.json").write_text("1")
    for name in ("old.json", "new.json"):
        write_json([2], tmp_path / name)
        assert (tmp_path / name).is_symlink()
        assert (tmp_path / "there" / name).read_text() == "[\n 2\n]"
    (tmp_path / "ring.json").symlink_to("ring.json")
    write_json([3], tmp_path / "ring.json")
    assert (tmp_path / "ring.json").read_text() == "[\n 3\n]"
    assert sorted(os.listdir(tmp_path / "there")) == ["new.json", "old.json"]


def test_a_cache_on_a_full_disk_costs_time_and_not_the_result(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    with full_disk(monkeypatch), pytest.warns(UserWarning, match=r"could not be cached: cannot write '.*\.npz': No sp"):
        result = bake(Box((0, 0, 0), (1, 1, 1)).mesh(), 16, cache=tmp_path)
    assert result.grid.values.isfinite().all() and os.listdir(tmp_path) == []


def test_rows_that_a_bench_keeps_name_their_file(tmp_path: Path) -> None:
    engine = Engine(file=tmp_path / "bench.json")
    (tmp_path / "bench.json.rows").symlink_to("/dev/full")
    with pytest.raises(UserError, match=r"cannot write '.*bench.json.rows': No space left on device"):
        engine.run([("one", 1)], lambda case: [{"n": case}], lambda rows: {}, {})


def special(folder: Path) -> dict[str, tuple[Path, str]]:
    """What is no file, and what is said of it."""
    os.mkfifo(folder / "pipe")
    (folder / "ring").symlink_to(folder / "ring")
    with (folder / "large").open("wb") as file:
        file.truncate(MOST_BYTES + 1)  # takes no room on the disk
    return {
        "pipe": (folder / "pipe", "is a pipe"),
        "folder": (folder, "is a folder; give a file in it"),
        "device": (Path("/dev/zero"), "is a device"),
        "ring": (folder / "ring", "cannot be read"),
        "nothing": (folder / "nothing", "does not exist"),
        "below a file": (folder / "large" / "x", "does not exist"),
        "long name": (folder / ("x" * 4000), "cannot be read"),
        "zero byte": (folder / "a\0b", "cannot be read"),
        "large": (folder / "large", "MB"),
    }


READS: dict[str, Callable[[Path], object]] = {
    "bytes": lambda path: read_bytes(path, "file"),
    "text": lambda path: read_text(path, "file"),
    "toml": lambda path: read_toml(path, "file"),
    "json": lambda path: read_json(path, "file"),
    "arrays": lambda path: read_arrays(path, "file", dict),
    "array": lambda path: read_array(path, "file", "[T, 3]", "make it again"),
    "task": load_task,
    "recipe": lambda path: load_recipe(path, MSCoTRecipe),
    "body": Proxies.load,
    "motion": Motion.load,
    "grid": SdfGrid.load,
    "robot": read_urdf,
    "character": read_rig,
    "mesh": load_mesh,
    "track": lambda path: Term("joint_target", {"joint": "pelvis", "track": {"kind": "array", "file": str(path)}}),
}


@pytest.mark.parametrize("read", READS)
def test_only_files_of_a_bounded_size_are_read(read: str, tmp_path: Path) -> None:
    for kind, (path, words) in special(tmp_path).items():
        with pytest.raises(UserError) as told:
            READS[read](path)
        text = str(told.value)
        if read != "recipe":  # which may be a bundled one
            assert words in text, kind
        assert "\n" not in text and len(text) < 600


def test_a_byte_order_mark_is_no_part_of_a_text(tmp_path: Path) -> None:
    path = tmp_path / "a.txt"
    path.write_bytes(b"\xef\xbb\xbfx = 1\r\ny = 2\n")
    assert read_text(path, "file") == "x = 1\ny = 2\n" and read_toml(path, "file") == {"x": 1, "y": 2}
    path.write_bytes(b'\xef\xbb\xbf{"x": 1}')
    assert read_json(path, "file") == {"x": 1}


@pytest.mark.parametrize(
    ("toml", "json", "words"),
    [
        ("x = " + "9" * 5000, "9" * 5000, "too many digits"),
        ("x = " + "[" * 20000 + "]" * 20000, "[" * 200000 + "]" * 200000, "nested too deeply"),
        ("x = ", "[1,", "is not"),
        ("x = '\xff'", "'\xff'", "UTF-8"),
    ],
)
def test_tables_that_parsers_cannot_read_are_told(tmp_path: Path, toml: str, json: str, words: str) -> None:
    path, readers = tmp_path / "a", ((read_toml, toml), (read_json, json))
    for read, text in readers:
        path.write_bytes(text.encode("latin-1"))
        with pytest.raises(UserError, match=words) as told:
            read(path, "table")
        assert str(told.value).startswith(f"table '{path}'") and len(str(told.value)) < 300


def test_two_thousand_levels_are_too_deep_for_toml(tmp_path: Path) -> None:
    (tmp_path / "a.toml").write_text("x = " + "[" * 2000 + "]" * 2000)
    with pytest.raises(UserError, match="nested too deeply"):
        read_toml(tmp_path / "a.toml", "table")


WRITER = """
import signal, sys, time
signal.signal(signal.SIGINT, signal.default_int_handler)  # ignored by what is started behind a shell's back
from scenes.files import atomic_write
with atomic_write(sys.argv[1]) as file:
    file.write(bytes(100_000)), file.flush(), print("writing", flush=True)
    time.sleep(60)
"""


@contextmanager
def writer(path: Path) -> Iterator[subprocess.Popen[str]]:
    """A process in the middle of writing a file."""
    process = subprocess.Popen([sys.executable, "-c", WRITER, str(path)], stdout=subprocess.PIPE, text=True)
    assert process.stdout is not None
    with process:
        assert process.stdout.readline() == "writing\n"
        try:
            yield process
        finally:
            process.kill()


def temporary(folder: Path) -> list[str]:
    return [path.name for path in folder.iterdir() if path.suffix == ".tmp"]


@pytest.mark.parametrize("number", [signal.SIGKILL, signal.SIGTERM])
def test_what_a_killed_process_left_is_swept_at_the_next_write_and_what_a_living_one_writes_is_not(
    number: signal.Signals, tmp_path: Path
) -> None:
    with writer(tmp_path / "alive.bin") as alive:
        (living,) = temporary(tmp_path)
        with writer(tmp_path / "report.json") as killed:
            assert len(temporary(tmp_path)) == 2
            killed.send_signal(number)
            killed.wait()
        assert len(temporary(tmp_path)) == 2
        write_json({}, tmp_path / "other.json")
        assert temporary(tmp_path) == [living] and alive.poll() is None
    sweep(tmp_path)
    assert os.listdir(tmp_path) == ["other.json"]


def test_an_interrupted_process_sweeps_its_own_file(tmp_path: Path) -> None:
    with writer(tmp_path / "report.json") as interrupted:
        interrupted.send_signal(signal.SIGINT)
        interrupted.wait()
    assert os.listdir(tmp_path) == []


def test_files_of_other_hosts_are_swept_when_they_are_old_and_files_of_other_programs_never(tmp_path: Path) -> None:
    with atomic_write(tmp_path / "a.bin"):
        (own,) = temporary(tmp_path)
    elsewhere = own.rpartition(".tmp")[0][:-25] + "0123abcd-0123456789abcdef.tmp"
    others = [".a.bin.swp.tmp", ".config.tmp", "a.tmp", ".a.bin.0123abcd.tmp"]
    for name in (elsewhere, *others):
        (tmp_path / name).touch()
    sweep(tmp_path)
    assert elsewhere in os.listdir(tmp_path)
    for name in (elsewhere, *others):
        os.utime(tmp_path / name, (time.time() - 7200,) * 2)
    sweep(tmp_path)
    assert sorted(os.listdir(tmp_path)) == sorted(["a.bin", *others])


def test_where_nothing_can_be_locked_only_age_tells(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def unsupported(*_: Any) -> None:
        raise OSError(37, "No locks available")

    monkeypatch.setattr("fcntl.flock", unsupported)
    with atomic_write(tmp_path / "a.bin"):
        (own,) = temporary(tmp_path)
        sweep(tmp_path)
        assert temporary(tmp_path) == [own]
        os.utime(tmp_path / own, (0, 0))
        sweep(tmp_path)
        assert temporary(tmp_path) == []
        (tmp_path / own).touch()


def test_writers_and_sweepers_at_once_never_lose_a_file(tmp_path: Path) -> None:
    code = (
        "import sys; from scenes.files import write_json\n"
        "for i in range(150): write_json([i], f'{sys.argv[1]}/{sys.argv[2]}-{i}.json')"
    )
    children = [subprocess.Popen([sys.executable, "-c", code, str(tmp_path), str(n)]) for n in range(3)]
    while any(child.poll() is None for child in children):
        sweep(tmp_path)
    assert [child.returncode for child in children] == [0, 0, 0]
    assert len(list(tmp_path.iterdir())) == 450


def test_the_users_mask_holds_and_a_file_that_is_replaced_keeps_its_permissions(tmp_path: Path) -> None:
    for mask in (0o022, 0o077, 0o002):
        before = os.umask(mask)
        try:
            write_json({}, tmp_path / f"{mask}.json")
        finally:
            os.umask(before)
        assert stat.S_IMODE((tmp_path / f"{mask}.json").stat().st_mode) == 0o666 & ~mask
    (tmp_path / "18.json").chmod(0o640)
    write_json([1], tmp_path / "18.json")
    assert stat.S_IMODE((tmp_path / "18.json").stat().st_mode) == 0o640


def test_names_as_long_as_names_can_be(tmp_path: Path) -> None:
    for name in ("x" * 250 + ".json", "\N{SNOWMAN}" * 80 + ".json"):
        write_json({}, tmp_path / name)
        assert (tmp_path / name).is_file()


NO_ARRAYS = (b"", b"PK\x03\x04", b"\x93NUMPY\x01\x00\x10\x00{'descr': (\n", b"\x93NUMPY" + bytes(300))


@pytest.mark.parametrize("content", NO_ARRAYS)
def test_whatever_numpy_raises_is_one_sentence(content: bytes, tmp_path: Path) -> None:
    (tmp_path / "a.npy").write_bytes(content)
    with pytest.raises(UserError, match="is not a NumPy array"):
        read_array(tmp_path / "a.npy", "file", "[T]", "make it again")
