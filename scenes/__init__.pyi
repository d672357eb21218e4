from .body.body import DEFAULT_BODY as DEFAULT_BODY, ProxyBody as ProxyBody
from .body.capsules import FittedCapsule as FittedCapsule, fit_capsule as fit_capsule
from .body.fit import fit_body as fit_body
from .body.gltf import read_rig as read_rig
from .body.proxies import (
    FittedPart as FittedPart,
    Proxies as Proxies,
    fit_proxies as fit_proxies,
    load_body as load_body,
)
from .body.rig import Part as Part, Rig as Rig
from .body.urdf import read_urdf as read_urdf
from .errors import UserError as UserError
from .mesh.csg import csg as csg
from .mesh.mesh import Mesh as Mesh, load_mesh as load_mesh, load_parts as load_parts
from .mesh.primitives import (
    PRIMITIVES as PRIMITIVES,
    Box as Box,
    Capsule as Capsule,
    Cylinder as Cylinder,
    Plane as Plane,
    Primitive as Primitive,
    Sphere as Sphere,
    primitive as primitive,
)
from .motion.motion import Motion as Motion, Pose2D as Pose2D
from .motion.skeleton import HUMANML3D as HUMANML3D, Skeleton as Skeleton
from .motion.waypoints import Waypoints as Waypoints
from .sdf.bake import Bake as Bake, bake as bake, default_cache as default_cache
from .sdf.bake_blocks import bake_blocks as bake_blocks
from .sdf.blocks import SdfBlocks as SdfBlocks
from .sdf.field import DistanceField as DistanceField
from .sdf.grid import SdfGrid as SdfGrid
from .sdf.lattice import Lattice as Lattice
from .sdf.settings import BakeSettings as BakeSettings
from .world.assembly import Assembly as Assembly
from .world.contact import (
    Closest as Closest,
    capsule_clearance as capsule_clearance,
    closest_point as closest_point,
    march as march,
    swept_clearance as swept_clearance,
)
from .world.floor.ground import Floor as Floor
from .world.floor.planning import FreeArea as FreeArea, free_area as free_area
from .world.floor.polyline import path_length as path_length
from .world.moving import MovingObject as MovingObject, Trajectory as Trajectory
from .world.scene import (
    BUNDLED as BUNDLED,
    Scene as Scene,
    bundled as bundled,
    bundled_names as bundled_names,
    load_scene as load_scene,
)
