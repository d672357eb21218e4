"""What a task's goals and walk say about joints at times, for families whose networks take goals as inputs."""

from __future__ import annotations

import torch

from objectives import Context, Objective
from scenectl.generators.conditions import Conditions
from scenectl.generators.spec import Spec
from scenes.motion.bones import rest_pose
from scenes.motion.motion import Motion, Pose2D


def conditions_of(objective: Objective, context: Context, start: Pose2D, seconds: float, spec: Spec) -> Conditions:
    """Targets of the goals that pull, on the generator's clock, world frame; nothing of goals at times unknown.

    Goals are asked beside a body at rest: where they draw a joint to does not depend on where it is.
    """
    frames = round(seconds * spec.fps)
    rest = torch.as_tensor(rest_pose(spec.skeleton), dtype=torch.float32)
    body = Motion(rest.expand(frames, *rest.shape).clone(), fps=spec.fps, skeleton=spec.skeleton).placed(start)
    times, joints, places = [body.times[:0]], [torch.zeros(0, dtype=torch.long)], [rest[:0]]
    for term in (term for term in objective.counted if term.sometime is None):
        found = term.evaluate(body, context)
        if found.targets is None:
            continue
        for entry, joint in enumerate(found.joints):
            if joint in spec.skeleton.names:
                stated = found.mask[:, entry] & found.targets[:, entry].isfinite().any(-1)
                times.append(body.times[stated])
                joints.append(torch.full((int(stated.sum()),), spec.skeleton.index(joint)))
                places.append(found.targets[stated, entry].to(rest))
    return Conditions.of_positions(torch.cat(times), torch.cat(joints), torch.cat(places), spec.skeleton)
