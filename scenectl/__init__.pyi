from objectives import Context as Context, Objective as Objective, Term as Term, goal as goal, goals as goals
from scenectl.api import run as run, score as score
from scenectl.control import ObjectiveGuide as ObjectiveGuide
from scenectl.data.formats.motions import load_motion as load_motion
from scenectl.export.export import export as export
from scenectl.generators import load_generator as load_generator
from scenectl.generators.prompts import Prompt as Prompt, Prompts as Prompts
from scenectl.pipeline.editing import edit as edit
from scenectl.pipeline.results import Result as Result
from scenectl.retarget.robots.robot import Robot as Robot
from scenectl.tasks.task import Task as Task, load_task as load_task
from scenectl.version import __version__ as __version__
from scenes import (
    Box as Box,
    Capsule as Capsule,
    Cylinder as Cylinder,
    Mesh as Mesh,
    Motion as Motion,
    MovingObject as MovingObject,
    Plane as Plane,
    Pose2D as Pose2D,
    ProxyBody as ProxyBody,
    Scene as Scene,
    Sphere as Sphere,
    Trajectory as Trajectory,
    UserError as UserError,
    Waypoints as Waypoints,
    bundled as bundled,
    csg as csg,
    free_area as free_area,
    load_mesh as load_mesh,
    load_scene as load_scene,
)
