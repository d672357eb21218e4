"""Files that are read whole, and files that are either written whole or absent."""

from __future__ import annotations

import json
import os
import stat
import tempfile
import time
import tomllib
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import IO, Any, TypeVar

import numpy as np

from scenes.errors import UserError, clipped

T = TypeVar("T")

MOST_BYTES = 2**30
"""Of a file that is read: a scan of ten million triangles in binary takes half of it. Larger ones are taken for a
mistake, as their numbers alone would fill the memory."""
MOST_TEXT = 2**24
"""Bytes of a table that a person writes, 16 MB: a task of 100,000 waypoints takes a third of it."""

_KINDS = {stat.S_IFDIR: "folder", stat.S_IFIFO: "pipe", stat.S_IFSOCK: "socket"}


def unreadable(path: str | Path, most: int = MOST_BYTES) -> str:
    """Why a path is no file that can be read whole, in words that follow its name; "" where it is one.

    Folders, pipes and devices, which may never end, are none, nor is what is larger than `most` bytes.
    """
    try:
        facts = Path(path).stat()
    except (FileNotFoundError, NotADirectoryError):
        return "does not exist"
    except (OSError, ValueError) as error:  # out of reach, a ring of links, a name too long or with a zero byte
        return f"cannot be read ({_reason(error)})"
    if (kind := stat.S_IFMT(facts.st_mode)) != stat.S_IFREG:
        return f"is a {_KINDS.get(kind, 'device')}; give a file" + " in it" * (kind == stat.S_IFDIR)
    if facts.st_size > most:
        return f"has {facts.st_size / 1e6:.0f} MB, and at most {most / 1e6:.0f} are read; give a smaller file"
    return ""


def readable(path: str | Path, what: str, most: int = MOST_BYTES) -> Path:
    """The path of a file that can be read whole; raises UserError, naming it, where `unreadable` says why not."""
    if fault := unreadable(path, most):
        raise UserError(f"{what} '{clipped(str(path), 300)}' {fault}")
    return Path(path)


def read_bytes(path: str | Path, what: str, most: int = MOST_BYTES) -> bytes:
    """All of a file; errors as of `readable`."""
    path = readable(path, what, most)
    try:
        return path.read_bytes()
    except OSError as error:
        raise UserError(f"{what} '{path}' cannot be read ({_reason(error)})") from error


def read_text(path: str | Path, what: str, most: int = MOST_TEXT) -> str:
    """A text file, without its byte order mark; raises UserError for what is not UTF-8."""
    try:
        return read_bytes(path, what, most).decode("utf-8-sig").replace("\r\n", "\n")
    except UnicodeDecodeError as error:
        raise UserError(
            f"{what} '{path}' cannot be read as UTF-8 text ({error.reason} at byte {error.start})"
        ) from error


def read_toml(path: str | Path, what: str) -> dict[str, Any]:
    """The table in a TOML file; raises UserError naming the file and what is wrong with it."""
    return _parsed(read_text(path, what), path, what, "valid TOML", tomllib.loads)


def read_json(path: str | Path, what: str, remedy: str = "make it again") -> Any:
    """The value in a JSON file; raises UserError naming the file, what is wrong with it, and what to do."""
    try:
        return _parsed(read_text(path, what, MOST_BYTES), path, what, "JSON", json.loads)
    except UserError as error:
        raise UserError(f"{error}; {remedy}") from error


def _parsed(text: str, path: str | Path, what: str, language: str, parse: Callable[[str], T]) -> T:
    try:
        return parse(text)
    except RecursionError:
        fault = "it is nested too deeply"
    except ValueError as error:  # also of whole numbers that Python refuses to read
        fault = "a whole number has too many digits" if "integer string conversion" in str(error) else str(error)
    raise UserError(f"{what} '{path}' is not {language} ({fault})")


def _reason(error: Exception) -> str:
    """What an exception says, as part of a sentence."""
    return clipped(" ".join(str(getattr(error, "strerror", None) or error or type(error).__name__).split()), 120)


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
    path = readable(path, what)
    try:
        with np.load(path, allow_pickle=False) as data:
            return build(data)
    except Exception as error:  # numpy and zipfile raise many kinds; all mean the same to a user
        raise UserError(
            f"{what} '{path}' was not written by scenectl or is damaged ({_reason(error)}); {remedy}"
        ) from error


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
        array = np.load(readable(path, what), allow_pickle=False)
    except UserError as error:
        raise UserError(f"{error}; {hint}") from error
    except (OSError, ValueError, EOFError) as error:
        raise UserError(f"{what} '{path}' is not a NumPy array ({_reason(error)}); {hint}") from error
    if not isinstance(array, np.ndarray) or array.dtype.kind != "f" or array.ndim != len(layout.split(",")):
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
