"""NumPy files from anywhere: headers are read and bounded before any array is made, and nothing pickled is read."""

from __future__ import annotations

import math
import zipfile
from collections.abc import Collection, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.lib import format as npy

MOST = 2**31
"""Bytes that the arrays of a file may take where nothing else is said: twice the largest grid that is measured
(``scenectl bench building``)."""
_MEMBERS = 1000
"""Arrays that a file may hold; ours hold a dozen."""


@dataclass(frozen=True)
class Header:
    """What a NumPy file says about an array before the array itself.

    Attributes:
        shape: of the array.
        dtype: of its entries.
    """

    shape: tuple[int, ...]
    dtype: np.dtype[Any]

    @property
    def size(self) -> int:
        """Bytes that the array takes; entries without a size count one each."""
        return math.prod(self.shape) * max(self.dtype.itemsize, 1)


def npz_headers(path: str | Path) -> dict[str, Header]:
    """What an .npz file holds, by name, without reading any array; raises ValueError or OSError as `load_npz` does."""
    with _opened(path) as archive:
        return _headers(archive)


def load_npz(
    path: str | Path, keys: Collection[str] | None = None, most_bytes: int = MOST, members: int = _MEMBERS
) -> dict[str, np.ndarray]:
    """The arrays of an .npz file, by name.

    A few kilobytes can unpack to gigabytes: what the headers say is added up before the first array is made.

    Args:
        path: the file.
        keys: which arrays to read, of those that are there; all by default.
        most_bytes: that they may take in all.
        members: how many arrays the file may hold.

    Raises:
        ValueError: what is wrong with the file, to be carried on by the caller from "file 'x' ...": not an archive,
            damaged, pickled, or larger than allowed.
        OSError: it cannot be opened.
    """
    with _opened(path) as archive:
        headers = _headers(archive, members)
        wanted = [name for name in headers if keys is None or name in keys]
        _bound(sum(headers[name].size for name in wanted), most_bytes)
        arrays = {}
        for name in wanted:
            with archive.open(f"{name}.npy") as file:
                arrays[name] = _array(file)
        return arrays


def load_npy(path: str | Path, most_bytes: int = MOST) -> np.ndarray:
    """The array of an .npy file, whose header is held against the file's size first; raises as `load_npz` does."""
    with open(path, "rb") as file, _told():
        there = file.seek(0, 2)
        file.seek(0)
        header = _header(file)
        _bound(header.size, most_bytes)
        if header.size > there - file.tell():
            raise ValueError(_SHORT)
        file.seek(0)
        return _array(file)


_SHORT = "its header speaks of more numbers than it holds"


@contextmanager
def _told() -> Iterator[None]:
    """NumPy and zipfile raise many kinds of errors; all of them are a ValueError that says why."""
    try:
        yield
    except MemoryError:
        raise
    except Exception as error:
        raise ValueError(str(error) or type(error).__name__) from error


@contextmanager
def _opened(path: str | Path) -> Iterator[zipfile.ZipFile]:
    with open(path, "rb") as file, _told(), zipfile.ZipFile(file) as archive:
        yield archive


def _headers(archive: zipfile.ZipFile, members: int = _MEMBERS) -> dict[str, Header]:
    infos = archive.infolist()
    if len(infos) > members:
        raise ValueError(f"it holds {len(infos)} arrays, and {members} are the most that is read")
    headers = {}
    for info in infos:
        if not info.filename.endswith(".npy"):
            continue
        with archive.open(info) as file:
            header = _header(file)
            if header.size > info.file_size - file.tell():
                raise ValueError(f"'{info.filename}': {_SHORT}")
        headers[info.filename.removesuffix(".npy")] = header
    return headers


def _header(file: Any) -> Header:
    version = npy.read_magic(file)
    readers = {(1, 0): npy.read_array_header_1_0, (2, 0): npy.read_array_header_2_0}
    if version not in readers:
        raise ValueError(f"it is of version {version[0]}.{version[1]} of NumPy's format; 1.0 and 2.0 are read")
    shape, _, dtype = readers[version](file)
    if dtype.hasobject:
        raise ValueError("it holds pickled Python objects, which are never read")
    if min(shape, default=0) < 0:
        raise ValueError(f"its header speaks of a shape of {shape}")
    return Header(shape, dtype)


def _array(file: Any) -> np.ndarray:
    array: np.ndarray = npy.read_array(file, allow_pickle=False)
    return array


def _bound(size: int, most: int) -> None:
    if size > most:
        raise ValueError(
            f"its arrays would take {size / 1e9:.3g} GB, and {most / 1e9:.3g} GB are the most that is read"
        )
