"""How it is reached: generators, guidance, refinement, tasks, benchmarks, viewer and command line.

``import scenectl as sc`` gives what most users need; each name is imported when it is first used, so that
``import scenectl`` itself loads neither torch nor VTK.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

__version__ = "0.1.0"

_HOME = {
    "Box": "scenes.mesh.primitives",
    "Capsule": "scenes.mesh.primitives",
    "Context": "objectives",
    "Cylinder": "scenes.mesh.primitives",
    "Mesh": "scenes.mesh.mesh",
    "Motion": "scenes.motion.motion",
    "MovingObject": "scenes.world.moving",
    "Objective": "objectives",
    "ObjectiveGuide": "scenectl.control",
    "Plane": "scenes.mesh.primitives",
    "Pose2D": "scenes.motion.motion",
    "ProxyBody": "scenes.body.body",
    "Result": "scenectl.pipeline.run",
    "Scene": "scenes.world.scene",
    "Sphere": "scenes.mesh.primitives",
    "Task": "scenectl.tasks.schema",
    "Term": "objectives",
    "Trajectory": "scenes.world.moving",
    "UserError": "scenes.errors",
    "Waypoints": "scenes.motion.waypoints",
    "bundled": "scenes.world.scene",
    "csg": "scenes.mesh.csg",
    "edit": "scenectl.pipeline.editing",
    "free_area": "scenes.world.floor.planning",
    "goal": "objectives",
    "goals": "objectives",
    "load_generator": "scenectl.generators",
    "load_mesh": "scenes.mesh.mesh",
    "load_scene": "scenes.world.scene",
    "load_task": "scenectl.tasks.schema",
    "run": "scenectl.pipeline.run",
    "score": "scenectl.pipeline.run",
}

__all__ = [
    "Box",
    "Capsule",
    "Context",
    "Cylinder",
    "Mesh",
    "Motion",
    "MovingObject",
    "Objective",
    "ObjectiveGuide",
    "Plane",
    "Pose2D",
    "ProxyBody",
    "Result",
    "Scene",
    "Sphere",
    "Task",
    "Term",
    "Trajectory",
    "UserError",
    "Waypoints",
    "__version__",
    "bundled",
    "csg",
    "edit",
    "free_area",
    "goal",
    "goals",
    "load_generator",
    "load_mesh",
    "load_scene",
    "load_task",
    "run",
    "score",
]

if TYPE_CHECKING:
    from objectives import Context, Objective, Term, goal, goals
    from scenectl.control import ObjectiveGuide
    from scenectl.generators import load_generator
    from scenectl.pipeline.editing import edit
    from scenectl.pipeline.run import Result, run, score
    from scenectl.tasks.schema import Task, load_task
    from scenes.body.body import ProxyBody
    from scenes.errors import UserError
    from scenes.mesh.csg import csg
    from scenes.mesh.mesh import Mesh, load_mesh
    from scenes.mesh.primitives import Box, Capsule, Cylinder, Plane, Sphere
    from scenes.motion.motion import Motion, Pose2D
    from scenes.motion.waypoints import Waypoints
    from scenes.world.floor.planning import free_area
    from scenes.world.moving import MovingObject, Trajectory
    from scenes.world.scene import Scene, bundled, load_scene


def __getattr__(name: str) -> Any:
    if name not in _HOME:
        raise AttributeError(f"module 'scenectl' has no attribute '{name}'")
    value = getattr(import_module(_HOME[name]), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted({*globals(), *_HOME})
