"""Longer copies of motions that repeat themselves: a walk of four steps goes on for many more."""

from __future__ import annotations

import random
from dataclasses import replace

import torch
from jaxtyping import Float
from torch import Tensor

from scenectl.data.corpus import Clip
from scenectl.data.features import canonicalise, smoothed_heading, to_uniform_skeleton
from scenectl.data.seams import seen_from_body
from scenes.motion.headings import turned

SHORTEST_LOOP = 12
"""Frames of a loop at least; half a second holds a running stride."""
ALIKE = 0.07
"""Largest distance (m, poses and their velocities, mean over joints) between the two frames where a loop closes."""
BLEND = 8
"""Frames after a seam over which what is left of the distance dies out."""


def repeated(clip: Clip, draw: random.Random, frames: tuple[int, int] = (120, 200)) -> Clip | None:
    """The clip with its best loop played over and over, to about as many frames as drawn from `frames`.

    The loop runs between two frames of like pose and velocity, seen from the body; each round goes on from the place
    and heading that the last one reached, as in a motion graph. None where the clip has no such loop.
    """
    wanted, loop = draw.randint(*frames), _loop(clip.joints)
    if loop is None or clip.frames >= wanted:
        return None
    first, last = loop
    joints, heading = clip.joints, smoothed_heading(clip.joints)
    out = joints[:last]
    at, facing = joints[last], float(heading[last])
    rounds = max(1, round((wanted - clip.frames) / (last - first)))
    for i in range(rounds):
        piece = joints[first : last + 1] if i + 1 < rounds else joints[first:]
        placed = _continued(piece, at, joints.new_tensor(facing - float(heading[first])))
        out = torch.cat([out, placed[:-1] if i + 1 < rounds else placed])
        at, facing = placed[-1], facing + float(heading[last]) - float(heading[first])
    return replace(clip, id=f"{clip.id}~repeat", joints=canonicalise(to_uniform_skeleton(out)))


def _loop(joints: Float[Tensor, "T 22 3"]) -> tuple[int, int] | None:
    """First and last frame of the loop that closes best; beginnings in the first half, ends in the second."""
    pose, velocity = seen_from_body(joints, smoothed_heading(joints))
    half, frames = (len(joints) - 1) // 2, len(joints) - 1
    if half < 1 or frames - half < 1:
        return None
    begins, ends = slice(0, half), slice(half, frames)
    distance = (pose[ends, None] - pose[None, begins]).norm(dim=-1).mean(-1)
    distance = distance + (velocity[ends, None] - velocity[None, begins]).norm(dim=-1).mean(-1)
    length = torch.arange(half, frames, device=joints.device)[:, None] - torch.arange(half, device=joints.device)
    distance = torch.where(length >= SHORTEST_LOOP, distance, torch.inf)
    best = int(distance.argmin())
    end, begin = divmod(best, half)
    return (begin, half + end) if float(distance.flatten()[best]) < ALIKE else None


def _continued(piece: Float[Tensor, "N 22 3"], at: Float[Tensor, "22 3"], turn: Float[Tensor, ""]) -> Tensor:
    """The piece moved so that it begins in the pose `at`: rigidly, but for an offset that dies out."""
    floor = piece.new_tensor([1.0, 0.0, 1.0])
    placed = turned(piece - piece[0, 0] * floor, turn) + at[0] * floor
    rest = (1 - torch.arange(len(piece), device=piece.device) / BLEND).clamp_min(0.0)
    return placed + (3 * rest**2 - 2 * rest**3)[:, None, None] * (at - placed[0])
