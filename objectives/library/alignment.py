"""Which moment of a clip each frame of a motion is: dynamic time warping (Sakoe and Chiba 1978)."""

from __future__ import annotations

import math
from collections.abc import Callable

import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor

from objectives.maths import pelvis_bones
from scenes.errors import UserError
from scenes.motion.motion import Motion

_FINE = 4
"""Moments of the clip for each frame of the motion: at 20 frames a second a wrist at 2 m/s passes 25 mm between two."""
_LEAST, _MOST = _FINE // 2, 2 * _FINE
"""Moments from one frame to the next: half to twice the clip's speed, the slopes that Sakoe and Chiba found best."""


@torch.no_grad()
def aligned(
    motion: Motion,
    active: Bool[Tensor, "*b T"],
    at: Callable[[Float[Tensor, " N"]], Float[Tensor, "N J 3"]],
    seconds: float,
    names: list[str],
    relative: bool,
) -> Float[Tensor, "*b T J 3"]:
    """The clip's body (m) at each active frame, where all of the clip goes by in order and as near as it gets.

    Args:
        motion: that is followed.
        active: its frames in which the clip goes by, in one piece.
        at: bodies of the clip so many seconds after its first frame.
        seconds: how long it is.
        names: joints that count, and whether they are `relative` to the pelvis.

    Raises:
        UserError: a clip that is too long or too short for that.
    """
    count = max(1, round(seconds * motion.fps * _FINE))
    bodies = at(torch.linspace(0, seconds, count + 1).to(motion.joints))
    some, bones = motion.skeleton.indices(names), pelvis_bones(motion.skeleton)
    masks, samples = active.reshape(-1, motion.frames), motion.joints.reshape(-1, *motion.joints.shape[-3:])
    where = torch.zeros(masks.shape, dtype=torch.long, device=active.device)
    for sample, (mask, joints) in enumerate(zip(masks, samples, strict=True)):
        frames = mask.nonzero()[:, 0]
        if not _LEAST * (len(frames) - 1) <= count <= _MOST * (len(frames) - 1):
            raise UserError(
                f"a clip of {seconds:.2f} s goes by in {count / motion.fps / _MOST:.2f} to "
                f"{count / motion.fps / _LEAST:.2f} s, at half to twice its speed, and not in "
                f"{(len(frames) - 1) / motion.fps:.2f} s; state other times in 'begin' and 'end', or a part of the clip"
            )
        where[sample, frames] = _way(_squares(joints[frames], bodies, some, bones, relative))
    return bodies[where.view(active.shape)]


def _squares(
    joints: Float[Tensor, "S J 3"], bodies: Float[Tensor, "N J 3"], some: list[int], bones: list[int], relative: bool
) -> Float[Tensor, "S N"]:
    """Squared distances (m^2) of all frames from all moments; relative to the pelvis, of bodies turned to fit it."""
    if not relative:
        return torch.cdist(joints[:, some].flatten(1), bodies[:, some].flatten(1)).square()
    here, there = joints - joints[:, :1], bodies - bodies[:, :1]
    along, across = _products(here[:, bones], there[:, bones])
    size = (along.square() + across.square()).sqrt().clamp_min(1e-12)
    cos, sin = along / size, across / size
    here, there = here[:, some], there[:, some]
    along, across = _products(here, there)
    agreeing = cos * along + sin * across + here[..., 1] @ there[..., 1].T
    return here.square().sum((1, 2))[:, None] + there.square().sum((1, 2)) - 2 * agreeing


def _products(
    a: Float[Tensor, "S j 3"], b: Float[Tensor, "N j 3"]
) -> tuple[Float[Tensor, "S N"], Float[Tensor, "S N"]]:
    """Sums of products of horizontal vectors, and of their crosswise ones."""
    (ax, az), (bx, bz) = (v[..., ::2].unbind(-1) for v in (a, b))
    return ax @ bx.T + az @ bz.T, ax @ bz.T - az @ bx.T


def _way(costs: Float[Tensor, "S N"]) -> Int[Tensor, " S"]:
    """The cheapest way from the first moment to the last, each of whose steps is `_LEAST` to `_MOST` moments long."""
    total, choices = costs[0].clone(), []
    total[1:] = math.inf
    for row in costs[1:]:
        before = torch.nn.functional.pad(total, (_MOST, 0), value=math.inf).unfold(0, _MOST - _LEAST + 1, 1)
        best = before[: len(row)].min(-1)
        total = best.values + row
        choices.append(best.indices)
    at = costs.shape[1] - 1
    way = [at]
    for choice in reversed(choices):
        at -= _MOST - int(choice[at])
        way.append(at)
    return torch.tensor(way[::-1], device=costs.device)
