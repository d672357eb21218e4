"""What is wanted: goal functions, and how they compose into an objective. Imports `scenes` only."""

from objectives import library
from objectives.context import BodyLike, Context, Grounded, SceneLike
from objectives.diagnosis import diagnosis
from objectives.kernels import Kernel, Reduction
from objectives.marks import Mark
from objectives.objective import Objective
from objectives.parameters import File, FloorPoint, Point, Region, Time, Window
from objectives.registry import GoalSpec, Masked, Parameter, forget, get_goal, goal, goals
from objectives.report import TermReport
from objectives.term import Assessed, Evaluated, Term
from objectives.tracks import Arc, ArrayTrack, Line, Sinusoid, Track, TrackBase, Waypoints

__all__ = [
    "Arc",
    "ArrayTrack",
    "Assessed",
    "BodyLike",
    "Context",
    "Evaluated",
    "File",
    "FloorPoint",
    "GoalSpec",
    "Grounded",
    "Kernel",
    "Line",
    "Mark",
    "Masked",
    "Objective",
    "Parameter",
    "Point",
    "Reduction",
    "Region",
    "SceneLike",
    "Sinusoid",
    "Term",
    "TermReport",
    "Time",
    "Track",
    "TrackBase",
    "Waypoints",
    "Window",
    "diagnosis",
    "forget",
    "get_goal",
    "goal",
    "goals",
    "library",
]
