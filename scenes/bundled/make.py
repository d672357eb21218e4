"""The bundled scenes, as the script that makes them: ``python scenes/bundled/make.py [FOLDER]``.

``solids/NAME.toml`` says what stands in a scene. Every object is a closed solid with outward normals and a node of its
own, in metres, y up, the top of the floor at y = 0. Objects stand 5 mm deep in the floor, so that no faces coincide.
There is no ceiling, and the walls towards +x and +z are low, so that a picture taken from there looks in. The same
versions of the libraries write the same bytes every time.

An object has a `name`, or names for the places x, z `at` which it stands; a `colour`; parts to `add`, and parts to take
away (`minus`). A part is one of:

- `box`: between two coordinates along x, y and z; where an axis lists several pairs, a box for every combination;
- `cushion`: likewise, with edges of radius `round`;
- `column`: upright at x, z, between two heights `y`, with a `radius`, another at its `top` if stated, and its `sides`;
- `leaf`: of a plant, growing from a point; it leans by `tilt`, in the direction `turn` (degrees).

Parts are joined in their order, but those marked `first` before the others.
"""

from __future__ import annotations

import sys
import tomllib
from collections.abc import Iterator, Mapping
from itertools import product
from pathlib import Path
from typing import Any

from manifold3d import Manifold, OpType

from scenes.files import atomic_write
from scenes.mesh.glb import Item, glb

BUNDLED = Path(__file__).parent
"""Where the scenes of this package live."""

Table = Mapping[str, Any]

Offset = tuple[float, float]
"""How far (m, along x and z) from where it is stated a part is made."""


def box(offset: Offset, part: Table) -> Iterator[Manifold]:
    """Boxes between coordinates (m) along each axis."""
    for (x, x_end), (y, y_end), (z, z_end) in _combinations(part["box"], offset):
        yield Manifold.cube((x_end - x, y_end - y, z_end - z)).translate((x, y, z))


def cushion(offset: Offset, part: Table) -> Iterator[Manifold]:
    """Boxes with rounded edges: each the hull of eight spheres in its corners."""
    radius = part["round"]
    ball = Manifold.sphere(radius, 12)
    for axes in _combinations(part["cushion"], offset):
        corners = product(*((low + radius, high - radius) for low, high in axes))
        yield Manifold.batch_hull([ball.translate(corner) for corner in corners])


def column(offset: Offset, part: Table) -> Iterator[Manifold]:
    """An upright cylinder or, with another radius at the top, cone (m)."""
    (x, z), (low, high), radius = part["column"], part["y"], part["radius"]
    along_z = Manifold.cylinder(high - low, radius, part.get("top", radius), part["sides"])
    yield along_z.rotate((-90.0, 0.0, 0.0)).translate((x + offset[0], low, z + offset[1]))


def leaf(offset: Offset, part: Table) -> Iterator[Manifold]:
    """A leaf 0.6 m long."""
    x, y, z = part["leaf"]
    upright = Manifold.sphere(1.0, 10).scale((0.075, 0.3, 0.075)).translate((0.0, 0.34, 0.0))
    leaning = upright.rotate((part["tilt"], 0.0, 0.0)).rotate((0.0, part["turn"], 0.0))
    yield leaning.translate((x + offset[0], y, z + offset[1]))


PARTS = {
    "box": box,
    "cushion": cushion,
    "column": column,
    "leaf": leaf,
}
"""Kinds of parts; each is given an offset and its table."""


def _combinations(axes: list[Any], offset: Offset) -> Iterator[tuple[tuple[float, float], ...]]:
    """One pair of coordinates for each axis, in every way, where an axis lists one pair or several."""
    several = [axis if isinstance(axis[0], list) else [axis] for axis in axes]
    for x, y, z in product(*several):
        yield (x[0] + offset[0], x[1] + offset[0]), (y[0], y[1]), (z[0] + offset[1], z[1] + offset[1])


def solids(parts: list[Table], offset: Offset) -> list[Manifold]:
    """The solids of a list of parts, those of the `first` ones in front."""
    made: dict[bool, list[Manifold]] = {True: [], False: []}
    for part in parts:
        made[part.get("first", False)] += PARTS[next(kind for kind in PARTS if kind in part)](offset, part)
    return made[True] + made[False]


def items(scene: Table) -> Iterator[Item]:
    """The objects of a scene, as its file states them."""
    for thing in scene["object"]:
        for name, offset in thing.get("at", {thing.get("name"): (0.0, 0.0)}).items():
            solid = Manifold.batch_boolean(solids(thing["add"], offset), OpType.Add)
            for hole in solids(thing.get("minus", []), offset):
                solid -= hole
            yield Item(name, solid, tuple(scene["colours"][thing["colour"]]))


def write(folder: Path = BUNDLED) -> list[Path]:
    """Write every scene's .glb into `folder`, and return the paths."""
    paths = []
    for plan in sorted((BUNDLED / "solids").glob("*.toml")):
        path = folder / f"{plan.stem}.glb"
        with atomic_write(path) as file:
            file.write(glb(list(items(tomllib.loads(plan.read_text(encoding="utf-8"))))))
        paths.append(path)
    return paths


if __name__ == "__main__":
    for written in write(Path(sys.argv[1]) if len(sys.argv) > 1 else BUNDLED):
        print(f"{written}  {written.stat().st_size / 1024:.1f} kB")
