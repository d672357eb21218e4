"""How large scenes are, and which way is up: what a file's triangles say where nobody stated unit or axis."""

from __future__ import annotations

import math

import numpy as np

from scenes.errors import UserError

UNITS = {"m": 1.0, "cm": 0.01, "mm": 0.001, "in": 0.0254, "ft": 0.3048}
"""Metres in each unit that a file may be in."""

TO_Y_UP = {
    "x": np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]]),
    "y": np.eye(3),
    "z": np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]]),
}
"""Proper rotations that take the named axis to +y; rows act on column vectors (x, y, z)."""

SMALLEST, LARGEST = 0.05, 2000.0
"""Plausible extents of a scene (m), along its longest side: 5 cm to 2 km."""

_WORDS = {"m": "metres", "cm": "centimetres", "mm": "millimetres", "in": "inches", "ft": "feet"}
_VAST = 40.0
"""Metres; nothing indoors is so large along all three axes; rooms in inches or centimetres are at least twice that."""
_NARROWEST, _LONGEST = 1.2, 60.0
"""Metres across what a scene in another unit would be: the width of a corridor, the length of a hall."""
_STOREY = (2.1, 2.9)
"""Metres between floor and ceiling as a rule: 7 feet, the least of a habitable room (International Residential Code,
R305), to 9.5 feet. Higher rooms are not doubted but where they are that wide, and larger seen from a side."""
_LEVEL = math.cos(math.radians(8.0))


def in_metres(points: np.ndarray, unit: str, up: str) -> np.ndarray:
    """Points ``[n, 3]`` of a file in metres, y up; `unit` is a key of `UNITS`, `up` of `TO_Y_UP`."""
    with np.errstate(all="ignore"):  # what is not finite is told where meshes are made
        moved: np.ndarray = points * UNITS[unit] @ TO_Y_UP[up].T
    return moved


def check_extent(file: str, unit: str, bounds: np.ndarray) -> None:
    """Raise UserError for bounds ``[2, 3]`` (m) that no scene has; `unit` is the file's."""
    extent = float(np.ptp(bounds, axis=0).max())
    if SMALLEST <= extent <= LARGEST:
        return
    size = f"{extent:.3g} m" if extent < 1e5 else f"{extent:.1e} m"
    raw = extent / UNITS[unit]
    fitting = [other for other, metres in UNITS.items() if 0.5 <= raw * metres <= 100.0 and other != unit]
    hint = f"did you mean unit='{fitting[-1] if 'mm' not in fitting else 'mm'}'?" if fitting else "state its unit"
    raise UserError(f"{file} is {size} long in unit '{unit}', and scenes are 5 cm to 2 km; {hint}")


def doubts(file: str, triangles: np.ndarray, unit: str | None, up: str | None) -> tuple[str, ...]:
    """A sentence where a scene looks as if it had another unit, or another axis up, than it was read with.

    Args:
        file: subject of the sentence.
        triangles: ``[F, 3, 3]`` as they were read: in metres, y up, where nothing was stated.
        unit, up: what the user or the file stated, None where nobody did. What is stated is not doubted.
    """
    if unit and up:
        return ()
    extents = np.ptp(triangles.reshape(-1, 3), axis=0)
    likely = {} if unit else _unit(extents)
    metres = extents * (UNITS[likely["unit"]] if likely else 1.0)
    if not up:
        likely |= _axis(metres, triangles)
    if not likely:
        return ()
    size = " x ".join(f"{extent:.3g}" for extent in extents)
    guesses = [_WORDS[word] if key == "unit" else f"{word} up" for key, word in likely.items()]
    state = ", ".join(f'{key} = "{word}"' for key, word in likely.items())
    keep = ", ".join(f'{key} = "{"m" if key == "unit" else "y"}"' for key in likely)
    read = f"{file} is {size} m along x, y and z as read"
    return (f"{read}: {', '.join(guesses)}? state {state}, or {keep} if that is so",)


def _unit(extents: np.ndarray) -> dict[str, str]:
    """The unit in which a vast scene would be a room or a hall: the one nearest to rooms 2.6 m high."""
    if extents.min() < _VAST:
        return {}
    fitting = [
        word
        for word, metres in UNITS.items()
        if extents.min() * metres >= _NARROWEST and extents.max() * metres <= _LONGEST
    ]
    if not fitting:
        return {}
    return {"unit": min(fitting, key=lambda word: abs(math.log(extents.min() * UNITS[word] / 2.6)))}


def _axis(metres: np.ndarray, triangles: np.ndarray) -> dict[str, str]:
    """The axis that is up more likely than y: it has a storey's height, or an open floor.

    Args:
        metres: extents along x, y and z.
        triangles: ``[F, 3, 3]``, in any unit.
    """
    a, b, c = np.moveaxis(triangles, 1, 0)
    areas = np.cross(b - a, c - a) / 2.0
    along = np.abs(areas)
    level = (along * (along > _LEVEL * np.linalg.norm(areas, axis=1, keepdims=True))).sum(axis=0)
    extents = np.ptp(triangles.reshape(-1, 3), axis=0)
    across = np.array([extents[1] * extents[2], extents[2] * extents[0], extents[0] * extents[1]])
    # seen along an axis, a floor without a ceiling covers the scene once, what is closed as often as not at all, and
    # a room of which one wall faces the other way twice
    net = np.abs(areas.sum(axis=0)) / np.maximum(across, 1e-12)
    if metres.min() < _NARROWEST:  # a thing, or a wall on its own
        return {}
    for axis, word in ((2, "z"), (0, "x")):
        storey = _STOREY[0] <= metres[axis] <= _STOREY[1] and not _STOREY[0] <= metres[1] <= _STOREY[1]
        if (storey and level[axis] > level[1]) or (0.8 < net[axis] < 1.2 and net[1] < 0.2):
            return {"up": word}
    return {}
