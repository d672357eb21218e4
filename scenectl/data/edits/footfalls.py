"""Walks taken to other places footfall by footfall: where feet stood they stand, somewhere else, and swings follow.

Joint positions in the canonical frame, metres.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import torch
from jaxtyping import Float
from scipy.interpolate import PchipInterpolator
from torch import Tensor

from scenectl.data.corpus import Clip
from scenectl.data.edits.limbs import ARMS, LEGS, NECK, with_legs
from scenectl.data.edits.timing import smooth
from scenectl.data.features import FPS, to_uniform_skeleton
from scenes.motion.skeleton import HUMANML3D

STILL = 0.45
"""m/s over the ground below which the ball of a foot counts as standing: between what feet do while they stand (median
0.1 in the recorded walks) and while they swing (2 and more)."""
SHORTEST = 3
"""Frames that a footfall lasts at least."""


UPRIGHT = 0.4
"""Metres from the pelvis up to the neck, 0.55 in a straight trunk, below which a person bends down."""
ANKLE = 0.047
"""Metres from the ball of a flat foot up to the ankle (`scenes.body.body`)."""


@dataclass(frozen=True)
class Fall:
    """One foot standing: side (0 left, 1 right) and frames, up to and without `end`."""

    side: int
    begin: int
    end: int


def footfalls(joints: Float[Tensor, "T 22 3"]) -> list[Fall]:
    """When each foot stands, in the order in which they are put down."""
    found = []
    for side, leg in enumerate(LEGS):
        ball = joints[:, leg[3]]
        speed = ball[:, [0, 2]].diff(dim=0).norm(dim=-1) * FPS
        still = (speed < STILL).cpu().numpy()
        edges = np.flatnonzero(np.diff(np.r_[False, still, False].astype(int)))
        for begin, end in zip(edges[::2], edges[1::2], strict=True):
            if end + 1 - begin >= SHORTEST:
                found.append(Fall(side, int(begin), int(end) + 1))
    return sorted(found, key=lambda fall: (fall.begin, fall.end))


def walk_of(clip: Clip, slower: float, most: int) -> tuple[Clip, list[Fall]] | None:
    """The part of a clip between its first and last stand on both feet, slowed down, and its footfalls.

    None where feet are not put down in turn, left and right, one standing before the other leaves, or the trunk bends
    low.

    Args:
        slower: times as long.
        most: footfalls that are kept, from the first.
    """
    rise = clip.joints[:, NECK, 1] - clip.joints[:, 0, 1]
    falls = footfalls(clip.joints)[:most] if float(rise.min()) > UPRIGHT else []
    if len(falls) < 4 or any(a.side == b.side or b.begin >= a.end for a, b in zip(falls, falls[1:], strict=False)):
        return None
    first, last = falls[1].begin, falls[-2].end
    frames = round((last - first - 1) * slower) + 1
    at = np.linspace(first, last - 1, frames)
    # Monotone between frames, so that a foot that stands does not swing about its place.
    joints = PchipInterpolator(np.arange(clip.frames), clip.joints.cpu().numpy())(at)
    between = torch.as_tensor(joints, dtype=torch.float32, device=clip.joints.device)
    joints = to_uniform_skeleton(between)
    balls = [ball for *_, ball in LEGS]
    joints = with_legs(joints, joints.new_zeros(frames, 3), between[:, balls] - joints[:, balls])

    def moved(frame: int) -> int:
        return min(max(round((frame - first) * slower), 0), frames)

    kept = [Fall(fall.side, moved(fall.begin), moved(fall.end)) for fall in falls]
    return replace(clip, joints=joints, acts=()), kept


def places(joints: Float[Tensor, "T 22 3"], falls: Sequence[Fall]) -> Float[Tensor, "N 3"]:
    """Where the ball of the foot is in the middle of each footfall."""
    return torch.stack([joints[(fall.begin + fall.end - 1) // 2, LEGS[fall.side][3]] for fall in falls])


def feet_shift(
    joints: Float[Tensor, "T 22 3"], falls: Sequence[Fall], shifts: Float[Tensor, "N 3"]
) -> Float[Tensor, "T 2 3"]:
    """How far each foot is moved in each frame when its footfalls are moved so far.

    Swings are led from one footfall to the next by the share of the way over the ground that they have done, so that
    they keep their timing.
    """
    out = joints.new_zeros(len(joints), 2, 3)
    for side, leg in enumerate(LEGS):
        own = [i for i, fall in enumerate(falls) if fall.side == side]
        out[:, side] = shifts[own[0]]
        for i, j in zip(own[:-1], own[1:], strict=True):
            leave, land = falls[i].end - 1, falls[j].begin
            steps = joints[leave : land + 1, leg[3]][:, [0, 2]].diff(dim=0).norm(dim=-1)
            done = torch.cat([steps.new_zeros(1), steps.cumsum(0)]) / steps.sum().clamp_min(1e-6)
            out[leave : land + 1, side] = torch.lerp(shifts[i], shifts[j], done[:, None])
            out[land:, side] = shifts[j]
    return out


def flattened(joints: Float[Tensor, "T 22 3"], share: float) -> Float[Tensor, "T 22 3"]:
    """Heels lowered (and raised toes let down) by a share of what the soles are tilted, over the same balls of feet."""
    joints = joints.clone()
    for _, _, ankle, ball in LEGS:
        length = float(HUMANML3D.bone_lengths[ball])
        heel = joints[:, ankle] - joints[:, ball]
        # A foot that hangs straight down does not say where its heel points; the same foot before and after does.
        level = smooth(heel * heel.new_tensor([1.0, 0.0, 1.0]), 8.0)
        level = level / level.norm(dim=-1, keepdim=True).clamp_min(1e-6) * (length**2 - ANKLE**2) ** 0.5
        flat = level + heel.new_tensor([0.0, ANKLE, 0.0])
        heel = torch.lerp(heel, flat, share)
        joints[:, ankle] = joints[:, ball] + heel * (length / heel.norm(dim=-1, keepdim=True))
    return joints


def calmed(joints: Float[Tensor, "T 22 3"], share: float) -> Float[Tensor, "T 22 3"]:
    """Arms that swing by a share less about how they are held over the time of a stride."""
    joints = joints.clone()
    for arm in ARMS.values():
        at = joints[:, arm[0]]
        bones = joints[:, arm[1:]] - joints[:, arm[:2]]
        calm = torch.lerp(bones, smooth(bones, 10.0), share)
        calm = calm * (bones.norm(dim=-1, keepdim=True) / calm.norm(dim=-1, keepdim=True).clamp_min(1e-6))
        joints[:, arm[1]] = at + calm[:, 0]
        joints[:, arm[2]] = at + calm.sum(1)
    return joints
