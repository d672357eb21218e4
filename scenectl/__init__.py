"""How it is reached: generators, guidance, refinement, tasks, benchmarks, viewer and command line.

``import scenectl as sc`` gives what most users need; each name is imported when it is first used, so that
``import scenectl`` itself loads neither torch nor VTK.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

__version__ = "0.1.0"

_HOME = {
    "Box": "scenes.primitives",
    "Capsule": "scenes.primitives",
    "Context": "objectives",
    "Cylinder": "scenes.primitives",
    "Mesh": "scenes.mesh",
    "Motion": "scenes.motion",
    "MovingObject": "scenes.moving",
    "Objective": "objectives",
    "ObjectiveGuide": "scenectl.control",
    "Plane": "scenes.primitives",
    "Pose2D": "scenes.motion",
    "ProxyBody": "scenes.body",
    "Result": "scenectl.runner",
    "Scene": "scenes.scene",
    "Sphere": "scenes.primitives",
    "Task": "scenectl.task",
    "Term": "objectives",
    "Trajectory": "scenes.moving",
    "UserError": "scenes.errors",
    "Waypoints": "scenes.primitives",
    "bundled": "scenes.scene",
    "csg": "scenes.primitives",
    "edit": "scenectl.editing",
    "free_area": "scenes.floor",
    "goal": "objectives",
    "goals": "objectives",
    "load_generator": "scenectl.generators",
    "load_mesh": "scenes.mesh",
    "load_scene": "scenes.scene",
    "load_task": "scenectl.task",
    "run": "scenectl.runner",
    "score": "scenectl.runner",
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
    from scenectl.editing import edit
    from scenectl.generators import load_generator
    from scenectl.runner import Result, run, score
    from scenectl.task import Task, load_task
    from scenes.body import ProxyBody
    from scenes.errors import UserError
    from scenes.floor import free_area
    from scenes.mesh import Mesh, load_mesh
    from scenes.motion import Motion, Pose2D
    from scenes.moving import MovingObject, Trajectory
    from scenes.primitives import Box, Capsule, Cylinder, Plane, Sphere, Waypoints, csg
    from scenes.scene import Scene, bundled, load_scene


def __getattr__(name: str) -> Any:
    if name not in _HOME:
        raise AttributeError(f"module 'scenectl' has no attribute '{name}'")
    value = getattr(import_module(_HOME[name]), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted({*globals(), *_HOME})
