"""Every number that guidance, refinement and solvers decide by, in one table, each with where it comes from.

`scenectl bench thresholds` varies any of them by factors and prints what becomes of errors, bodies and passes; an
entry names the bench, if there is one, that shows its effect on many more cases, or the publication that it is from.
"""

from __future__ import annotations

from dataclasses import dataclass, field, fields
from typing import Any

BODY = "scenectl bench implausible"
WALLS = "scenectl bench rooms"
TARGETS = "scenectl bench keyframes"
SOLVER = "scenectl bench control"
POSES = "scenectl bench pose_goals"
NOCEDAL = "Nocedal and Wright, Numerical Optimization, chapters 3 and 7"


def _entry(value: float | int, unit: str, decides: str, source: str) -> Any:
    return field(default=value, metadata={"unit": unit, "decides": decides, "source": source})


@dataclass(frozen=True)
class Thresholds:
    """The table: `entries` lists names, values, units, what each decides, and the command or publication behind it."""

    # A body that goals lift: beside the motion before refinement.
    lift: float = _entry(0.03, "m", "lift of a foot that stood, or depth in the ground, that is answered", BODY)
    standing: float = _entry(0.07, "m", "height over the scene below which a foot stands", BODY)
    still: float = _entry(0.02, "m/frame", "move of a foot below which it stands", BODY)
    near_feet: float = _entry(10.0, "", "factor on `lift` up to which a search goes on from met goals", BODY)
    led: float = _entry(0.2, "", "share of frames with pulling goals from which they lead a body along its way", WALLS)
    # Costs of a body, and kernels of goals, where goals lift it.
    far: float = _entry(0.3, "m", "delta of the Geman-McClure kernel of pulling goals", BODY)
    off: float = _entry(0.03, "m", "the same in the last search, without the body's costs", BODY)
    pull: float = _entry(20.0, "", "factor on the weight of pulling goals", BODY)
    limits: float = _entry(20.0, "", "weight of `joint_limits`", BODY)
    smooth: float = _entry(20.0, "", "weight of `smoothness`", BODY)
    skating: float = _entry(10.0, "", "weight of `foot_skating`", BODY)
    swing: float = _entry(1.0, "m/s", "delta of its Geman-McClure kernel: faster feet swing", BODY)
    clearance: float = _entry(3.0, "", "weight of `foot_clearance`", BODY)
    foot: float = _entry(4e3, "1/m^2", "cost of a foot that is lifted or in the ground, each frame", BODY)
    led_steps: int = _entry(4, "", "steps at least of walks that are led, in which feet cease to slide", WALLS)
    led_clearance: float = _entry(5.0, "", "weight of `foot_clearance` there", WALLS)
    led_skating: float = _entry(200.0, "", "weight of `foot_skating` of the foot that carries there", WALLS)
    carries: float = _entry(0.1, "m", "height over the scene below which a foot may carry there", WALLS)
    slide: float = _entry(0.05, "m/s", "speed over the ground that is free to it", WALLS)
    approach: int = _entry(40, "steps", "at most, of searches with a body's costs", BODY)
    finish: int = _entry(20, "steps", "at most, of searches without them from there", BODY)
    # Polishing.
    reach: float = _entry(0.01, "m", "distance from targets at which polishing takes over from the decoder", TARGETS)
    furthest: float = _entry(3.0, "", "longest move of a joint by polishing, over `reach`", TARGETS)
    polish_steps: int = _entry(20, "steps", "at most, of polishing", TARGETS)
    spread_time: float = _entry(0.15, "s", "standard deviation over time of a smooth move", TARGETS)
    spread_bones: float = _entry(3.0, "bones", "length along the limbs over which it falls to 1/e", TARGETS)
    body_joints: int = _entry(
        3, "", "joints that a goal asks for at once from which bodies are brought in joints", POSES
    )
    fine_time: float = _entry(0.05, "s", "standard deviation over time of their last move", POSES)
    fine_bones: float = _entry(1.0, "bones", "length along the limbs over which it falls to 1/e", POSES)
    posed_smooth: float = _entry(2000.0, "", "weight of `smoothness` where bodies are brought into poses", POSES)
    hanging: float = _entry(30.0, "", "weight of `foot_contact` there, each frame", POSES)
    hangs: float = _entry(0.04, "m", "height of the lower foot over the scene that is free to it there", POSES)
    # Free starts.
    headings: int = _entry(8, "", "directions that are tried for a start that is solved for", TARGETS)
    heading_steps: int = _entry(4, "steps", "at most, of the search from each of them", TARGETS)
    start_steps: int = _entry(30, "steps", "at most, of the search from the best of them", TARGETS)
    # The choice of a solver, in passes (`Step.price`, from `scenectl bench prices`).
    rows: float = _entry(7.2, "passes", "most that a Jacobian may cost for the dual form where all rows count", SOLVER)
    rows_sleeping: float = _entry(3.6, "passes", "the same where some rows are zero, and cost as they wake", SOLVER)
    rows_first: float = _entry(96.0, "passes", "the same at the start of a named `lm`; L-BFGS goes on beyond", SOLVER)
    rows_woken: float = _entry(7.2, "passes", "the same of rows that wake on the way", SOLVER)
    product: float = _entry(1.0, "passes", "most that a product may cost for Gauss-Newton", SOLVER)
    newton_share: float = _entry(0.1, "", "share of the steps that are left to Gauss-Newton where it is chosen", SOLVER)
    # Levenberg-Marquardt and Gauss-Newton.
    damping: float = _entry(0.05, "", "first damping, over the mean diagonal of J J^T or the rows' mean square", SOLVER)
    least_damping: float = _entry(1e-8, "", "least damping", "rounding")
    good: float = _entry(0.1, "", "share of the cost that a step leaves at most for its Jacobian to be kept", SOLVER)
    dual_rounds: int = _entry(6, "", "rounds of finding the active set, exactly", SOLVER)
    cg_rounds: int = _entry(3, "", "rounds of finding it by conjugate gradients", SOLVER)
    cg_steps: int = _entry(20, "steps", "at most, of conjugate gradients", SOLVER)
    cg_tolerance: float = _entry(0.05, "", "share of the first residual at which they end", SOLVER)
    # L-BFGS.
    memory: int = _entry(12, "pairs", "memory of L-BFGS", NOCEDAL)
    decrease: float = _entry(1e-4, "", "sufficient decrease (Wolfe, c1)", NOCEDAL)
    curvature: float = _entry(0.9, "", "curvature (Wolfe, c2)", NOCEDAL)
    trials: int = _entry(10, "", "trials of a line search", SOLVER)
    first_move: float = _entry(0.1, "", "longest first step, in the value's space", SOLVER)


THRESHOLDS = Thresholds()
"""The values in use."""


def entries(table: Thresholds = THRESHOLDS) -> list[dict[str, Any]]:
    """Rows `name`, `value`, `unit`, `decides`, `source`."""
    return [{"name": f.name, "value": getattr(table, f.name), **f.metadata} for f in fields(table)]
