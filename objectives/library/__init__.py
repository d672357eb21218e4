"""The goals that come with the package; importing this registers them."""

from objectives.library import directions, heights, natural, obstacles, paths, regions, scene, targets

__all__ = ["directions", "heights", "natural", "obstacles", "paths", "regions", "scene", "targets"]
