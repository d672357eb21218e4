"""Which space is free: an explicit rule on winding numbers, reported and open to overruling.

Jacobson et al., "Robust inside-outside segmentation using generalized winding numbers", 2013. Closed pieces of a mesh
and open ones are asked apart: about the former winding numbers are whole numbers, and what sheets add near their edges
cannot change what a solid encloses. Before that, closed pieces are turned to face as what they are taken for, and
solids that overlap or touch become one (`scenes.sdf.solids`).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TypeAlias

import numpy as np

from scenes.errors import UserError
from scenes.mesh.alignment import aligned
from scenes.mesh.pieces import MANY, Pieces
from scenes.mesh.surface import Surface
from scenes.sdf.evidence import STANDING, fits, in_front, room_inside
from scenes.sdf.settings import FreeSpace
from scenes.sdf.solids import Boundary, Roles

Range: TypeAlias = tuple[float, float]
"""Least and greatest winding number of what is free."""

OUT: Range = (-math.inf, 0.5)
"""Not within a solid. Loose sheets have |w| up to 1 on the side they face; only what they enclose from behind is."""
OUT_OF_SCAN: Range = (-0.5, 0.5)
"""Not within a nearly closed piece, which is solid whichever way it faces."""
IN: Range = (-math.inf, -0.5)
"""Within a room."""
IN_CUT_AWAY: Range = (-math.inf, -0.02)
"""Within or before a room that is cut open: w is -1/2 and less in front of what is left, and falls off to 0 beyond the
opening; behind what is left it is 0 and more."""
AIR = -0.25
"""Winding number about open pieces below which a place is in their room, and not before an opening."""

SHEET, NEARLY = -0.75, -0.5
"""Winding number in front of open pieces below which they are a room, and of nearly closed ones. In front of a room's
walls w is -1, of an object's 0; a sheet alone gives -1/2, a floor with two walls about -0.7: only what is enclosed for
the most part counts as a room."""


WARDROBE = 2.0
"""Square metres up to which what one could stand in is taken for furniture."""

GROUND = 0.5
"""Metres from a room's floor within which open ground is level with it."""

SEVERAL = 0.1
"""Share of a mesh's area from which on closed rooms beside an open one count."""


@dataclass(frozen=True)
class Rule:
    """Which space is free, in terms of winding numbers.

    Attributes:
        name: "outside", "inside" (of an inward-facing room) or "seed".
        solids: winding numbers about the closed pieces that are free.
        sheets: those about the open ones.
        message: one sentence saying what was decided and why.
        inward: the mesh's front sides face the inside of a room.
        doubts: evidence against it, one sentence each.
    """

    name: str
    solids: Range
    sheets: Range
    message: str
    inward: bool = False
    doubts: tuple[str, ...] = ()


@dataclass(frozen=True, eq=False)
class Sides:
    """A surface, and which sides of it are free.

    Attributes:
        surface: all triangles that distances are measured to.
        solids: of these the closed pieces; None without any.
        sheets: and the open ones.
        rule: what is free.
        seed: a point that is certainly free, world metres; None where none is stated.
    """

    surface: Surface
    solids: Surface | None
    sheets: Surface | None
    rule: Rule
    seed: np.ndarray | None = None

    @property
    def beyond(self) -> float:
        """Sign of the distance far away from the mesh: where winding numbers are 0, and before what is cut open."""
        if self.cut_away:
            return 1.0
        pairs = ((self.solids, self.rule.solids), (self.sheets, self.rule.sheets))
        return 1.0 if all(part is None or _between(np.zeros(1), free).all() for part, free in pairs) else -1.0

    @property
    def cut_away(self) -> bool:
        """The sheets are a room that is cut open."""
        return self.sheets is not None and self.rule.sheets == IN_CUT_AWAY

    def out_of_solids(self, points: np.ndarray) -> np.ndarray:
        """True at those of ``[n, 3]`` world points (m) that the closed pieces leave free: exactly."""
        if self.solids is None:
            return np.ones(len(points), dtype=bool)
        winding = self.solids.winding_fast(points)  # within about 0.01; wherever that matters the exact one decides
        doubtful = np.flatnonzero(np.abs(np.abs(winding) % 1 - 0.5) < 0.02)
        winding[doubtful] = self.solids.winding(points[doubtful])
        return _between(winding, self.rule.solids)

    def before_sheets(self, winding: np.ndarray) -> np.ndarray:
        """True where winding numbers about the open pieces are free."""
        return _between(winding, self.rule.sheets)

    def margin(self, winding: np.ndarray) -> np.ndarray:
        """How far winding numbers about the open pieces lie from where the answer changes."""
        low, high = self.rule.sheets
        return np.asarray(np.minimum(np.abs(winding - low), np.abs(winding - high)))

    def by_winding(self, points: np.ndarray, threads: int | None = None) -> np.ndarray:
        """True at those of ``[n, 3]`` world points (m) that are free by their winding numbers alone, within 0.01."""
        free = np.ones(len(points), dtype=bool)
        for part, between in ((self.solids, self.rule.solids), (self.sheets, self.rule.sheets)):
            if part is not None:
                free &= _between(part.dipoles.at(points - part.centre, threads), between)
        return free


def _between(winding: np.ndarray, free: Range) -> np.ndarray:
    result: np.ndarray = (winding >= free[0]) & (winding <= free[1])
    return result


def decide(surface: Surface, free_space: FreeSpace, bounds: np.ndarray, name: str) -> Sides:
    """The sides of a surface.

    Args:
        surface: the cleaned mesh.
        free_space: as `bake` takes it.
        bounds: padded bounds ``[2, 3]`` (m) that a seed point must lie in.
        name: of the mesh, for messages.

    Raises:
        UserError: a seed point outside `bounds` or within 1 mm of a surface.
    """
    found = _Found(surface, name)
    if free_space == "outside":
        return found.outside("free space is outside, as stated", stated=True)
    if not isinstance(free_space, str):
        _check_seed(surface, free_space, bounds, name)
        return found.around(np.array(free_space, dtype=np.float64))
    if found.open_room or found.fits:
        return found.outdoors() if found.on_ground else found.inside()
    room = room_inside(surface)
    if room.certain or (room.likely and found.holds_inward):
        doubt = (
            f"mesh '{name}' faces outward as a solid does, but {room.standing:.3g} m² of standing room and furniture"
            ' lie inside: it is taken for a room turned inside out; if it is a solid, state free_space = "outside"'
        )
        return _Found(surface.reversed(), name).inside((doubt,))
    doubts: tuple[str, ...] = ()
    if room.likely:
        doubts = (
            f"mesh '{name}' faces outward and is taken for a solid, but {room.standing:.3g} m² of standing room lie"
            " inside; if it is a room, state free_space as a point [x, y, z] in its air",
        )
    why = "it does not face inward" if found.rooms <= 0 else "nobody fits into what it faces"
    return found.outside(f"{why}, so free space is outside", doubts=doubts)


@dataclass(frozen=True, eq=False)
class _Found:
    """A surface and what is known of its pieces before anything is decided."""

    surface: Surface
    name: str

    @cached_property
    def pieces(self) -> Pieces:
        return Pieces.of(self.surface)

    @cached_property
    def sheets(self) -> Surface | None:
        part = self.pieces.part(~self.pieces.closed)
        return None if part is None else aligned(part)

    @cached_property
    def outermost(self) -> np.ndarray:
        """Closed pieces that lie in no other and not in the air of an open room, ``[n]``."""
        free = (piece for piece, holders in self.pieces.holders.items() if not holders)
        return np.array([piece for piece in free if not self._in_air(piece)], dtype=int)

    @cached_property
    def rooms(self) -> float:
        """Area (m²) of closed pieces that face inward where they could be rooms, less that of others beside them."""
        own = self.outermost
        return float((self.pieces.area * -np.sign(self.pieces.volume))[own].sum())

    @cached_property
    def open_room(self) -> bool:
        """The open pieces face into a room that they enclose for the most part."""
        return self.sheets is not None and in_front(self.sheets) < (NEARLY if self.sheets.nearly_closed else SHEET)

    @property
    def fits(self) -> bool:
        """Closed pieces face inward for the most part, and a person fits into what they enclose."""
        if self.rooms <= 0:
            return False
        closed = self.surface if self.sheets is None else self.pieces.part(self.pieces.closed)
        return closed is not None and fits(closed)

    @property
    def holds_inward(self) -> bool:
        """Closed pieces that face inward lie in outermost ones that face outward, as when all of a room is turned."""
        volume, outermost = self.pieces.volume, set(self.outermost.tolist())
        return any(
            volume[piece] < 0 and len(holders) == 1 and holders[0] in outermost and volume[holders[0]] > 0
            for piece, holders in self.pieces.holders.items()
        )

    @property
    def on_ground(self) -> bool:
        """Closed rooms stand on open ground: more of it than of them lies level with their floors."""
        if self.sheets is None or self.open_room:
            return False
        floor = float(self.pieces.boxes[self.closed_rooms, 0, 1].min())
        a, b, c = np.moveaxis(self.sheets.vertices[self.sheets.faces], 1, 0)
        up = np.abs(np.cross(b - a, c - a)[:, 1]) / 2
        level = np.abs((a + b + c)[:, 1] / 3 - floor) < GROUND
        return float(up[level].sum()) > float(self.pieces.area[self.closed_rooms].sum())

    @cached_property
    def closed_rooms(self) -> list[int]:
        """The largest of the outermost pieces that face inward, and those that one could stand in."""
        inward = [int(piece) for piece in self.outermost if self.pieces.volume[piece] < 0]
        inward.sort(key=lambda piece: -self.pieces.area[piece])
        return inward[:1] + [piece for piece in inward[1:] if self._could_stand_in(piece)]

    def _could_stand_in(self, piece: int) -> bool:
        across, up, along = np.ptp(self.pieces.boxes[piece], axis=0)
        return bool(up >= STANDING and across * along >= WARDROBE)

    def _in_air(self, piece: int, rooms: Sequence[int] = ()) -> bool:
        """A closed piece lies in the open room or in closed ones; what is no room itself may stick out of them."""
        others = [room for room in rooms if room != piece]
        if self._could_stand_in(piece):
            return bool(self._air(self.pieces.spread(piece), others).all())
        if self._air(self.pieces.probes[piece], others).any():  # tells it of nearly all, and costs little
            return True
        return len(self.pieces.holders) <= MANY and bool(self._air(self.pieces.spread(piece), others).any())

    def _air(self, points: np.ndarray, rooms: Sequence[int]) -> np.ndarray:
        """Which points ``[n, 3]`` lie in the open room or in some closed ones."""
        within = np.zeros(len(points), dtype=bool)
        if self.sheets is not None and self.open_room:
            within |= self.sheets.dipoles.at(points) < AIR
        for room in rooms:
            within |= self.pieces.hold(room, points)
        return within

    @property
    def _about(self) -> str:
        kind, edges = self.surface.kind, self.surface.boundary_edges
        return f"mesh '{self.name}' ({kind if edges == 0 else f'{kind}, {edges} boundary edges'})"

    # ------------------------------------------------------------------------------------------------------- decisions

    def outside(self, why: str, stated: bool = False, doubts: tuple[str, ...] = ()) -> Sides:
        """What the mesh encloses is solid, whichever way it faces."""
        roles = Roles.of(self.pieces, lambda piece: False)
        rule = Rule("outside", OUT, self._loose, f"{self._about}: {why}", doubts=doubts)
        return self._sides(rule, roles, stated)

    def outdoors(self) -> Sides:
        """Rooms without thickness on open ground: their air is free, and all around them."""
        rooms = np.isin(np.arange(len(self.pieces.closed)), self.closed_rooms)
        found = _Found(self.surface, self.name)
        found.__dict__["pieces"] = replace(self.pieces, closed=self.pieces.closed & ~rooms)
        rule = Rule("outside", OUT, OUT, f"{self._about} faces into rooms on open ground, so both are free")
        return found._sides(rule, Roles.of(found.pieces, lambda piece: False))

    def inside(self, doubts: tuple[str, ...] = ()) -> Sides:
        """The air of the rooms that face inward is free, and all else solid."""
        message = f"{self._about} faces inward, so the space it encloses is free and all else solid"
        if not self.open_room:
            rule = Rule("inside", IN, self._loose, message, True, doubts + self._beside_rooms())
            return self._sides(rule, Roles.of(self.pieces, lambda piece: not self._in_air(piece, self.closed_rooms)))
        rule = Rule("inside", OUT, self._within_sheets, message, True, doubts)
        if self.rooms > SEVERAL * float(self.pieces.area.sum()):  # closed rooms beside an open one: asked together
            return Sides(self.surface, None, self.surface, rule)
        return self._sides(rule, Roles.of(self.pieces, lambda piece: not self._in_air(piece)))

    def around(self, seed: np.ndarray) -> Sides:
        """Space that is enclosed as a point is."""
        winding = float(self.surface.winding(seed[None])[0])
        at = ", ".join(f"{x:g}" for x in seed)
        message = f"{self._about}: free space is that of the seed ({at}), where the winding number is {winding:.2f}"
        sheets, in_open_room = self._loose, False
        if self.sheets is not None:
            about = float(self.sheets.winding(seed[None])[0])
            in_open_room = about < (AIR if self.open_room else IN[1])
            beyond = (round(about) - 0.5, round(about) + 0.5)
            sheets = self._within_sheets if in_open_room else beyond if about > 0.5 else self._loose
        rule = Rule("seed", OUT, sheets, message, in_open_room)
        sides = self._sides(rule, Roles.of(self.pieces, lambda piece: in_open_room and not self._in_air(piece)))
        if not sides.out_of_solids(seed[None])[0]:  # it lies in what would be a solid: that is the room
            holding = self.pieces.around(seed - self.surface.centre)
            roles = Roles.of(self.pieces, lambda piece: not self._in_air(piece, holding[:1]), holding)
            sides = self._sides(replace(rule, solids=IN, inward=True), roles)
        return replace(sides, seed=seed)

    @property
    def _loose(self) -> Range:
        """What is free about open pieces that are no room."""
        return OUT_OF_SCAN if self.sheets is not None and self.sheets.nearly_closed else OUT

    @property
    def _within_sheets(self) -> Range:
        """What is free about open pieces that are a room."""
        return IN if self.sheets is not None and self.sheets.nearly_closed else IN_CUT_AWAY

    def _sides(self, rule: Rule, roles: Roles, stated: bool = False) -> Sides:
        boundary = Boundary.of(self.pieces, roles, self.sheets)
        doubts = rule.doubts
        if turned := self.surface.turned + (0 if self.sheets is None else self.sheets.turned):
            doubts += (
                f"mesh '{self.name}' has {turned} of {len(self.surface.faces)} triangles that face against"
                " their neighbours and are taken to face as these do; make its normals consistent if that looks wrong",
            )
        if roles.inside_out.any() and not stated and rule.name != "seed":
            doubts += (self._inside_out(roles),)
        return Sides(boundary.surface, boundary.solids, boundary.sheets, replace(rule, doubts=doubts))

    def _beside_rooms(self) -> tuple[str, ...]:
        """A doubt about outermost pieces that could be rooms themselves, but face outward."""
        pieces = [int(piece) for piece in self.outermost if self.pieces.volume[piece] > 0]
        pieces = [i for i in pieces if self._could_stand_in(i) and not self._in_air(i, self.closed_rooms)]
        if not pieces:
            return ()
        end = "outward beside rooms that face inward", "taken for solid; if it is a room, turn its normals"
        return (self._sentence(np.array(pieces), *end),)

    def _inside_out(self, roles: Roles) -> str:
        """A doubt about closed pieces in the air that face inward."""
        end = (
            "inward in free space",
            "taken for solid; if it is a room, state free_space as a point [x, y, z] in its air",
        )
        return self._sentence(np.flatnonzero(roles.inside_out), *end)

    def _sentence(self, pieces: np.ndarray, how: str, end: str) -> str:
        """About some closed pieces, of which the largest is named."""
        largest = self.pieces.boxes[pieces[self.pieces.area[pieces].argmax()]] + self.surface.centre
        middle = ", ".join(f"{x:.2f}" for x in largest.mean(axis=0))
        size = " x ".join(f"{x:.2f}" for x in np.ptp(largest, axis=0))
        what = "a closed piece faces" if len(pieces) == 1 else f"{len(pieces)} closed pieces face"
        return (
            f"in mesh '{self.name}' {what} {how}, {'' if len(pieces) == 1 else 'the largest '}{size} m around"
            f" ({middle}): {end}"
        )


def _check_seed(surface: Surface, seed: Sequence[float], bounds: np.ndarray, name: str) -> None:
    point = np.array([seed], dtype=np.float64)
    text = f"({seed[0]:g}, {seed[1]:g}, {seed[2]:g})"
    if (point < bounds[0]).any() or (point > bounds[1]).any():
        low, high = (np.array2string(corner, precision=2, separator=", ") for corner in bounds)
        raise UserError(
            f"free-space seed {text} lies outside mesh '{name}', whose padded bounds run from {low} to {high} m;"
            " give a point in the air"
        )
    if surface.unsigned_distance(point)[0] < 1e-3:
        raise UserError(f"free-space seed {text} lies on a surface of mesh '{name}'; give a point in the air")
