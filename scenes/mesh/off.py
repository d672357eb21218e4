"""OFF files: counts, then a line for each vertex and each polygon."""

from __future__ import annotations

import re
from itertools import chain
from pathlib import Path

import numpy as np

from scenes.errors import UserError
from scenes.mesh.content import Content, Piece, text_of
from scenes.mesh.polygons import triangulated

_WORD = re.compile(rb"\s*(ST)?C?N?OFF\b", re.IGNORECASE)
_BINARY = re.compile(_WORD.pattern + rb"\s+BINARY", re.IGNORECASE)


def read_off(path: Path) -> Content:
    """Read the text form with any of the prefixes ST, C and N; what follows positions and corners is passed over.

    Raises:
        UserError: not OFF, binary, or cut off.
    """
    if _BINARY.match(path.read_bytes()[:80]):
        raise UserError("is binary OFF, which is not read; export it as text")
    text = re.sub(rb"#[^\r\n]*", b"", text_of(path))
    word = _WORD.match(text)
    lines = [line.split() for line in (text[word.end() :] if word else text).splitlines() if line.strip()]
    if word is None and not (lines and lines[0][0].isdigit()):
        raise UserError("is not OFF and cannot be read; export it again")
    if not lines or len(lines[0]) < 2:
        raise UserError("is cut off before its counts; export or copy it again")
    points, polygons = int(lines[0][0]), int(lines[0][1])
    rows, rings = lines[1 : 1 + points], lines[1 + points : 1 + points + polygons]
    counts = [int(ring[0]) for ring in rings]
    short = any(len(row) < 3 for row in rows) or any(
        len(ring) <= count for ring, count in zip(rings, counts, strict=True)
    )
    if short or len(rows) < points or len(rings) < polygons:
        raise UserError(
            f"is cut off: it holds {len(rows)} of {points} vertices and {len(rings)} of {polygons} faces; "
            "export or copy it again"
        )
    vertices = np.array(list(map(float, chain.from_iterable(row[:3] for row in rows)))).reshape(-1, 3)
    corners = chain.from_iterable(ring[1 : 1 + count] for ring, count in zip(rings, counts, strict=True))
    faces = triangulated(vertices, np.array(list(map(int, corners)), dtype=np.int64), np.array(counts, dtype=np.int64))
    return Content([Piece(path.name, vertices, faces)])
