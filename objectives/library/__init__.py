"""The goals that come with the package; importing this registers them."""

from objectives.library import contacts, directions, heights, natural, obstacles, paths, poses, regions, scene, targets

__all__ = ["contacts", "directions", "heights", "natural", "obstacles", "paths", "poses", "regions", "scene", "targets"]
