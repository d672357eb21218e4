"""A scene by one word: the name of a bundled one, or a mesh file."""

from __future__ import annotations

from pathlib import Path

from scenes.errors import UserError, did_you_mean
from scenes.sdf.settings import FreeSpace
from scenes.world.scene import Scene, bundled, bundled_names, load_scene


def named_scene(
    name: str,
    unit: str | None = None,
    up: str | None = None,
    resolution: int = 256,
    free_space: FreeSpace = "auto",
    thickness: float | int = 0.0,
    spacing: float | int | None = None,
) -> Scene:
    """A bundled scene or that of a mesh file; raises UserError where it is neither.

    Args:
        name: of a bundled scene, or a path.
        unit, up, free_space: of the file, as `load_scene` takes them; a bundled scene states its own.
        resolution, thickness, spacing: as `Scene` takes them.
    """
    if name in bundled_names():
        return bundled(name, resolution=resolution, thickness=thickness, spacing=spacing)
    if not Path(name).exists() and not Path(name).suffix:
        raise UserError(
            f"'{name}' is neither a file, a folder nor a bundled scene{did_you_mean(name, bundled_names())}"
        )
    return load_scene(
        name, unit, up, resolution=resolution, free_space=free_space, thickness=thickness, spacing=spacing
    )
