"""What a task's goals and walk say about joints at times, for families whose networks take goals as inputs."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TypeAlias

import torch
from jaxtyping import Float
from torch import Tensor

from objectives import Context, Objective, Term
from scenectl.control import Figure
from scenectl.generators.conditions import Conditions
from scenectl.generators.spec import Spec
from scenes.motion.bones import rest_pose
from scenes.motion.motion import Motion, Pose2D

Target: TypeAlias = tuple[Term, str | None, Float[Tensor, " n"], Float[Tensor, "n 3"]]
"""A term, the joint that it draws, and the times (s) and places (m, nan on coordinates that are free) to which."""


def conditions_of(
    objective: Objective, context: Context, start: Pose2D, seconds: float, spec: Spec, figure: Figure | None = None
) -> Conditions:
    """Targets of the goals that pull, on the generator's clock, world frame; nothing of goals at times unknown.

    Goals are asked beside a body at rest: where they draw a joint to does not depend on where it is. A target of a body
    with a `figure` stands where the generator's own has it: exact for one of the same proportions, otherwise as near as
    limbs differ.
    """
    times, joints, places = [torch.zeros(0)], [torch.zeros(0, dtype=torch.long)], [torch.zeros(0, 3)]
    for term, joint, when, where in targets_of(objective, context, start, seconds, spec):
        if term.sometime is None and joint in spec.skeleton.names:
            times.append(when)
            joints.append(torch.full((len(when),), spec.skeleton.index(joint)))
            places.append(where if figure is None else figure.back(where))
    return Conditions.of_positions(torch.cat(times), torch.cat(joints), torch.cat(places), spec.skeleton)


def targets_of(objective: Objective, context: Context, start: Pose2D, seconds: float, spec: Spec) -> Iterator[Target]:
    """Where each term draws each joint."""
    skeleton = context.body.skeleton
    rest = torch.as_tensor(rest_pose(skeleton), dtype=torch.float32)
    frames = round(seconds * spec.fps)
    body = Motion(rest.expand(frames, *rest.shape).clone(), fps=spec.fps, skeleton=skeleton).placed(start)
    for term in (term for term in objective.counted if term.spec.pulls):
        found = term.evaluate(body, context)
        if found.targets is None:
            continue
        for entry, joint in enumerate(found.joints):
            stated = found.mask[:, entry] & found.targets[:, entry].isfinite().any(-1)
            yield term, joint, body.times[stated], found.targets[stated, entry].to(rest)
