"""STL files, binary and text."""

from __future__ import annotations

import re
from itertools import chain
from pathlib import Path

import numpy as np

from scenes.errors import UserError
from scenes.mesh.content import Content, Piece

_HEADER = 84
_TEXT = 0x09090909
"""Least number that four bytes of text make, tabs: 150 million triangles, which no scene has."""
_FACET = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])
_CORNER = re.compile(rb"^[ \t]*vertex[ \t]+(\S+)[ \t]+(\S+)[ \t]+(\S+)[ \t]*$", re.IGNORECASE | re.MULTILINE)


def read_stl(path: Path) -> Content:
    """Read the triangles, which share no vertices; bytes that follow the last one are passed over.

    Raises:
        UserError: cut off, or neither kind of STL.
    """
    data = path.read_bytes()
    if not data.strip():
        raise UserError("is empty; export it again")
    count = int.from_bytes(data[80:_HEADER], "little") if len(data) >= _HEADER else 0
    needed = _HEADER + count * _FACET.itemsize
    # headers of binary files may begin with "solid" too, but only they hold zero bytes before an end
    last = data.lower().rfind(b"endsolid")
    text = len(data) != needed and data.lstrip()[:5].lower() == b"solid" and b"\0" not in data[: max(last, 0) or None]
    corners = _text(data, last) if text else _binary(data, count, needed)
    return Content([Piece(path.name, corners, np.arange(len(corners)).reshape(-1, 3))])


def _binary(data: bytes, count: int, needed: int) -> np.ndarray:
    if len(data) < _HEADER:
        raise UserError("is cut off within its header, or is no STL and cannot be read; export or copy it again")
    if len(data) < needed and count >= _TEXT:
        raise UserError("is no STL and cannot be read; export it as such, or give it the ending of its format")
    if len(data) < needed:
        raise UserError(f"is cut off: it holds {len(data)} of {needed} bytes; export or copy it again")
    facets = np.frombuffer(data, _FACET, count, _HEADER)
    return facets["corners"].reshape(-1, 3).astype(np.float64)


def _text(data: bytes, last: int) -> np.ndarray:
    words = _CORNER.findall(data.replace(b"\r", b"\n"))
    if data.lower().rfind(b"facet") > last or len(words) % 3:
        raise UserError("is cut off: it does not end with 'endsolid'; export or copy it again")
    return np.array(list(map(float, chain.from_iterable(words)))).reshape(-1, 3)
