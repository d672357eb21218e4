"""The cart of tasks/crossing_cart.toml, as the script that makes it: ``python examples/make_cart.py [FILE]``.

A platform on four wheels with a push bar and three parcels, closed solids in metres, y up. The origin is on the floor
under its middle; it is pushed along its own +z.
"""

import sys
from pathlib import Path

from manifold3d import Manifold

from scenes.authoring import Item, box, glb, join
from scenes.files import atomic_write

WIDE, LONG, DECK = 0.31, 0.46, 0.22
"""Half of its width and length, and the height of its platform (m)."""


def wheel(x: float, z: float) -> Manifold:
    """8 cm of radius and 4 cm wide, on the floor."""
    return Manifold.cylinder(0.04, 0.08, 0.08, 24).rotate((0.0, 90.0, 0.0)).translate((x - 0.02, 0.08, z))


def cart() -> list[Item]:
    """The cart."""
    wheels = join(*(wheel(x, z) for x in (-0.24, 0.24) for z in (-0.34, 0.34)))
    axles = [box((-0.24, 0.24), (0.06, 0.1), (z - 0.02, z + 0.02)) for z in (-0.34, 0.34)]
    blocks = [box((-0.1, 0.1), (0.08, DECK - 0.02), (z - 0.04, z + 0.04)) for z in (-0.34, 0.34)]
    deck = join(box((-WIDE, WIDE), (DECK - 0.05, DECK), (-LONG, LONG)), *axles, *blocks)
    posts = [box((x - 0.018, x + 0.018), (DECK - 0.02, 0.98), (-LONG, -LONG + 0.036)) for x in (-0.27, 0.27)]
    bar = join(*posts, box((-0.29, 0.29), (0.95, 0.99), (-LONG, -LONG + 0.036)))
    return [
        Item("wheels", wheels, (66, 72, 80)),
        Item("deck", deck, (176, 92, 74)),
        Item("bar", bar, (66, 72, 80)),
        Item("crate", box((-0.26, 0.26), (DECK + 0.001, DECK + 0.34), (-0.16, 0.4)), (205, 176, 136)),
        Item("parcel", box((-0.22, 0.1), (DECK + 0.341, DECK + 0.58), (-0.1, 0.28)), (204, 154, 74)),
        Item("box", box((-0.2, 0.22), (DECK + 0.001, DECK + 0.26), (-0.4, -0.18)), (84, 122, 129)),
    ]


if __name__ == "__main__":
    target = Path(sys.argv[1]) if len(sys.argv) > 1 else Path(__file__).parent / "tasks" / "cart.glb"
    with atomic_write(target) as file:
        file.write(glb(cart()))
    print(f"{target}  {target.stat().st_size / 1024:.1f} kB")
