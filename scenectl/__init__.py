"""How it is reached: generators, guidance, refinement, tasks, benchmarks, viewer and command line.

``import scenectl as sc`` gives what most users need, the names of `__init__.pyi`; each is imported when it is first
used, so that ``import scenectl`` itself loads neither torch nor VTK.
"""

import os
from importlib import import_module

from scenectl.version import __version__

# oneDNN keeps the code that it compiles for every shape, and torch the plan of every product in bfloat16, of 1,024
# shapes by default: memory grows with every new length (tests/scenectl/test_memory.py measures both). One motion
# needs up to 27 of the former (ONEDNN_VERBOSE=profile_create). Read when torch first computes.
os.environ.setdefault("ONEDNN_PRIMITIVE_CACHE_CAPACITY", "32")
os.environ.setdefault("LRU_CACHE_CAPACITY", "32")

_HOMES = {
    "objectives": "Context Objective Term goal goals",
    "scenectl.api": "run score",
    "scenectl.control": "ObjectiveGuide",
    "scenectl.data.formats.motions": "load_motion",
    "scenectl.export.export": "export",
    "scenectl.generators": "load_generator",
    "scenectl.generators.prompts": "Prompt Prompts",
    "scenectl.pipeline.editing": "edit",
    "scenectl.pipeline.results": "Result",
    "scenectl.retarget.robots.robot": "Robot",
    "scenectl.tasks.task": "Task load_task",
    "scenes": (
        "Box Capsule Cylinder Mesh Motion MovingObject Plane Pose2D ProxyBody Scene Sphere Trajectory "
        "UserError Waypoints bundled csg free_area load_mesh load_scene"
    ),
}
_HOME = {name: home for home, names in _HOMES.items() for name in names.split()}
__all__ = ["__version__", *_HOME]


def __getattr__(name: str) -> object:
    if name not in _HOME:
        raise AttributeError(f"module 'scenectl' has no attribute '{name}'")
    value = getattr(import_module(_HOME[name]), name)
    return globals().setdefault(name, value)  # `export` is a package by then, and can be called


def __dir__() -> list[str]:
    return sorted({*globals(), *_HOME})
