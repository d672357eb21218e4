"""PLY files, binary and text."""

from __future__ import annotations

import re
import struct
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from scenes.errors import UserError
from scenes.mesh.content import Content, Piece
from scenes.mesh.polygons import triangulated

_TYPES = {
    "char": "i1", "int8": "i1", "uchar": "u1", "uint8": "u1", "short": "i2", "int16": "i2", "ushort": "u2",
    "uint16": "u2", "int": "i4", "int32": "i4", "uint": "u4", "uint32": "u4", "float": "f4", "float32": "f4",
    "double": "f8", "float64": "f8", "int64": "i8", "uint64": "u8",
}  # fmt: skip
_ORDERS = {"ascii": "<", "binary_little_endian": "<", "binary_big_endian": ">"}
_END = re.compile(rb"^end_header[ \t]*(\r\n|\n|\r)", re.MULTILINE)
_CODES = {"i1": "b", "u1": "B", "i2": "h", "u2": "H", "i4": "i", "u4": "I", "i8": "q", "u8": "Q", "f4": "f", "f8": "d"}


_Column = tuple[np.ndarray, np.ndarray]
"""Numbers of a property, row after row, and how many each row has."""


@dataclass(frozen=True)
class _Property:
    name: str
    kind: str
    count: str = ""  # type of its length, where it is a list


@dataclass(frozen=True)
class _Element:
    name: str
    rows: int
    properties: list[_Property]


def read_ply(path: Path) -> Content:
    """Read the elements ``vertex``, and ``face`` or ``tristrips``; all else is passed over.

    Text keeps the precision it is written with.

    Raises:
        UserError: not PLY, or cut off.
        KeyError, ValueError: a header that makes no sense.
    """
    data = path.read_bytes().removeprefix(b"\xef\xbb\xbf")
    if not data.strip():
        raise UserError("is empty; export it again")
    if not data.startswith(b"ply"):
        raise UserError("is not PLY and cannot be read; export it again")
    end = _END.search(data.replace(b"\r", b"\n") if b"\n" not in data[:512] else data)  # old line ends
    if end is None:
        raise UserError("is cut off within its header; export or copy it again")
    form, elements = _header(data[: end.start()].decode("latin-1"))
    body = data[end.end() :]
    if form == "ascii":
        body, elements = _as_binary(body, elements)
    tables, at = dict[str, dict[str, _Column]](), 0
    for element in elements:
        tables[element.name], at = _rows(body, at, element, _ORDERS[form])
        filled = {known.name for known in elements if known.rows and known.name in tables}
        if "vertex" in filled and filled & {"face", "tristrips"}:
            break
    if "vertex" not in tables:
        raise ValueError("it has no vertices")
    vertices = np.stack([tables["vertex"][axis][0] for axis in "xyz"], axis=1).astype(np.float64)
    corners, counts = _corners(tables.get("face", {}))
    strips = _unrolled(*_corners(tables.get("tristrips", {})))
    corners, counts = np.append(corners, strips), np.append(counts, np.full(len(strips), 3))
    return Content([Piece(path.name, vertices, triangulated(vertices, corners, counts))])


def _corners(polygons: dict[str, _Column]) -> _Column:
    """Numbers of vertices of all polygons or strips, and how many each has."""
    none = np.zeros(0, np.int64), np.zeros(0, np.int64)
    corners, counts = polygons.get("vertex_indices", polygons.get("vertex_index", none))
    return corners.astype(np.int64), counts


def _unrolled(corners: np.ndarray, counts: np.ndarray) -> np.ndarray:
    """Triangles ``[F, 3]`` of strips, which end with their row or at -1; every second one is wound the other way."""
    corners = np.insert(corners, np.cumsum(counts), -1)
    at = np.arange(max(len(corners) - 2, 0))
    begins = np.maximum.accumulate(np.where(corners == -1, np.arange(1, len(corners) + 1), 0))[: len(at)]
    odd = (at - begins) % 2
    triangles = np.stack([corners[at], corners[at + 1 + odd], corners[at + 2 - odd]], axis=1)
    return triangles[(triangles != -1).all(axis=1)]


def _header(text: str) -> tuple[str, list[_Element]]:
    """Form of the data, and the elements in their order."""
    form, elements = "", list[_Element]()
    for line in text.splitlines()[1:]:
        match line.split():
            case ["format", word, *_]:
                form = word
            case ["element", name, rows]:
                elements.append(_Element(name, int(rows), []))
            case ["property", "list", count, kind, name]:
                elements[-1].properties.append(_Property(name, _TYPES[kind], _TYPES[count]))
            case ["property", kind, name]:
                elements[-1].properties.append(_Property(name, _TYPES[kind]))
    if form not in _ORDERS:
        raise ValueError(f"its format is '{form}'")
    return form, elements


def _as_binary(body: bytes, elements: list[_Element]) -> tuple[bytes, list[_Element]]:
    """Text as doubles in a row."""
    numbers = np.array(list(map(float, body.split())), dtype="<f8")
    doubles = [
        _Element(e.name, e.rows, [_Property(p.name, "f8", "f8" if p.count else "") for p in e.properties])
        for e in elements
    ]
    return numbers.tobytes(), doubles


def _rows(data: bytes, at: int, element: _Element, order: str) -> tuple[dict[str, _Column], int]:
    """Columns of an element's rows, and where the next element begins."""
    if not element.properties:
        return {}, at
    try:
        lengths = _lengths(data, at, element, order)
        fields = []
        for p in element.properties:
            fields += [(f"{p.name} count", order + p.count, 1)] if p.count else []
            fields += [(p.name, order + p.kind, lengths[p.name])]
        rows = np.frombuffer(data, np.dtype(fields), element.rows, at)
    except (struct.error, ValueError):  # too few bytes for rows as long as the first
        return _uneven(data, at, element, order)
    if any((rows[f"{p.name} count"] != lengths[p.name]).any() for p in element.properties if p.count):
        return _uneven(data, at, element, order)
    counts = {p.name: np.full(element.rows, lengths[p.name]) for p in element.properties}
    return {p.name: (rows[p.name].reshape(-1), counts[p.name]) for p in element.properties}, at + rows.nbytes


def _lengths(data: bytes, at: int, element: _Element, order: str) -> dict[str, int]:
    """Numbers of each property in the first row."""
    lengths = {}
    for p in element.properties:
        lengths[p.name] = 1
        if p.count and element.rows:
            lengths[p.name] = int(struct.unpack_from(order + _CODES[p.count], data, at)[0])
            at += int(p.count[1])
        at += lengths[p.name] * int(p.kind[1])
    return lengths


def _uneven(data: bytes, at: int, element: _Element, order: str) -> tuple[dict[str, _Column], int]:
    """`_rows` of lists that differ in length, row by row."""
    plan = [
        (struct.Struct(order + _CODES[p.count]) if p.count else None, int(p.kind[1]), list[bytes](), list[int]())
        for p in element.properties
    ]
    for row in range(element.rows):
        for length, size, values, counts in plan:
            count = 1
            if length is not None and at + length.size <= len(data):
                count = int(length.unpack_from(data, at)[0])
                at += length.size
            end = at + count * size
            if count < 0:
                raise ValueError(f"a list of {count} numbers")
            if end > len(data):
                raise UserError(
                    f"is cut off: it holds {row} of {element.rows} rows of '{element.name}'; export or copy it again"
                )
            values.append(data[at:end])
            counts.append(count)
            at = end
    columns = {
        p.name: (np.frombuffer(b"".join(values), order + p.kind), np.array(counts, dtype=np.int64))
        for p, (_, _, values, counts) in zip(element.properties, plan, strict=True)
    }
    return columns, at
