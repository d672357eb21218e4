"""What a task's goals and walk say about joints at times, for families whose networks take goals as inputs."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import TypeAlias

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from objectives import Context, Objective, Term
from objectives.term import Evaluated
from scenectl.control import Figure
from scenectl.generators.conditions import Conditions
from scenectl.generators.spec import Spec
from scenes.motion.bones import rest_pose
from scenes.motion.motion import Motion, Pose2D

Target: TypeAlias = tuple[Term, str | None, Float[Tensor, " n"], Float[Tensor, "n 3"]]
"""A term, the joint that it draws, and the times (s) and places (m, nan on coordinates that are free) to which."""

_AIMS = {"bone": "directions", "front": "fronts", "rotation": "rotations"}
"""Where conditions keep what kind of aim."""
_ELSEWHERE = Pose2D((0.7, 0.0, -0.4), 1.0)


def conditions_of(
    objective: Objective, context: Context, start: Pose2D, seconds: float, spec: Spec, figure: Figure | None = None
) -> Conditions:
    """Targets and aims of the goals that pull, on the generator's clock, world frame; nothing at times unknown.

    Goals are asked beside a body at rest: where they draw a joint to does not depend on where it is. Of how they turn
    joints, what does (towards a place, against another joint) is left out. A target of a body with a `figure` stands
    where the generator's own has it: exact for one of the same proportions, otherwise as near as limbs differ.
    """
    stated = [
        ("positions", term, joint, when, where if figure is None else figure.back(where))
        for term, joint, when, where in targets_of(objective, context, start, seconds, spec)
    ]
    stated += _aims_of(objective, context, start, seconds, spec)
    stated = [one for one in stated if one[1].sometime is None and one[2] in spec.skeleton.names]
    times = [when for *_, when, _ in stated]
    joints = [torch.full((len(when),), spec.skeleton.index(str(joint))) for _, _, joint, when, _ in stated]
    found = Conditions.none(torch.cat([torch.zeros(0), *times]), torch.cat([torch.zeros(0).long(), *joints]))
    begin = 0
    for what, _, _, when, values in stated:
        found = found.stating(what, slice(begin, begin + len(when)), values)
        begin += len(when)
    return replace(found, skeleton=spec.skeleton)


def targets_of(objective: Objective, context: Context, start: Pose2D, seconds: float, spec: Spec) -> Iterator[Target]:
    """Where each term draws each joint."""
    body = _at_rest(context, start, seconds, spec)
    for term, found in _evaluated(objective, context, body):
        if found.targets is not None:
            yield from _stated(term, found, body, found.targets, found.targets.isfinite().any(-1))


def _aims_of(
    objective: Objective, context: Context, start: Pose2D, seconds: float, spec: Spec
) -> Iterator[tuple[str, Term, str | None, Float[Tensor, " n"], Float[Tensor, "n d"]]]:
    """How each term turns each joint, wherever the body is and however it is turned."""
    body = _at_rest(context, start, seconds, spec)
    for term, found in _evaluated(objective, context, body):
        if found.aim is None:
            continue
        other = term.evaluate(body.placed(_ELSEWHERE), context).aim
        assert other is not None
        same = torch.isclose(found.aim.values, other.values, atol=1e-4, equal_nan=True).all(-1)
        known = found.aim.values.isfinite().any(-1) & same
        for one in _stated(term, found, body, found.aim.values, known):
            yield _AIMS[found.aim.kind], *one


def _stated(
    term: Term, found: Evaluated, body: Motion, values: Float[Tensor, "T n d"], known: Bool[Tensor, "T n"]
) -> Iterator[tuple[Term, str | None, Float[Tensor, " m"], Float[Tensor, "m d"]]]:
    """Values of each entry at the frames where it applies and they are known."""
    for entry, joint in enumerate(found.joints):
        frames = found.mask[:, entry] & known[:, entry]
        yield term, joint, body.times[frames], values[frames, entry].to(body.joints)


def _evaluated(objective: Objective, context: Context, body: Motion) -> Iterator[tuple[Term, Evaluated]]:
    for term in (term for term in objective.counted if term.spec.pulls):
        yield term, term.evaluate(body, context)


def _at_rest(context: Context, start: Pose2D, seconds: float, spec: Spec) -> Motion:
    skeleton = context.body.skeleton
    rest = torch.as_tensor(rest_pose(skeleton), dtype=torch.float32)
    frames = round(seconds * spec.fps)
    return Motion(rest.expand(frames, *rest.shape).clone(), fps=spec.fps, skeleton=skeleton).placed(start)
