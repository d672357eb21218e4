"""Files that are read whole, and files that are either written whole or absent."""

from __future__ import annotations

import fcntl
import hashlib
import json
import os
import re
import secrets
import stat
import time
import tomllib
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import IO, Any, TypeVar

import numpy as np

from scenes.archive import load_npy, load_npz
from scenes.errors import UserError, clipped

T = TypeVar("T")

MOST_BYTES = 2**30
"""Of a file that is read: a scan of ten million triangles in binary takes half of it. Larger ones are taken for a
mistake, as their numbers alone would fill the memory."""
MOST_TEXT = 2**24
"""Bytes of a table that a person writes, 16 MB: a task of 100,000 waypoints takes a third of it."""
_HOST = hashlib.sha256(os.uname().nodename.encode()).hexdigest()[:8]
_TEMPORARY = re.compile(r"\..+\.([0-9a-f]{8})-[0-9a-f]{16}\.tmp|\.[0-9a-f]{64}\.npz\.[a-z0-9_]{8}\.tmp")
"""Names of temporary files, which say on which host they are; and what those of cached bakes were called before."""
_OLD = 3600.0
"""Seconds without a change after which a temporary file is nobody's, where nothing tells of its process."""

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
    leads to is replaced. A new file has the permissions that the user's mask leaves, a replaced one keeps its own.
    What killed processes left in the folder is swept. Raises UserError, naming `path`, for what the system refuses and
    for what is no file.
    """
    named, path = path, replaceable(path)
    with writing(named):
        path.parent.mkdir(parents=True, exist_ok=True)
        sweep(path.parent)
        handle, name = _temporary(path)
        try:
            with os.fdopen(handle, mode, encoding=None if "b" in mode else "utf-8") as file:
                yield file
                file.flush()
                os.fsync(file.fileno())
                os.replace(name, path)  # while it is locked
        except BaseException:
            name.unlink(missing_ok=True)
            raise


def _temporary(path: Path) -> tuple[int, Path]:
    """A new file beside `path`, open and locked for as long as this process lives, and its name."""
    while True:
        # Names have 255 bytes at most, and a character up to four.
        name = path.with_name(f".{path.name[:50]}.{_HOST}-{secrets.token_hex(8)}.tmp")
        handle = os.open(name, os.O_CREAT | os.O_EXCL | os.O_RDWR | os.O_CLOEXEC, 0o666)
        with suppress(OSError):  # of another owner, or on a file system without permissions
            os.fchmod(handle, stat.S_IMODE(path.stat().st_mode))
        with suppress(OSError):  # a file system without locks
            fcntl.flock(handle, fcntl.LOCK_EX)
        if name.exists():
            return handle, name
        os.close(handle)  # another process took it for a dead one's before it was locked


def sweep(folder: str | Path) -> None:
    """Delete the temporary files of `atomic_write` in a folder whose processes were killed.

    A process holds a lock on its file while it lives. Files of other hosts, whose locks may not be seen here, and those
    on file systems without locks are deleted when they have not changed for an hour.
    """
    with suppress(OSError):  # there is no such folder, or nothing may be read there
        for entry in list(os.scandir(folder)):
            if (found := _TEMPORARY.fullmatch(entry.name)) and entry.is_file(follow_symlinks=False):
                with suppress(OSError):  # another process was faster, or owns it
                    _sweep(Path(entry.path), here=found[1] == _HOST)


def _sweep(path: Path, here: bool) -> None:
    handle = os.open(path, os.O_RDWR | os.O_CLOEXEC)
    try:
        if here:
            fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
            path.unlink()  # while it is locked: it may be so new that its process waits for the lock
            return
    except BlockingIOError:
        return
    except OSError:  # a file system without locks
        pass
    finally:
        os.close(handle)
    if time.time() - path.stat().st_mtime > _OLD:
        path.unlink()


def write_json(value: Any, path: str | Path, **settings: Any) -> None:
    """Write JSON; the file is whole or absent."""
    with atomic_write(path, "w") as file:
        json.dump(value, file, indent=1, **settings)


@contextmanager
def reading(what: str | Path, remedy: str) -> Iterator[None]:
    """Whatever is raised in the block, which reads a file that may hold anything, is a UserError.

    Args:
        what: names the file, such as "caption file 'x'".
        remedy: says what to do.
    """
    try:
        yield
    except UserError:
        raise
    except Exception as error:  # libraries raise many kinds; all mean the same to a user
        reason = (str(error).strip().splitlines() or [type(error).__name__])[0]
        raise UserError(f"{what} cannot be read ({reason[:200]}); {remedy}") from error


def read_arrays(path: str | Path, what: str, build: Callable[[Any], T], remedy: str = "bake again") -> T:
    """``build(arrays)`` of an .npz file; raises UserError where there is none or `build` finds it unsound.

    `what` names the content, such as "distance grid", and `remedy` says what to do. Nothing that is pickled is read.
    """
    path = readable(path, what)
    try:
        return build(load_npz(path))
    except MemoryError:
        raise
    except Exception as error:  # whatever an unsound file makes `build` raise means the same to a user
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
        array = load_npy(readable(path, what))
    except UserError as error:
        raise UserError(f"{error}; {hint}") from error
    except (OSError, ValueError) as error:
        raise UserError(f"{what} '{path}' is not a NumPy array ({_reason(error)}); {hint}") from error
    if array.dtype.kind != "f" or array.ndim != len(layout.split(",")):
        raise UserError(f"{what} '{path}' is not an array of {layout} floats; {hint}")
    with np.errstate(over="ignore"):
        array = array.astype(np.float32)
    if not np.isfinite(array).all():
        raise UserError(f"{what} '{path}' holds numbers that are not finite; {hint}")
    return array


def writable_folder(folder: Path) -> None:
    """Make a folder where there is none; raises UserError, before minutes of work, where nothing can be written."""
    if folder.exists() and not folder.is_dir():
        raise UserError(f"'{folder}' is a file; give -o a folder")
    folder.mkdir(parents=True, exist_ok=True)
    if not os.access(folder, os.W_OK):
        raise UserError(f"cannot write into '{folder}': permission denied")
    sweep(folder)
