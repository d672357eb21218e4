"""The bundled scenes, as the script that makes them: ``python scenes/bundled/make.py [FOLDER]``.

Every object is a closed solid with outward normals and a node of its own, in metres, y up, the top of the floor
at y = 0. Objects stand 5 mm deep in the floor, so that no faces coincide. There is no ceiling, and the walls
towards +x and +z are low, so that a picture taken from there looks in. The same versions of the libraries write
the same bytes every time.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from manifold3d import Manifold, OpType

from scenes.files import atomic_write
from scenes.mesh.glb import Item, glb

BUNDLED = Path(__file__).parent
"""Where the scenes of this package live."""

Point = tuple[float, float, float]

_SINK = 0.005  # how deep furniture stands in the floor, metres
_WALL, _HIGH, _LOW = 0.12, 2.5, 0.9  # wall thickness and the two heights, metres

# Colours, sRGB.
_PLASTER, _OAK, _WALNUT, _LINEN = (233, 229, 220), (205, 176, 136), (139, 100, 66), (222, 214, 199)
_TEAL, _OCHRE, _SLATE, _BRASS = (84, 122, 129), (204, 154, 74), (66, 72, 80), (178, 146, 86)
_LEAF, _CLAY, _BRICK, _STONE, _PAPER = (92, 128, 84), (184, 112, 82), (176, 92, 74), (170, 168, 162), (247, 244, 236)


@dataclass(frozen=True)
class Plan:
    """A scene to be written: its objects, and what people should know about it.

    `start` is (x, z, heading in rad); `targets` are free floor positions (x, z) and `reach` are points (x, y, z)
    for a hand, all in metres.
    """

    name: str
    notes: str
    items: tuple[Item, ...]
    start: tuple[float, float, float]
    targets: dict[str, tuple[float, float]]
    reach: dict[str, Point] = field(default_factory=dict)


def box(x: tuple[float, float], y: tuple[float, float], z: tuple[float, float]) -> Any:
    """Box between two coordinates (m) along each axis."""
    size = (x[1] - x[0], y[1] - y[0], z[1] - z[0])
    return Manifold.cube(size).translate((x[0], y[0], z[0]))


def cushion(x: tuple[float, float], y: tuple[float, float], z: tuple[float, float], round_by: float = 0.05) -> Any:
    """Box with rounded edges: the hull of eight spheres in its corners."""
    ball = Manifold.sphere(round_by, 12)
    inner = [(low + round_by, high - round_by) for low, high in (x, y, z)]
    return Manifold.batch_hull([ball.translate((a, b, c)) for a in inner[0] for b in inner[1] for c in inner[2]])


def column(x: float, z: float, y: tuple[float, float], radius: float, top: float | None = None, sides: int = 32) -> Any:
    """Upright cylinder or, with another radius at the `top`, cone (m)."""
    along_z = Manifold.cylinder(y[1] - y[0], radius, radius if top is None else top, sides)
    return along_z.rotate((-90.0, 0.0, 0.0)).translate((x, y[0], z))


def join(*parts: Any) -> Any:
    """Union of solids."""
    return Manifold.batch_boolean(list(parts), OpType.Add)


def _floor(x: tuple[float, float], z: tuple[float, float]) -> Item:
    out = _WALL + 0.02  # the slab shows a little outside the walls
    return Item("floor", box((x[0] - out, x[1] + out), (-0.1, 0.0), (z[0] - out, z[1] + out)), _OAK)


def _walls(x: tuple[float, float], z: tuple[float, float], sides: str = "NEWS") -> list[Item]:
    """Walls around a floor: N is -z and W is -x (high), S is +z and E is +x (low)."""
    foot = -0.05
    outer_x, outer_z = (x[0] - _WALL, x[1] + _WALL), (z[0] - _WALL, z[1] + _WALL)
    parts = {
        "N": box(outer_x, (foot, _HIGH), (outer_z[0], z[0])),
        "W": box((outer_x[0], x[0]), (foot, _HIGH), (z[0] - 0.06, outer_z[1])),
        "E": box((x[1], outer_x[1]), (foot, _LOW), (z[0] - 0.06, outer_z[1])),
        "S": box((x[0] - 0.06, x[1] + 0.06), (foot, _LOW), (z[1], outer_z[1])),
    }
    return [Item("walls", join(*(parts[side] for side in sides)), _PLASTER)]


def _picture(name: str, at: Point, width: float, height: float, facing: str, colour: tuple[int, int, int]) -> Item:
    """A framed picture on a wall that looks along +x or +z."""
    x, y, z = at
    sides = (y - height / 2, y + height / 2)
    if facing == "x":
        return Item(name, box((x - 0.01, x + 0.025), sides, (z - width / 2, z + width / 2)), colour)
    return Item(name, box((x - width / 2, x + width / 2), sides, (z - 0.01, z + 0.025)), colour)


def _table(x: tuple[float, float], z: tuple[float, float], height: float, leg: float, thick: float = 0.04) -> Any:
    legs = [
        box((a, a + leg), (-_SINK, height - thick / 2), (b, b + leg))
        for a in (x[0] + 0.03, x[1] - 0.03 - leg)
        for b in (z[0] + 0.03, z[1] - 0.03 - leg)
    ]
    return join(box(x, (height - thick, height), z), *legs)


def _chair(x: float, z: float, back: int) -> Any:
    """A chair with its seat's centre at x, z; the back rest towards +z (`back` 1) or -z (-1)."""
    half, seat = 0.21, 0.45
    rest = (z + half - 0.035, z + half) if back > 0 else (z - half, z - half + 0.035)
    legs = [
        box((a, a + 0.035), (-_SINK, seat - 0.01), (b, b + 0.035))
        for a in (x - half, x + half - 0.035)
        for b in (z - half, z + half - 0.035)
    ]
    posts = [box((a, a + 0.035), (seat - 0.01, 0.8), rest) for a in (x - half, x + half - 0.035)]
    seat_board = box((x - half, x + half), (seat - 0.03, seat), (z - half, z + half))
    return join(seat_board, *legs, *posts, box((x - half, x + half), (0.66, 0.88), rest))


def _sofa(x: tuple[float, float], z: tuple[float, float]) -> Any:
    """A sofa whose back is towards +z."""
    arm = 0.2
    seats = np.linspace(x[0] + arm, x[1] - arm, 3)
    return join(
        cushion(x, (0.06, 0.32), z, 0.03),
        cushion(x, (0.1, 0.82), (z[1] - 0.22, z[1]), 0.06),
        cushion((x[0], x[0] + arm), (0.1, 0.6), z, 0.06),
        cushion((x[1] - arm, x[1]), (0.1, 0.6), z, 0.06),
        *(
            cushion((a + 0.004, b - 0.004), (0.28, 0.46), (z[0], z[1] - 0.18), 0.05)
            for a, b in zip(seats[:-1], seats[1:], strict=True)
        ),
        *(
            box((a, a + 0.06), (-_SINK, 0.1), (b, b + 0.06))
            for a in (x[0] + 0.05, x[1] - 0.11)
            for b in (z[0] + 0.05, z[1] - 0.11)
        ),
    )


def _armchair(x: tuple[float, float], z: tuple[float, float]) -> Any:
    """An armchair whose back is towards +x."""
    return join(
        cushion(x, (0.06, 0.32), z, 0.03),
        cushion((x[1] - 0.2, x[1]), (0.1, 0.8), z, 0.06),
        cushion(x, (0.1, 0.58), (z[0], z[0] + 0.15), 0.05),
        cushion(x, (0.1, 0.58), (z[1] - 0.15, z[1]), 0.05),
        cushion((x[0], x[1] - 0.15), (0.28, 0.45), (z[0] + 0.12, z[1] - 0.12), 0.05),
        *(
            box((a, a + 0.05), (-_SINK, 0.1), (b, b + 0.05))
            for a in (x[0] + 0.05, x[1] - 0.1)
            for b in (z[0] + 0.05, z[1] - 0.1)
        ),
    )


def _shelf(x: tuple[float, float], z: tuple[float, float], height: float, boards: int) -> Any:
    """An open shelf whose back is towards -z."""
    t = 0.03
    levels = np.linspace(0.06, height - t, boards)
    return join(
        box((x[0], x[0] + t), (-_SINK, height), z),
        box((x[1] - t, x[1]), (-_SINK, height), z),
        box((x[0] + t / 2, x[1] - t / 2), (0.05, height - 0.005), (z[0], z[0] + 0.015)),
        *(box((x[0] + t / 2, x[1] - t / 2), (y, y + t), (z[0] + 0.005, z[1])) for y in levels),
    )


def _books(x: tuple[float, float], bottom: float, z: tuple[float, float], heights: Sequence[float]) -> Any:
    edges = np.linspace(x[0], x[1], len(heights) + 1)
    return join(
        *(
            box((a, b + 0.001), (bottom - 0.002, bottom + h), (z[0], z[1] - 0.3 * (0.25 - h)))
            for a, b, h in zip(edges[:-1], edges[1:], heights, strict=True)
        )
    )


def _plant(x: float, z: float) -> list[Item]:
    pot = column(x, z, (-_SINK, 0.36), 0.13, 0.18, 24)
    leaves = []
    for k in range(7):  # leaves lean outwards at the golden angle, the upper ones steeper
        turn, tilt = 137.5 * k, 38.0 - 4.0 * k
        leaf = Manifold.sphere(1.0, 10).scale((0.075, 0.3, 0.075)).translate((0.0, 0.34, 0.0))
        leaves.append(leaf.rotate((tilt, 0.0, 0.0)).rotate((0.0, turn, 0.0)).translate((x, 0.36 + 0.07 * k, z)))
    return [
        Item("plant_pot", pot, _CLAY),
        Item("plant", join(column(x, z, (0.3, 1.0), 0.02, 0.012, 10), *leaves), _LEAF),
    ]


def _lamp(x: float, z: float) -> list[Item]:
    stand = join(column(x, z, (-_SINK, 0.03), 0.14, None, 24), column(x, z, (0.02, 1.45), 0.018, None, 12))
    return [Item("lamp", stand, _BRASS), Item("lamp_shade", column(x, z, (1.4, 1.68), 0.2, 0.13, 24), _PAPER)]


def living_room() -> Plan:
    """6 x 5 m: sofa, coffee table, television, shelf, dining table with chairs, plant, door opening, window."""
    x, z = (-3.0, 3.0), (-2.5, 2.5)
    (walls,) = _walls(x, z)
    door = box((-2.45, -1.5), (-0.1, 2.05), (-2.7, -2.4))  # to below the floor's top, which alone is the threshold
    window = box((-3.2, -2.9), (0.9, 2.1), (-1.5, 0.3))
    bench = join(
        box((0.0, 1.7), (0.1, 0.48), (-2.48, -2.08)),
        *(box((a, a + 0.05), (-_SINK, 0.15), (b, b + 0.05)) for a in (0.05, 1.6) for b in (-2.45, -2.16)),
    )
    television = join(box((0.25, 1.45), (0.56, 1.24), (-2.36, -2.32)), box((0.75, 0.95), (0.47, 0.6), (-2.38, -2.3)))
    shelf_x, shelf_z = (2.0, 2.95), (-2.48, -2.14)
    books = [0.21, 0.19, 0.23, 0.2, 0.22, 0.18, 0.24]
    items = [
        _floor(x, z),
        Item("walls", walls.solid - door - window, _PLASTER),
        Item("sofa", _sofa((-0.2, 1.9), (1.58, 2.48)), _TEAL),
        Item("coffee_table", _table((0.3, 1.4), (0.5, 1.05), 0.42, 0.05), _WALNUT),
        Item("armchair", _armchair((2.1, 2.9), (-0.4, 0.4)), _OCHRE),
        Item("tv_bench", bench, _WALNUT),
        Item("television", television, _SLATE),
        Item("shelf", _shelf(shelf_x, shelf_z, 1.9, 6), _WALNUT),
        Item("books_low", _books((2.06, 2.4), 0.81, (-2.45, -2.2), books), _BRICK),
        Item("books_high", _books((2.5, 2.88), 1.53, (-2.45, -2.2), books[::-1]), _TEAL),
        Item("dining_table", _table((-2.65, -1.25), (1.1, 1.92), 0.74, 0.06), _WALNUT),
        *(
            Item(f"chair_{n}", _chair(cx, cz, back), _LINEN)
            for n, (cx, cz, back) in enumerate([(-2.3, 0.98, -1), (-1.6, 0.98, -1), (-2.3, 2.1, 1), (-1.6, 2.1, 1)], 1)
        ),
        *_plant(2.55, 2.05),
        *_lamp(-0.55, 2.2),
        _picture("picture_landscape", (-0.65, 1.55, -2.5), 0.8, 0.55, "z", _OCHRE),
        _picture("picture_portrait", (-3.0, 1.55, 1.5), 0.5, 0.7, "x", _SLATE),
    ]
    return Plan(
        "living_room",
        "A furnished living room of 6 x 5 m; the door opening is in the wall at -z, the window in the wall at -x.",
        tuple(items),
        start=(-1.95, -1.9, 0.0),
        targets={"window": (-2.4, -0.6), "shelf": (2.45, -1.55), "armchair": (1.6, 0.0), "dining": (-0.8, 1.4)},
        reach={"shelf": (2.45, 1.25, -2.1), "window_sill": (-2.95, 0.95, -0.6)},
    )


def corridor() -> Plan:
    """8 x 2 m with a beam across the middle, its underside at 1.45 m."""
    x, z = (-1.0, 1.0), (-4.0, 4.0)
    beam = join(
        box((-1.06, 1.07), (1.45, 1.75), (-0.15, 0.15)),
        box((1.0, 1.13), (-0.05, 1.75), (-0.15, 0.15)),  # a post within the thickness of the low wall carries it
    )
    items = [
        _floor(x, z),
        *_walls(x, z, "WE"),
        Item("beam", beam, _WALNUT),
        *(
            _picture(f"picture_{n}", (-1.0, 1.5, at), 0.6, 0.45, "x", colour)
            for n, (at, colour) in enumerate([(-2.6, _TEAL), (-1.4, _OCHRE), (1.4, _BRICK), (2.6, _SLATE)], 1)
        ),
    ]
    return Plan(
        "corridor",
        "A corridor of 8 x 2 m, open at both ends, with an overhead beam whose underside is at 1.45 m: plan paths "
        "with height 1.4 and duck.",
        tuple(items),
        start=(0.0, -2.5, 0.0),
        targets={"far_end": (0.0, 2.5), "under_beam": (0.0, 0.0)},
    )


def pillars() -> Plan:
    """A hall of 8 x 8 m with three rows of pillars of 0.3 m radius, 1.6 m apart."""
    x = z = (-4.0, 4.0)
    middle = [(0.0, at) for at in (-2.4, -0.8, 0.8, 2.4)]
    sides = [(side, at) for side in (-2.3, 2.3) for at in (-1.6, 0.0, 1.6)]
    items = [_floor(x, z), *_walls(x, z)]
    for n, (px, pz) in enumerate(middle + sides, 1):
        shaft = join(
            column(px, pz, (-_SINK, _HIGH), 0.3),
            column(px, pz, (_HIGH - 0.2, _HIGH - 0.05), 0.3, 0.38),
            column(px, pz, (_HIGH - 0.06, _HIGH + 0.02), 0.38),
        )
        items.append(Item(f"pillar_{n}", shaft, _STONE if n > len(middle) else _BRICK))
    return Plan(
        "pillars",
        "A hall of 8 x 8 m with pillars of 0.3 m radius; the four along x = 0 stand 1.6 m apart and make a slalom.",
        tuple(items),
        start=(0.0, -3.3, 0.0),
        targets={
            "far_end": (0.0, 3.3),
            "slalom_1": (0.75, -2.4),
            "slalom_2": (-0.75, -0.8),
            "slalom_3": (0.75, 0.8),
            "slalom_4": (-0.75, 2.4),
        },
    )


def doorway() -> Plan:
    """Two rooms of 4 x 3.5 m, joined by a doorway 0.9 m wide and 2.05 m high."""
    x, z = (-2.0, 2.0), (-3.5, 3.5)
    (outer,) = _walls(x, z)
    between = box((-2.06, 2.06), (-0.05, _HIGH - 0.01), (-0.06, 0.06)) - box((-0.45, 0.45), (-0.1, 2.05), (-0.2, 0.2))
    items = [
        _floor(x, z),
        outer,
        Item("partition", between, _LINEN),
        Item("desk", _table((-1.95, -1.25), (-2.6, -1.2), 0.74, 0.05), _WALNUT),
        Item("stool", column(-1.0, -1.9, (-_SINK, 0.46), 0.17, None, 24), _OCHRE),
        Item(
            "cabinet",
            join(box((1.5, 1.97), (0.08, 1.2), (0.5, 1.7)), box((1.55, 1.9), (-_SINK, 0.1), (0.55, 1.65))),
            _TEAL,
        ),
        Item(
            "bed",
            join(
                cushion((-1.95, -1.0), (0.25, 0.52), (1.3, 3.3), 0.05),
                box((-1.97, -0.98), (0.12, 0.3), (1.28, 3.35)),
                box((-1.97, -0.98), (0.1, 0.95), (3.35, 3.42)),
                *(box((a, a + 0.06), (-_SINK, 0.15), (b, b + 0.06)) for a in (-1.95, -1.06) for b in (1.35, 3.3)),
            ),
            _LINEN,
        ),
        _picture("picture", (-2.0, 1.5, -1.9), 0.9, 0.6, "x", _BRICK),
    ]
    return Plan(
        "doorway",
        "Two rooms of 4 x 3.5 m, joined by a doorway 0.9 m wide and 2.05 m high at x = 0, z = 0.",
        tuple(items),
        start=(0.8, -2.2, 0.0),
        targets={"next_room": (0.6, 2.4), "doorway": (0.0, 0.0), "corner": (-0.3, 0.9)},
    )


def stairs() -> Plan:
    """Three steps of 0.16 m up to a platform."""
    x, z = (-2.0, 2.0), (-3.0, 3.0)
    rise, tread, width = 0.16, 0.3, 0.8
    steps = [box((-width, width), (-_SINK, rise * (k + 1)), (-tread * 3 - 0.05, -tread * k)) for k in range(3)]
    platform = box((-1.995, 1.995), (-_SINK, 3 * rise), (-2.995, -tread * 3))
    rails = [
        join(
            box((a, a + 0.05), (3 * rise - 0.01, 1.4), (-1.0, -0.95)),
            box((b, b + 0.05), (3 * rise - 0.01, 1.4), (-1.0, -0.95)),
            box((a, b + 0.05), (1.35, 1.4), (-1.0, -0.95)),
            box((a, b + 0.05), (0.92, 0.95), (-0.99, -0.96)),
        )
        for a, b in ((-1.9, -0.9), (0.85, 1.85))
    ]
    items = [
        _floor(x, z),
        *_walls(x, z),
        Item("stairs", join(*steps, platform), _OCHRE),
        Item("railing_right", rails[0], _SLATE),
        Item("railing_left", rails[1], _SLATE),
    ]
    return Plan(
        "stairs",
        "A room of 4 x 6 m with three steps of 0.16 m (treads 0.3 m) up to a platform 0.48 m high, beyond z = -0.9; "
        "the planner knows the lower floor only.",
        tuple(items),
        start=(0.0, 1.8, 3.1416),
        targets={"foot_of_stairs": (0.0, 0.5), "corner": (1.5, 2.4)},
        reach={"platform": (0.0, 0.48, -1.8)},
    )


SCENES: dict[str, Callable[[], Plan]] = {
    "living_room": living_room,
    "corridor": corridor,
    "pillars": pillars,
    "doorway": doorway,
    "stairs": stairs,
}
"""Name and maker of every bundled scene."""


def toml(plan: Plan) -> str:
    """What goes beside the GLB file: floor height, unit, up axis, notes, places to start from and to go to."""
    x, z, heading = plan.start
    lines = [
        f'notes = "{plan.notes}"',
        'unit = "m"',
        'up = "y"',
        "floor = 0.0",
        "",
        "[start]",
        f"position = [{x}, {z}]  # x, z (m)",
        f"heading = {heading}  # rad about +y; 0 faces +z",
        "",
        "[targets]  # places to stand: x, z (m)",
        *(f"{name} = [{a}, {b}]" for name, (a, b) in plan.targets.items()),
    ]
    if plan.reach:
        lines += ["", "[reach]  # points for a hand or a foot: x, y, z (m)"]
        lines += [f"{name} = [{a}, {b}, {c}]" for name, (a, b, c) in plan.reach.items()]
    return "\n".join(lines) + "\n"


def write(folder: Path = BUNDLED) -> list[Path]:
    """Write every scene's .glb and .toml into `folder`, and return the paths."""
    paths = []
    for name, make in SCENES.items():
        plan = make()
        for path, data in ((folder / f"{name}.glb", glb(plan.items)), (folder / f"{name}.toml", toml(plan).encode())):
            with atomic_write(path) as file:
                file.write(data)
            paths.append(path)
    return paths


if __name__ == "__main__":
    for written in write(Path(sys.argv[1]) if len(sys.argv) > 1 else BUNDLED):
        print(f"{written}  {written.stat().st_size / 1024:.1f} kB")
