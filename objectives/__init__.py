"""What is wanted: goal functions, and how they compose into an objective. Imports `scenes` only."""

from objectives import library as library
from objectives.aims import Aim as Aim
from objectives.clips import Clip as Clip, Pose as Pose, read_with as read_with
from objectives.context import BodyLike as BodyLike, Context as Context, Grounded as Grounded, SceneLike as SceneLike
from objectives.diagnosis import diagnosis as diagnosis
from objectives.kernels import Kernel as Kernel, Reduction as Reduction
from objectives.marks import Mark as Mark
from objectives.objective import Objective as Objective
from objectives.parameters import (
    File as File,
    FloorPoint as FloorPoint,
    Point as Point,
    Region as Region,
    Time as Time,
    Window as Window,
    WorldX as WorldX,
    WorldY as WorldY,
    WorldZ as WorldZ,
)
from objectives.registry import (
    GoalSpec as GoalSpec,
    Masked as Masked,
    forget as forget,
    get_goal as get_goal,
    goal as goal,
    goals as goals,
)
from objectives.report import TermReport as TermReport
from objectives.signatures import Parameter as Parameter
from objectives.term import Assessed as Assessed, Evaluated as Evaluated, Term as Term
from objectives.tracks import (
    Arc as Arc,
    ArrayTrack as ArrayTrack,
    Line as Line,
    Sinusoid as Sinusoid,
    Track as Track,
    TrackBase as TrackBase,
    WaypointTrack as WaypointTrack,
)
