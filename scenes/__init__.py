"""What exists: geometry, the body in it, and motion as data. Imports neither objectives nor scenectl.

Each name is imported when it is first used, so that asking for a floor reads no mesh library.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from scenes.body.body import DEFAULT_BODY, ProxyBody
    from scenes.body.capsules import FittedCapsule, fit_capsule
    from scenes.body.fit import fit_body
    from scenes.body.gltf import read_rig
    from scenes.body.proxies import FittedPart, Proxies, fit_proxies, load_body
    from scenes.body.rig import Part, Rig
    from scenes.body.urdf import read_urdf
    from scenes.errors import UserError
    from scenes.mesh.csg import csg
    from scenes.mesh.mesh import Mesh, load_mesh, load_parts
    from scenes.mesh.primitives import PRIMITIVES, Box, Capsule, Cylinder, Plane, Primitive, Sphere, primitive
    from scenes.motion.motion import Motion, Pose2D
    from scenes.motion.skeleton import HUMANML3D, Skeleton
    from scenes.motion.waypoints import Waypoints
    from scenes.sdf.bake import Bake, bake, default_cache
    from scenes.sdf.bake_blocks import bake_blocks
    from scenes.sdf.blocks import SdfBlocks
    from scenes.sdf.field import DistanceField
    from scenes.sdf.grid import SdfGrid
    from scenes.sdf.lattice import Lattice
    from scenes.sdf.settings import BakeSettings
    from scenes.world.assembly import Assembly
    from scenes.world.contact import Closest, capsule_clearance, closest_point, march, swept_clearance
    from scenes.world.floor.ground import Floor
    from scenes.world.floor.planning import FreeArea, free_area
    from scenes.world.floor.polyline import path_length
    from scenes.world.moving import MovingObject, Trajectory
    from scenes.world.scene import BUNDLED, Scene, bundled, bundled_names, load_scene

_HOMES = {
    "scenes.body.body": "DEFAULT_BODY ProxyBody",
    "scenes.body.capsules": "FittedCapsule fit_capsule",
    "scenes.body.fit": "fit_body",
    "scenes.body.gltf": "read_rig",
    "scenes.body.proxies": "FittedPart Proxies fit_proxies load_body",
    "scenes.body.rig": "Part Rig",
    "scenes.body.urdf": "read_urdf",
    "scenes.errors": "UserError",
    "scenes.mesh.csg": "csg",
    "scenes.mesh.mesh": "Mesh load_mesh load_parts",
    "scenes.mesh.primitives": "PRIMITIVES Box Capsule Cylinder Plane Primitive Sphere primitive",
    "scenes.motion.motion": "Motion Pose2D",
    "scenes.motion.skeleton": "HUMANML3D Skeleton",
    "scenes.motion.waypoints": "Waypoints",
    "scenes.sdf.bake": "Bake bake default_cache",
    "scenes.sdf.bake_blocks": "bake_blocks",
    "scenes.sdf.blocks": "SdfBlocks",
    "scenes.sdf.field": "DistanceField",
    "scenes.sdf.grid": "SdfGrid",
    "scenes.sdf.lattice": "Lattice",
    "scenes.sdf.settings": "BakeSettings",
    "scenes.world.assembly": "Assembly",
    "scenes.world.contact": "Closest capsule_clearance closest_point march swept_clearance",
    "scenes.world.floor.ground": "Floor",
    "scenes.world.floor.planning": "FreeArea free_area",
    "scenes.world.floor.polyline": "path_length",
    "scenes.world.moving": "MovingObject Trajectory",
    "scenes.world.scene": "BUNDLED Scene bundled bundled_names load_scene",
}
_HOME = {name: home for home, names in _HOMES.items() for name in names.split()}

__all__ = [
    "BUNDLED", "DEFAULT_BODY", "HUMANML3D", "PRIMITIVES", "Assembly", "Bake", "BakeSettings", "Box", "Capsule",
    "Closest", "Cylinder", "DistanceField", "FittedCapsule", "FittedPart", "Floor", "FreeArea", "Lattice", "Mesh",
    "Motion", "MovingObject", "Part", "Plane", "Pose2D", "Primitive", "Proxies", "ProxyBody", "Rig", "Scene",
    "SdfBlocks", "SdfGrid", "Skeleton", "Sphere", "Trajectory", "UserError", "Waypoints", "bake", "bake_blocks",
    "bundled", "bundled_names", "capsule_clearance", "closest_point", "csg", "default_cache", "fit_body", "fit_capsule",
    "fit_proxies", "free_area", "load_body", "load_mesh", "load_parts", "load_scene", "march", "path_length",
    "primitive", "read_rig", "read_urdf", "swept_clearance",
]  # fmt: skip


def __getattr__(name: str) -> Any:
    if name not in _HOME:
        raise AttributeError(f"module 'scenes' has no attribute '{name}'")
    value = getattr(import_module(_HOME[name]), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted({*globals(), *_HOME})
