"""What exists: geometry, the body in it, and motion as data. Imports neither objectives nor scenectl."""

from scenes.assembly import Assembly
from scenes.bake import Bake, bake, default_cache
from scenes.bake_blocks import bake_blocks
from scenes.blocks import SdfBlocks
from scenes.body import DEFAULT_BODY, ProxyBody
from scenes.body_fit import fit_body
from scenes.capsules import FittedCapsule, fit_capsule
from scenes.contact import Closest, capsule_clearance, closest_point, march, swept_clearance
from scenes.errors import UserError
from scenes.field import DistanceField
from scenes.floor import Floor, FreeArea, free_area, path_length
from scenes.gltf import read_rig
from scenes.grid import SdfGrid
from scenes.lattice import Lattice
from scenes.mesh import Mesh, load_mesh, load_parts
from scenes.motion import Motion, Pose2D
from scenes.moving import MovingObject, Trajectory
from scenes.primitives import (
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
from scenes.proxies import FittedPart, Proxies, fit_proxies, load_body
from scenes.rig import Part, Rig
from scenes.scene import Scene, bundled, bundled_names, load_scene
from scenes.skeleton import HUMANML3D, Skeleton
from scenes.urdf import read_urdf

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
