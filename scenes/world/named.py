"""A scene by one word: the name of a bundled one, or a mesh file."""

from __future__ import annotations

from pathlib import Path
from typing import Unpack

from scenes.errors import UserError, did_you_mean
from scenes.sdf.settings import BakeOptions
from scenes.world.scene import Scene, bundled, bundled_names, load_scene


def named_scene(name: str, unit: str | None = None, up: str | None = None, **baking: Unpack[BakeOptions]) -> Scene:
    """A bundled scene or that of a mesh file; raises UserError where it is neither.

    Args:
        name: of a bundled scene, or a path.
        unit, up: of the file, as `load_scene` takes them; a bundled scene states its own, and its own `free_space`.
        **baking: as `Scene` takes them.
    """
    if name in bundled_names():
        baking.pop("free_space", None)
        return bundled(name, **baking)
    if not Path(name).exists() and not Path(name).suffix:
        raise UserError(
            f"'{name}' is neither a file, a folder nor a bundled scene{did_you_mean(name, bundled_names())}"
        )
    return load_scene(name, unit, up, **baking)
