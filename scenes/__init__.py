"""What exists: geometry, the body in it, and motion as data. Imports neither objectives nor scenectl."""

from scenes.body.body import DEFAULT_BODY, ProxyBody
from scenes.body.capsules import FittedCapsule, fit_capsule
from scenes.body.fit import fit_body
from scenes.body.gltf import read_rig
from scenes.body.proxies import FittedPart, Proxies, fit_proxies, load_body
from scenes.body.rig import Part, Rig
from scenes.body.urdf import read_urdf
from scenes.errors import UserError
from scenes.mesh.mesh import Mesh, load_mesh, load_parts
from scenes.mesh.primitives import (
    PRIMITIVES,
    Box,
    Capsule,
    Cylinder,
    Plane,
    Primitive,
    Sphere,
    Waypoints,
    csg,
    primitive,
)
from scenes.motion.motion import Motion, Pose2D
from scenes.motion.skeleton import HUMANML3D, Skeleton
from scenes.sdf.bake import Bake, bake, default_cache
from scenes.sdf.bake_blocks import bake_blocks
from scenes.sdf.blocks import SdfBlocks
from scenes.sdf.field import DistanceField
from scenes.sdf.grid import SdfGrid
from scenes.sdf.lattice import Lattice
from scenes.world.assembly import Assembly
from scenes.world.contact import Closest, capsule_clearance, closest_point, march, swept_clearance
from scenes.world.floor.ground import Floor
from scenes.world.floor.planning import FreeArea, free_area
from scenes.world.floor.polyline import path_length
from scenes.world.moving import MovingObject, Trajectory
from scenes.world.scene import Scene, bundled, bundled_names, load_scene

__all__ = [
    "DEFAULT_BODY",
    "HUMANML3D",
    "PRIMITIVES",
    "Assembly",
    "Bake",
    "Box",
    "Capsule",
    "Closest",
    "Cylinder",
    "DistanceField",
    "FittedCapsule",
    "FittedPart",
    "Floor",
    "FreeArea",
    "Lattice",
    "Mesh",
    "Motion",
    "MovingObject",
    "Part",
    "Plane",
    "Pose2D",
    "Primitive",
    "Proxies",
    "ProxyBody",
    "Rig",
    "Scene",
    "SdfBlocks",
    "SdfGrid",
    "Skeleton",
    "Sphere",
    "Trajectory",
    "UserError",
    "Waypoints",
    "bake",
    "bake_blocks",
    "bundled",
    "bundled_names",
    "capsule_clearance",
    "closest_point",
    "csg",
    "default_cache",
    "fit_body",
    "fit_capsule",
    "fit_proxies",
    "free_area",
    "load_body",
    "load_mesh",
    "load_parts",
    "load_scene",
    "march",
    "path_length",
    "primitive",
    "read_rig",
    "read_urdf",
    "swept_clearance",
]
