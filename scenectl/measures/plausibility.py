"""Is it a motion a body can make? Figures that need no goal, no text and no evaluator, for canonical motions.

Each is worth as much as the same figure on real motions: put both side by side. Skating, acceleration, and bone drift
are in `scenectl.measures.metrics`.
"""

from __future__ import annotations

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from objectives import Context
from objectives.library.natural import joint_limits
from scenectl.measures.metrics import bone_length_drift, max_acceleration, skating_ratio
from scenes.body.body import DEFAULT_BODY, ProxyBody
from scenes.motion.bones import standing_pose
from scenes.motion.motion import Motion
from scenes.motion.skeleton import FEET
from scenes.world.scene import Scene

AIRBORNE = 0.1
"""Height (m) of both feet over their lowest from which on a person is in the air."""
FLIGHT = 0.7
"""Seconds in the air that no jump on level ground lasts: a flight of 0.7 s rises 60 cm."""
NEIGHBOURLY = 0.03
"""Gap (m) at rest below which two parts of the body are neighbours and may touch."""

FIGURES = (
    "skating_ratio",
    "max_acceleration_m_per_frame2",
    "acceleration_m_per_s2",
    "jerk_m_per_s3",
    "floating_share",
    "floor_penetration_m",
    "bone_length_drift_m",
    "joint_limit_share",
    "self_penetration_m",
)


def plausibility(motion: Motion, body: ProxyBody = DEFAULT_BODY) -> dict[str, Float[Tensor, "*b"]]:
    """All figures of canonical motions ``[*b, T, 22, 3]``, by name (`FIGURES`): metres, seconds, shares of frames."""
    return {
        "skating_ratio": skating_ratio(motion),
        "max_acceleration_m_per_frame2": max_acceleration(motion),
        "acceleration_m_per_s2": acceleration(motion),
        "jerk_m_per_s3": jerk(motion),
        "floating_share": floating_share(motion),
        "floor_penetration_m": floor_penetration(motion),
        "bone_length_drift_m": bone_length_drift(motion),
        "joint_limit_share": joint_limit_share(motion),
        "self_penetration_m": self_penetration(motion, body),
    }


def acceleration(motion: Motion) -> Float[Tensor, "*b"]:
    """Mean size of the second derivative of joint positions (m/s^2) over joints and valid frames."""
    return _mean_derivative(motion, 2)


def jerk(motion: Motion) -> Float[Tensor, "*b"]:
    """Mean size of the third derivative of joint positions (m/s^3) over joints and valid frames."""
    return _mean_derivative(motion, 3)


def _mean_derivative(motion: Motion, order: int) -> Float[Tensor, "*b"]:
    size = motion.joints.diff(n=order, dim=-3).norm(dim=-1).mean(-1) * motion.fps**order
    real = motion.valid.unfold(-1, order + 1, 1).all(-1)
    return (size * real).sum(-1) / real.sum(-1).clamp_min(1)


def floor_penetration(motion: Motion) -> Float[Tensor, "*b"]:
    """How far (m) the lowest joint goes below the canonical frame's y = 0 in any valid frame."""
    depth = (-motion.joints[..., 1].amin(-1)).clamp_min(0.0)
    return (depth * motion.valid).amax(-1)


def floating_share(motion: Motion) -> Float[Tensor, "*b"]:
    """Share of valid frames in which both feet have been in the air for longer than any jump lasts."""
    feet = motion.select(FEET)[..., 1].amin(-1)
    lowest = torch.where(motion.valid, feet, torch.inf).amin(-1, keepdim=True)
    up = (feet - lowest > AIRBORNE) & motion.valid
    return _in_long_runs(up, round(FLIGHT * motion.fps)).sum(-1) / motion.valid.sum(-1).clamp_min(1)


def _in_long_runs(flags: Bool[Tensor, "*b T"], longest: int) -> Bool[Tensor, "*b T"]:
    """Which flags belong to a run of more than `longest`."""
    if flags.shape[-1] <= longest:
        return torch.zeros_like(flags)
    runs = flags.unfold(-1, longest + 1, 1).all(-1)
    padded = torch.nn.functional.pad(runs, (longest, longest))
    return padded.unfold(-1, longest + 1, 1).any(-1)


def joint_limit_share(motion: Motion) -> Float[Tensor, "*b"]:
    """Share of valid frames in which a knee or an elbow is bent further, or further backwards, than joints go."""
    wrong = (joint_limits(motion, Context(Scene.empty(), DEFAULT_BODY)).residual > 0).any(-1)
    return (wrong & motion.valid).sum(-1) / motion.valid.sum(-1).clamp_min(1)


def self_penetration(motion: Motion, body: ProxyBody = DEFAULT_BODY) -> Float[Tensor, "*b"]:
    """Deepest overlap (m) of parts of the proxy body with one another, averaged over valid frames.

    Parts that are nearly in touch in the skeleton's rest pose (neighbours, mostly) are left out.
    """
    points, radii = body.points(motion)
    depth = (radii[:, None] + radii - torch.cdist(points, points)).clamp_min(0.0)
    deepest = (depth * _apart(body)).amax((-2, -1))
    return (deepest * motion.valid).sum(-1) / motion.valid.sum(-1).clamp_min(1)


def _apart(body: ProxyBody) -> Bool[Tensor, "M M"]:
    """Pairs of the body's samples that are well apart in people who stand."""
    rest = standing_pose(body.skeleton).float()
    points, radii = body.points_of(rest), body.radii()
    return torch.cdist(points, points) > radii[:, None] + radii + NEIGHBOURLY
