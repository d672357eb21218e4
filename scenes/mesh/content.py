"""What a mesh file holds, as every reader of a format hands it over: named triangles in the file's unit and axes."""

from __future__ import annotations

import struct
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from scenes.errors import UserError, clipped
from scenes.motion.frames import transform


@dataclass(frozen=True, eq=False)
class Piece:
    """One object of a file, placed.

    Attributes:
        name: as the file calls it.
        vertices: ``[V, 3]`` float64, in the file's unit and axes.
        faces: ``[F, 3]`` int64; the front side sees them counter-clockwise.
    """

    name: str
    vertices: np.ndarray
    faces: np.ndarray


@dataclass(frozen=True, eq=False)
class Content:
    """All objects of a file, and what whoever gave it should hear, one sentence each."""

    pieces: list[Piece]
    doubts: tuple[str, ...] = ()


@contextmanager
def told(file: str, kind: str) -> Iterator[None]:
    """Turn what a reader raises into one UserError sentence.

    Args:
        file: subject of the sentence, such as "mesh file 'a.obj'"; UserErrors of readers carry on from it.
        kind: name of the format.
    """
    try:
        with np.errstate(all="ignore"):  # what is not finite is told where meshes are made
            yield
    except UserError as error:
        raise UserError(f"{file} {error}") from error
    except ImportError as error:
        raise UserError(f"{file} needs the package '{error.name}' to be read; install scenectl again") from error
    except OSError as error:
        raise UserError(f"{file} cannot be read ({error.strerror or error})") from error
    except (ArithmeticError, AttributeError, LookupError, MemoryError, TypeError, ValueError, struct.error) as error:
        what = (str(error) if isinstance(error, ValueError) else f"{type(error).__name__}: {error}").partition("\n")[0]
        raise UserError(
            f"{file} is not well-formed {kind} and cannot be read ({clipped(what)}); export it again"
        ) from error


def text_of(path: Path) -> bytes:
    """A text file without its byte order mark; raises UserError for what is no such text."""
    data = path.read_bytes()
    if not data.strip():
        raise UserError("is empty; export it again")
    if b"\0" in data:  # binary data, or UTF-16
        raise UserError("is not UTF-8 text; export it as such")
    return data.removeprefix(b"\xef\xbb\xbf")


def joined(pieces: Sequence[tuple[np.ndarray, np.ndarray]]) -> tuple[np.ndarray, np.ndarray]:
    """Vertices ``[V, 3]`` and faces ``[F, 3]`` of several pieces, at least one, as those of one; nothing is merged."""
    starts = np.cumsum([0] + [len(vertices) for vertices, _ in pieces])
    faces = np.concatenate([faces + start for (_, faces), start in zip(pieces, starts, strict=False)])
    return np.concatenate([vertices for vertices, _ in pieces]), faces


def used(vertices: np.ndarray, faces: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The vertices that triangles use, and the triangles between these."""
    which, inverse = np.unique(faces, return_inverse=True)
    return vertices[which], inverse.reshape(-1, 3)


def placed(frame: np.ndarray, vertices: np.ndarray, faces: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Vertices and faces carried by a transform ``[4, 4]``; mirrored ones are wound the other way."""
    if np.array_equal(frame, np.eye(4)):
        return vertices, faces  # to the sign of every zero
    return transform(frame, vertices), faces if np.linalg.det(frame[:3, :3]) >= 0 else faces[:, ::-1]


def distinct(names: Iterable[str]) -> list[str]:
    """The same names, those used before with a number."""
    taken: dict[str, int] = {}
    result = []
    for name in names:
        unique = name
        while unique in taken:
            taken[name] += 1
            unique = f"{name} {taken[name]}"
        taken[unique] = 1
        result.append(unique)
    return result
