"""What closed pieces of a mesh are taken for: solids, hollows in them, or rooms; and the boundary of all matter.

A file's windings are evidence and no more. A closed piece that lies in the air is a solid, whichever way it faces; one
in matter is a hollow where it faces inward, and else part of what surrounds it. Between matter and matter there is no
surface.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from scenes.kernels import weld
from scenes.mesh.pieces import Pieces
from scenes.mesh.surface import Faults, Surface
from scenes.mesh.union import Triangles, carved, manifold, united


@dataclass(frozen=True, eq=False)
class Roles:
    """What closed pieces are, ``[P]`` each; False for the open ones.

    Attributes:
        matter: matter is just inside them, else air.
        turned: they face the other way than such a boundary does.
        inside_out: solids in the air that faced inward.
        void: they hold what is air for certain, and bound nothing.
    """

    matter: np.ndarray
    turned: np.ndarray
    inside_out: np.ndarray
    void: np.ndarray

    @classmethod
    def of(cls, pieces: Pieces, in_matter: Callable[[int], bool], around: Sequence[int] = ()) -> Roles:
        """The roles of closed pieces.

        Args:
            pieces: of a surface.
            in_matter: whether an outermost piece is surrounded by matter, and not by air.
            around: pieces that hold what is air for certain, the smallest first: that one is a room, the others void.
        """
        matter, turned, inside_out, void = np.zeros((4, len(pieces.closed)), dtype=bool)
        for i, holders in pieces.holders.items():  # those that hold others come first
            outside = matter[holders[0]] if holders else in_matter(i)
            against = bool(holders) and bool(
                turned[holders[0]]
            )  # what lies in a piece that is turned is turned with it
            inward = bool(pieces.volume[i] < 0) != against
            matter[i] = i not in around[:1] and (not outside or not inward)
            turned[i] = (pieces.volume[i] < 0) == matter[i]
            inside_out[i] = not outside and inward and pieces.volume[i] < 0
        void[list(around[1:])] = True
        return cls(matter, turned, inside_out, void)


@dataclass(frozen=True, eq=False)
class Boundary:
    """The surface between air and matter.

    Attributes:
        surface: all of it.
        solids: its closed pieces, turned; None without any.
        sheets: its open ones, as they are.
    """

    surface: Surface
    solids: Surface | None
    sheets: Surface | None

    @classmethod
    def of(cls, pieces: Pieces, roles: Roles, sheets: Surface | None) -> Boundary:
        """Put together what is left of the pieces: those that bound nothing go, those that overlap become one.

        `sheets` are the open ones, turned or not.
        """
        whole = pieces.surface
        kept = [int(i) for i in pieces.holders if not roles.void[i]]
        faces = {i: pieces.triangles(i)[:, :: -1 if roles.turned[i] else 1] for i in kept}
        plain = len(kept) == pieces.closed.sum() and not roles.turned[kept].any()
        new = _merged(pieces, roles, faces)
        if plain and new is None:
            return cls(whole, pieces.part(pieces.closed), sheets) if sheets else cls(whole, whole, None)
        solids = _put_together(whole, list(faces.values()), []) if new is None else _put_together(whole, *new)
        if sheets is None:
            return cls(solids, solids, None) if solids else cls(whole, None, None)
        if solids is None:
            return cls(sheets, None, sheets)
        sheets = Surface(solids.vertices, sheets.faces, sheets.slivers, whole.centre, sheets.faults)
        both = (np.concatenate([sheets.faces, solids.faces]), np.concatenate([sheets.slivers, solids.slivers]))
        return cls(Surface(solids.vertices, *both, whole.centre, sheets.faults), solids, sheets)


def _merged(
    pieces: Pieces, roles: Roles, faces: dict[int, np.ndarray]
) -> tuple[list[np.ndarray], list[Triangles]] | None:
    """What stays of the closed pieces, and what takes the place of the others; None where all stay."""
    vertices = pieces.surface.vertices
    hollows: dict[int, list[np.ndarray]] = {}
    rooms = []
    for i in (i for i in faces if not roles.matter[i]):
        holder = next((j for j in pieces.holders[i] if j in faces and roles.matter[j]), None)
        if holder is None:
            rooms.append(i)
        else:
            hollows.setdefault(holder, []).append(faces[i])
    solids = [np.concatenate([faces[i], *hollows.get(i, [])]) for i in faces if roles.matter[i]]
    kept, unions = united(vertices, solids)
    shells = [faces[i] for i in rooms]
    known = {n: solid for n, own in enumerate(kept) if rooms and (solid := manifold(vertices, own)) is not None}
    merged = [solid for own in unions if rooms and (solid := manifold(*own)) is not None]
    airs = carved(vertices, [own[:, ::-1] for own in shells], [*known.values(), *merged])
    if airs:  # they end where solids begin; matter in matter bounds nothing
        return [own for n, own in enumerate(kept) if n not in known], [(points, own[:, ::-1]) for points, own in airs]
    return (kept + shells, unions) if unions else None


def _put_together(whole: Surface, kept: list[np.ndarray], new: list[Triangles]) -> Surface | None:
    """Closed triangles between vertices of a surface, and others with vertices of their own, as one closed surface."""
    if not kept and not new:
        return None
    starts = np.cumsum([len(whole.vertices)] + [len(points) for points, _ in new])
    vertices = np.concatenate([whole.vertices, *(points for points, _ in new)])
    faces = [own + start for (_, own), start in zip(new, starts, strict=False)]
    every = np.concatenate([*kept, *faces]).astype(np.int32)
    flat = weld.slivers(vertices, every)
    none = Faults.of(every[:0], len(vertices))
    return Surface(vertices, every[~flat], every[flat], whole.centre, none)
