"""Wavefront OBJ files: vertices, polygons and ``o`` lines, in the order in which they stand."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np

from scenes.errors import UserError
from scenes.mesh.content import Content, Piece, text_of, used
from scenes.mesh.polygons import triangulated


def read_obj(path: Path) -> Content:
    """Read ``v``, ``f`` and ``o`` lines; materials, texture coordinates, normals, lines and curves are passed over.

    Words are parted by any blanks, and a backslash carries a line on. Negative indices count back from the last vertex
    above their line. Every ``o`` line begins a piece; what stands before the first is one of the file's name.

    Raises:
        UserError: a line that cannot be read, an index that names no vertex.
    """
    lines = text_of(path).replace(b"\\\r\n", b" ").replace(b"\\\n", b" ").splitlines()
    points, corners = list[bytes](), list[bytes]()
    counts, above = list[int](), list[int]()
    begins, names, bare = [0], [path.name], 0
    for line in lines:
        words = (line if b"#" not in line else line[: line.index(b"#")]).split()
        match words[0] if words else b"":
            case b"v":
                points += words[1:4] if len(words) > 3 else [b"too few"]
            case b"f":
                corners += words[1:]
                counts.append(len(words) - 1)
                above.append(len(points) // 3)
            case b"o":
                begins.append(len(counts))
                names.append(b" ".join(words[1:]).decode("utf-8", "replace") or path.name)
            case b"l" | b"p" | b"curv" | b"curv2" | b"surf":
                bare += 1
    try:
        vertices = np.array(list(map(float, points))).reshape(-1, 3)
        indices = np.array([int(word.partition(b"/")[0]) for word in corners], dtype=np.int64)
    except ValueError:
        raise _unread(lines) from None
    if min(counts, default=3) < 3:
        raise _unread(lines)
    indices += np.where(indices < 0, np.repeat(np.array(above, dtype=np.int64), counts), -1)
    if len(indices) and (indices.min() < 0 or indices.max() >= len(vertices)):
        raise UserError(
            f"has faces that name vertices beyond its {len(vertices)}: it is cut off or damaged; export it again"
        )
    doubts = () if bare or not len(indices) else _missing_end(path, len(vertices), int(indices.max()) + 1)
    return Content(_pieces(vertices, indices, np.array(counts, dtype=np.int64), begins, names), doubts)


def _pieces(
    vertices: np.ndarray, corners: np.ndarray, counts: np.ndarray, begins: list[int], names: list[str]
) -> list[Piece]:
    pieces = []
    ends = np.concatenate([[0], np.cumsum(counts)])
    for name, first, end in zip(names, begins, [*begins[1:], len(counts)], strict=True):
        faces = triangulated(vertices, corners[ends[first] : ends[end]], counts[first:end])
        if len(faces):
            alone = end - first == len(counts)
            pieces.append(Piece(name, *((vertices, faces) if alone else used(vertices, faces))))
    return pieces


def _missing_end(path: Path, vertices: int, reached: int) -> tuple[str, ...]:
    """Writers put vertices first: where the last of them belong to no face, faces may be missing."""
    if reached == vertices:
        return ()
    return (
        f"no face of '{path.name}' uses the last {vertices - reached} of its {vertices} vertices: "
        "it may be cut off; compare it with the original",
    )


def _unread(lines: list[bytes]) -> UserError:
    """The first line whose numbers are not numbers or too few."""
    kinds: dict[bytes, Callable[[bytes], object]] = {b"v": float, b"f": lambda word: int(word.partition(b"/")[0])}
    last = max(number for number, line in enumerate(lines, 1) if line.strip())
    for number, line in enumerate(lines, 1):
        words = line.partition(b"#")[0].split()
        if not words or words[0] not in kinds:
            continue
        try:
            numbers = [kinds[words[0]](word) for word in (words[1:4] if words[0] == b"v" else words[1:])]
        except ValueError:
            numbers = []
        if len(numbers) < 3:
            what = "is cut off" if number == last else "cannot be read"
            text = line.strip()[:40].decode("utf-8", "replace")
            return UserError(f"{what}: line {number} is '{text}'; export it again")
    return UserError("cannot be read; export it again")
