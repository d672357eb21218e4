"""Edits over time: eased shares, smoothed paths, quiet stretches played longer."""

from __future__ import annotations

import numpy as np
import torch
from jaxtyping import Float
from scipy.interpolate import CubicSpline
from scipy.ndimage import gaussian_filter1d
from torch import Tensor

from scenectl.data.features import to_uniform_skeleton


def smooth(values: Float[Tensor, "T *c"], sigma: float) -> Float[Tensor, "T *c"]:
    """Values smoothed over time by a Gaussian of `sigma` frames."""
    filtered = gaussian_filter1d(values.cpu().numpy(), sigma, axis=0, mode="nearest")
    return torch.as_tensor(filtered, dtype=values.dtype, device=values.device)


def lingered(joints: Float[Tensor, "T 22 3"], frames: int, start: float = 0.0) -> Float[Tensor, "N 22 3"]:
    """So many frames of a quiet stretch, played back and forth with soft turns; `start` is where it begins (0 to 1)."""
    last = len(joints) - 1
    wave = np.arange(-40, frames + 40) + start * last
    wave = last - np.abs(wave % (2 * last) - last)
    at = gaussian_filter1d(wave, min(6.0, last / 4))[40:-40]
    played = CubicSpline(np.arange(len(joints)), joints.cpu().numpy())(at)
    return to_uniform_skeleton(torch.as_tensor(played, dtype=joints.dtype, device=joints.device))


def minimum_jerk(share: Float[Tensor, "*b"]) -> Float[Tensor, "*b"]:
    """0 to 1, clamped, with the least jerk between."""
    share = share.clamp(0.0, 1.0)
    return share**3 * (share * (6 * share - 15) + 10)


def eased(share: Float[Tensor, "*b"]) -> Float[Tensor, "*b"]:
    """0 to 1, clamped, with soft ends."""
    share = share.clamp(0.0, 1.0)
    return share**2 * (3 - 2 * share)
