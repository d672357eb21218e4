"""Files that are either whole or absent."""

from __future__ import annotations

import json
import os
import stat
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import IO, Any, TypeVar

import numpy as np

from scenes.archive import load_npy, load_npz
from scenes.errors import UserError

T = TypeVar("T")

_KINDS = {stat.S_IFDIR: "folder", stat.S_IFIFO: "pipe", stat.S_IFSOCK: "socket"}


@contextmanager
def writing(path: str | Path) -> Iterator[None]:
    """What the system refuses in the block, as on a full disk, is a UserError that names the file and the reason."""
    try:
        yield
    except OSError as error:
        raise UserError(f"cannot write '{path}': {error.strerror or error}") from error


def replaceable(path: str | Path) -> Path:
    """The file that is made or replaced when `path` is written: where it leads, if it is a symbolic link.

    Raises UserError where something else is there, such as a device or a folder.
    """
    path = Path(path)
    with writing(path):
        kind = stat.S_IFMT(path.stat().st_mode) if path.exists() else stat.S_IFREG
    if kind != stat.S_IFREG:
        raise UserError(f"cannot write '{path}': it is a {_KINDS.get(kind, 'device')}; give the path of a file")
    return Path(os.path.realpath(path)) if path.is_symlink() else path


@contextmanager
def atomic_write(path: str | Path, mode: str = "wb") -> Iterator[IO[Any]]:
    """Open a temporary file beside `path` and rename it over `path` when the block ends well.

    A crash, a kill or a full disk leaves the old file or the new one, never half of one; of a symbolic link, what it
    leads to is replaced. Raises UserError, naming `path`, for what the system refuses and for what is no file.
    """
    named, path = path, replaceable(path)
    with writing(named):
        path.parent.mkdir(parents=True, exist_ok=True)
        handle, name = tempfile.mkstemp(dir=path.parent, prefix=f".{path.name}.", suffix=".tmp")
        try:
            os.fchmod(handle, 0o644)  # mkstemp makes private files; results are meant to be shared
            with os.fdopen(handle, mode) as file:
                yield file
                file.flush()
                os.fsync(file.fileno())
            os.replace(name, path)
        except BaseException:
            Path(name).unlink(missing_ok=True)
            raise


def write_json(value: Any, path: str | Path, **settings: Any) -> None:
    """Write JSON; the file is whole or absent."""
    with atomic_write(path, "w") as file:
        json.dump(value, file, indent=1, **settings)


def read_arrays(path: str | Path, what: str, build: Callable[[Any], T], remedy: str = "bake again") -> T:
    """``build(arrays)`` of an .npz file; raises UserError where there is none or `build` finds it unsound.

    `what` names the content, such as "distance grid", and `remedy` says what to do. Nothing that is pickled is read.
    """
    path = Path(path)
    if not path.is_file():
        raise UserError(f"{what} '{path}' does not exist")
    try:
        return build(load_npz(path))
    except MemoryError:
        raise
    except Exception as error:  # whatever an unsound file makes `build` raise means the same to a user
        raise UserError(f"{what} '{path}' was not written by scenectl or is damaged ({error}); {remedy}") from error


def read_array(path: str | Path, what: str, layout: str, hint: str) -> np.ndarray:
    """The finite numbers of an .npy file, as float32; nothing that is pickled is read.

    Args:
        path: the file.
        what: names the content, such as "HumanML3D file".
        layout: its axes, such as "[T, 263]"; their number is checked.
        hint: what to do where it is damaged.

    Raises:
        UserError: there is no such file, or it holds something else.
    """
    try:
        array = load_npy(path)
    except FileNotFoundError:
        raise UserError(f"{what} '{path}' does not exist; {hint}") from None
    except (OSError, ValueError) as error:
        raise UserError(f"{what} '{path}' is not a NumPy array ({error}); {hint}") from error
    if array.dtype.kind != "f" or array.ndim != len(layout.split(",")):
        raise UserError(f"{what} '{path}' is not an array of {layout} floats; {hint}")
    if not np.isfinite(array).all():
        raise UserError(f"{what} '{path}' holds numbers that are not finite; {hint}")
    return array.astype(np.float32)


def clear_stale(folder: Path, seconds: float = 3600.0) -> None:
    """Delete what `atomic_write` left in a folder when its process was killed: temporary files as old as this."""
    for path in folder.glob(".*.tmp"):
        try:
            if time.time() - path.stat().st_mtime > seconds:
                path.unlink()
        except OSError:  # another process was faster, or owns it
            continue


def writable_folder(folder: Path) -> None:
    """Make a folder where there is none; raises UserError, before minutes of work, where nothing can be written."""
    if folder.exists() and not folder.is_dir():
        raise UserError(f"'{folder}' is a file; give -o a folder")
    folder.mkdir(parents=True, exist_ok=True)
    if not os.access(folder, os.W_OK):
        raise UserError(f"cannot write into '{folder}': permission denied")
