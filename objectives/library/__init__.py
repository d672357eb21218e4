"""The goals that come with the package; importing this registers them."""

from objectives.library import (
    contacts,
    directions,
    heights,
    held,
    natural,
    obstacles,
    paths,
    poses,
    regions,
    scene,
    targets,
)

__all__ = [
    "contacts",
    "directions",
    "heights",
    "held",
    "natural",
    "obstacles",
    "paths",
    "poses",
    "regions",
    "scene",
    "targets",
]
