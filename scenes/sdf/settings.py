"""How meshes are baked: the settings that scenes, files and objects hand on, checked once."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal, TypeAlias, TypedDict

from scenes.errors import UserError, did_you_mean
from scenes.numbers import vector

FreeSpace: TypeAlias = str | Sequence[float | int]
"""`"auto"`, `"outside"`, or a point x, y, z in the air (m, world)."""

Cache: TypeAlias = Path | Literal["default"] | None
"""Folder of earlier bakes; "default" for `scenes.sdf.bake.default_cache`, None for none."""


FINEST, COARSEST = 1e-4, 100.0
"""Metres between nodes: the smallest scene, of 5 cm, has 500 of the finest; the widest, of 2 km, 20 of the coarsest."""


class BakeOptions(TypedDict, total=False):
    """Some of the `BakeSettings`, as keywords."""

    resolution: int
    free_space: FreeSpace
    cache: Cache
    thickness: float | int
    spacing: float | int | None
    padding: float | int


@dataclass(frozen=True, kw_only=True)
class BakeSettings:
    """How a mesh is baked.

    Attributes:
        resolution: nodes along the longest padded side, 8 to 512; voxels are cubes.
        free_space: "outside": what the mesh encloses is solid, whichever way it faces. "auto": the same, unless the
            triangles face into a room, and then the room's air is free and all else solid. A point (x, y, z) in the
            air (m, world): space that is enclosed as that point is.
        cache: folder of earlier bakes, "default", or None for none.
        thickness: metres, 0 to 10; pieces of the mesh that enclose nothing (one-sided or double-sided walls), or are
            thinner than this, become solid up to half of it on both sides.
        spacing: metres between nodes, instead of `resolution`; None for none.
        padding: metres added to the bounds on each side, 0 to 100.

    Raises:
        UserError: a number out of range or an unknown rule.
    """

    resolution: int = 256
    free_space: FreeSpace = "auto"
    cache: Cache = "default"
    thickness: float | int = 0.0
    spacing: float | int | None = None
    padding: float | int = 0.1

    def __post_init__(self) -> None:
        check_resolution(self.resolution)
        object.__setattr__(self, "thickness", check_metres("thickness", self.thickness, 10))
        object.__setattr__(self, "padding", check_metres("padding", self.padding, 100))
        object.__setattr__(self, "free_space", check_free_space(self.free_space))
        if self.spacing is not None:
            object.__setattr__(self, "spacing", check_spacing(self.spacing))


def check_metres(what: str, value: float | int, most: float | int) -> float:
    """A length as given; raises UserError unless it is finite, not negative and at most `most` (m)."""
    if not (math.isfinite(value) and 0 <= value <= most):
        raise UserError(f"bake {what} is {value} m; give 0 to {most:g} m")
    return float(value)


def check_resolution(resolution: int) -> None:
    """Raise UserError unless `resolution` is a whole number of nodes from 8 to 512."""
    if isinstance(resolution, bool) or not isinstance(resolution, int) or not 8 <= resolution <= 512:
        raise UserError(f"bake resolution is {resolution}; give a whole number of nodes from 8 to 512")


def check_spacing(spacing: float | int) -> float:
    """Metres between nodes as given; raises UserError unless they are positive, and of a size that can be meant."""
    if not FINEST <= spacing <= COARSEST:
        raise UserError(f"bake spacing is {spacing}; give metres from {FINEST:g} to {COARSEST:g}, such as 0.02")
    return float(spacing)


def check_free_space(free_space: Any) -> FreeSpace:
    """The rule as given, a point as a tuple of floats; raises UserError for anything that is no rule."""
    if isinstance(free_space, str):
        if free_space not in ("auto", "outside"):
            hint = did_you_mean(free_space, ("auto", "outside"))
            raise UserError(f"unknown free-space rule '{free_space}'{hint}, or give a point [x, y, z] in the air")
        return free_space
    return vector(free_space, "free-space seed")
