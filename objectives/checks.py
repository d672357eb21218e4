"""Static validation of a term: what can be known to be wrong before any motion exists."""

from __future__ import annotations

from typing import Any

import numpy as np
import torch

from objectives.context import Context
from objectives.parameters import FloorPoint, Point, Time, Window, instances, stated
from objectives.term import Term
from objectives.tracks import TrackBase
from scenes.errors import UserError
from scenes.motion.bones import standing_pose
from scenes.motion.motion import Motion
from scenes.motion.skeleton import Skeleton


def check_term(
    term: Term, context: Context, seconds: float, fps: float, t0: float, skeleton: Skeleton, slack: float
) -> None:
    """Raise UserError, naming the term, for times, positions, joints or files that cannot be right."""
    _check_times(term, t0, t0 + seconds, fps)
    _check_places(term, context, slack)
    motion = standing(skeleton, max(1, round(seconds * fps)), fps, t0, context)
    try:
        with torch.no_grad():
            found = term.evaluate(motion, context.unbaked)
    except UserError:
        raise
    except Exception as error:  # a goal written by a user: say which, and what it raised
        raise UserError(f"{term.label}: its function failed on a standing person ({error})") from error
    if not found.mask.any():
        raise UserError(f"{term.label} is active at no frame between {t0:g} and {t0 + seconds:g} s")
    if not torch.isfinite(found.residual).all():
        raise UserError(f"{term.label} is not finite for a standing person; check its parameters")


def standing(skeleton: Skeleton, frames: int, fps: float, t0: float, context: Context) -> Motion:
    """A person at rest in the middle of the scene, world m."""
    rest = standing_pose(skeleton).numpy()
    low, high = _bounds(context)
    middle = np.where(np.isfinite(low + high), (low + high) / 2, 0.0)
    rest += [middle[0], (low[1] if np.isfinite(low[1]) else 0.0) - rest[:, 1].min(), middle[2]]
    joints = torch.as_tensor(rest, dtype=torch.float32).expand(frames, -1, -1).contiguous()
    return Motion(joints, fps=fps, t0=t0, skeleton=skeleton)


def _check_times(term: Term, begin: float, end: float, fps: float) -> None:
    typed = [(term.spec.parameters[name].hint, value) for name, value in term.parameters.items()]
    times = [*term.times, *(time for hint, value in typed for time in stated(hint, value, Time))]
    # A target must lie in the motion; an obstacle may come from before it and go on after it.
    tracks = instances(dict(term.parameters), TrackBase) if term.spec.pulls else []
    for time in times + [time for track in tracks for time in track.span]:
        if not begin - 0.5 / fps <= time <= end + 1e-6:
            raise UserError(f"{term.label}: time {time:g} s lies outside the motion, {_span(begin, end)}")
    spans = [(name, span) for name, span in (("window", term.window), ("sometime", term.sometime)) if span]
    spans += [("window", span) for hint, value in typed for span in stated(hint, value, Window)]
    for name, span in spans:
        if span[1] < begin or span[0] > end:
            raise UserError(f"{term.label}: {name} {list(span)} s does not touch the motion, {_span(begin, end)}")


def _span(begin: float, end: float) -> str:
    return f"which runs from {begin:g} to {end:g} s"


def _check_places(term: Term, context: Context, slack: float) -> None:
    low, high = _bounds(context)
    for name, value in term.parameters.items():
        for place in places(value):
            outside = (place < low - slack) | (place > high + slack)
            if outside.any():
                axis = int(outside.argmax())
                raise UserError(
                    f"{term.label}: '{name}' has {'xyz'[axis]} = {place[axis]:g} m, outside the scene, which spans "
                    f"{low[axis]:g} to {high[axis]:g} m on that axis"
                )


def places(value: Any) -> list[np.ndarray]:
    """World points (m) in parameters, ``[3]`` each; nan on the axes that they do not state."""
    found = [np.array([p.x, p.y, p.z]) for p in instances(value, Point)]
    found += [np.array([p.x, np.nan, p.z]) for p in instances(value, FloorPoint)]
    for track in instances(value, TrackBase):
        times = torch.linspace(*track.span, 64, dtype=torch.float64)
        found += list(track.position(times)[track.active(times)].numpy())
    return found


def _bounds(context: Context) -> tuple[np.ndarray, np.ndarray]:
    """Lower and upper corner; infinite on an axis along which the scene has no extent."""
    bounds = np.asarray(context.scene.bounds, dtype=np.float64).reshape(2, 3)
    flat = ~(np.isfinite(bounds).all(0) & (bounds[1] > bounds[0]))
    return np.where(flat, -np.inf, bounds[0]), np.where(flat, np.inf, bounds[1])
