"""Holding still as people do: a short rest held for longer by going back and forth through it."""

from __future__ import annotations

import random

import numpy as np
import torch
from jaxtyping import Float
from scipy.interpolate import CubicSpline
from scipy.ndimage import gaussian_filter1d
from torch import Tensor

from scenectl.data.edits.limbs import axes, pitched, with_legs
from scenectl.data.features import FPS, to_uniform_skeleton
from scenectl.data.found.traits import ANKLES

SWAY, NOD = 0.007, 0.6
"""Standard deviations of what is added to a body that stands: of the pelvis over the floor (m) and of the trunk's
lean (degrees). Pelves of the collection's quiet stretches of two seconds and more deviate by 4 to 24 mm
(5th and 95th percentiles)."""
SEATED_NOD = 1.5
"""The trunk's lean of a body that sits, whose pelvis stays: heads of the collection's people on seats deviate by 16 to
72 mm, and this alone makes about 10."""
_SLOW, _SMOOTH = 16.0, 3.0
"""Widths in frames of the Gaussians that shape this sway, and round off reversals."""
_SETTLE = 10
"""Frames in which feet come to stand where they stay."""


def held(
    joints: Float[Tensor, "T 22 3"], frames: int, draw: random.Random, lead: int = 0, sway: float = 1.0
) -> Float[Tensor, "F 22 3"]:
    """The motion up to frame `lead`, and from there on back and forth through the rest, which is a rest indeed.

    No two frames are the same: reversals happen at other places and in another time, and the body sways a little by
    itself. Feet stand where they stood in the mean.

    Args:
        joints: a motion that ends at rest.
        frames: of the result.
        draw: chance.
        lead: first frame of the rest, which lasts for at least `SHORTEST_REST` frames.
        sway: how much of the body's own sway is added; none of the pelvis' where someone sits (0).
    """
    at = _path(len(joints) - lead, frames - lead, draw)
    at = np.r_[np.arange(lead), lead + at]
    poses = CubicSpline(np.arange(len(joints)), joints.double().numpy(), axis=0)(at)
    out = to_uniform_skeleton(torch.from_numpy(poses).to(joints))
    out = out + (joints[0, 0] - out[0, 0])
    share = torch.from_numpy(np.clip((np.arange(frames) - lead) / _SETTLE, 0.0, 1.0)).to(joints)
    share = torch.ones_like(share) if lead == 0 else share * share * (3 - 2 * share)
    still = joints[lead:, ANKLES].mean(0) - out[:, ANKLES]
    noise = _noise(frames, draw).to(joints) * share[:, None]
    left, _ = axes(out)
    out = pitched(out, left, noise[:, 2] * float(np.radians(NOD if sway else SEATED_NOD)))
    body = torch.stack([noise[:, 0], torch.zeros_like(share), noise[:, 1]], dim=-1) * SWAY * sway
    return to_uniform_skeleton(with_legs(out, body, still * share[:, None, None]))  # legs at full stretch gain a few mm


CALM = 0.6
"""Fastest joint (m/s) of a rest; someone whose trunk still comes up from a lean would rock."""
SHORTEST_REST = 14
"""Frames of a rest at least; less cannot be gone back and forth through without a tremble."""


def lasting(
    joints: Float[Tensor, "T 22 3"],
    rest: int,
    more: int,
    draw: random.Random,
    *,
    first: bool = False,
    sway: float = 1.0,
) -> Float[Tensor, "F 22 3"]:
    """The motion with the rest of `rest` frames at its end (or `first`, at its beginning) held `more` frames longer.

    What is still on its way to the rest is no part of it; a motion whose rest is too short is returned as it is.
    """
    moving = joints.flip(0) if first else joints
    hasty = (moving.diff(dim=0).norm(dim=-1).amax(1) * FPS > CALM).nonzero().flatten().tolist()
    rest = min(rest, len(joints) - 1 - (hasty[-1] if hasty else -1))
    if rest < SHORTEST_REST or not more:
        return joints
    moving = held(moving, len(joints) + more, draw, lead=len(joints) - rest, sway=sway)
    return moving.flip(0) if first else moving


def _path(rest: int, frames: int, draw: random.Random) -> Float[np.ndarray, " F"]:
    """Places in the rest, one a frame, within 0 and ``rest - 1``: on at full speed, then back, on, back, slower."""
    turns = [0.0]
    speeds: list[float] = []
    while len(speeds) < frames + 4 * _SMOOTH:
        far = (rest - 1) * (draw.uniform(0.75, 1.0) if len(turns) % 2 else draw.uniform(0.0, 0.25))
        pace = 1.0 if len(turns) == 1 else draw.uniform(0.6, 1.0)
        steps = max(1, round(abs(far - turns[-1]) / pace))
        speeds += [(far - turns[-1]) / steps] * steps
        turns.append(far)
    smooth = gaussian_filter1d(np.array(speeds), _SMOOTH, mode="nearest")
    return np.clip(np.cumsum(np.r_[0.0, smooth])[:frames], 0.0, rest - 1)


def _noise(frames: int, draw: random.Random) -> Float[Tensor, "F 3"]:
    white = np.random.default_rng(draw.getrandbits(32)).standard_normal((frames + 6 * int(_SLOW), 3))
    slow = gaussian_filter1d(white, _SLOW, axis=0)[3 * int(_SLOW) : -3 * int(_SLOW)]
    return torch.from_numpy(slow * np.sqrt(2 * np.sqrt(np.pi) * _SLOW))  # of deviation 1
