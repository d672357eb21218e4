"""What a finished model makes of held-out motion: codes it uses, errors by joint and by frequency."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

import torch
from jaxtyping import Float
from torch import Tensor

from scenectl.data.features import FPS, features_to_joints
from scenectl.generators.mscot.networks.tokenizer import Tokenizer
from scenectl.training.dataset import Windows
from scenes.errors import UserError
from scenes.motion.skeleton import HUMANML3D

BANDS = ((0.0, 1.0), (1.0, 2.0), (2.0, 4.0), (4.0, 10.0))
"""Hz, from the lower bound up to the upper: posture, gait, its harmonics, what is fast. The last ends at Nyquist."""

FINER = 3
"""Code use is judged at the scales beyond this one: coarser ones have few tokens to use codes with."""

_MOST = 2000
"""Clips looked at, at most: more change no figure that the card prints."""


def beginnings(data: Windows, frames: int, most: int = _MOST, seed: int = 0) -> Float[Tensor, "C T 263"]:
    """The first `frames` frames of every clip that is long enough, or of `most` of them drawn at random.

    Raises:
        UserError: no clip is long enough.
    """
    clips = (data.lengths >= frames).nonzero()[:, 0]
    if not len(clips):
        raise UserError(f"no clip of the data has {frames} frames to measure a model on; add longer ones")
    if len(clips) > most:
        clips = clips[torch.randperm(len(clips), generator=torch.Generator().manual_seed(seed))[:most]]
    return data.features[data.starts[clips][:, None] + torch.arange(frames)]


def overlapping(data: Windows, frames: int) -> Float[Tensor, "W T 263"]:
    """All windows of `frames` frames that overlap by half.

    Raises:
        UserError: no clip is long enough.
    """
    starts = [
        first + offset
        for first, length in zip(data.starts[:-1].tolist(), data.lengths.tolist(), strict=True)
        for offset in range(0, length - frames + 1, frames // 2)
    ]
    if not starts:
        raise UserError(f"no clip of the data has {frames} frames to measure a model on; add longer ones")
    return data.features[torch.tensor(starts)[:, None] + torch.arange(frames)]


@torch.no_grad()
def code_use(tokenizer: Tokenizer, features: Float[Tensor, "C T 263"]) -> list[dict[str, float]]:
    """How each scale uses its codes (Fig. 7).

    Returns:
        For every scale its number, the tokens it was counted over, the share of its V codes that occur, and the
        perplexity of their distribution (V where all are used alike, 1 where one is).
    """
    quantiser = tokenizer.eval().quantiser
    codes = quantiser.config.codes
    count = torch.zeros(quantiser.scales, codes)
    for part in features.split(64):
        for k, tokens in enumerate(tokenizer.encode(part)):
            count[k] += torch.bincount(tokens.flatten(), minlength=codes)
    share = count / count.sum(1, keepdim=True)
    entropy = -torch.special.xlogy(share, share).sum(1)
    return [
        {
            "scale": k + 1.0,
            "tokens": float(count[k].sum()),
            "share_used": float((count[k] > 0).float().mean()),
            "perplexity": math.exp(float(entropy[k])),
        }
        for k in range(quantiser.scales)
    ]


def least_use(use: Sequence[Mapping[str, float]], figure: str = "share_used") -> float:
    """The smallest figure of `code_use` among the scales beyond `FINER`, or at the last where there are no more."""
    return min(row[figure] for row in use[FINER:] or use[-1:])


@torch.no_grad()
def reconstructed(tokenizer: Tokenizer, features: Float[Tensor, "C T 263"]) -> tuple[Tensor, Tensor]:
    """Joints after a pass through the tokenizer, and the true ones, ``[C, T, 22, 3]`` metres; T a multiple of 4."""
    tokenizer.eval()
    got = torch.cat([tokenizer.decode(tokenizer.encode(part)) for part in features.split(64)])
    return features_to_joints(got), features_to_joints(features)


def error_by_joint(got: Float[Tensor, "C T 22 3"], true: Float[Tensor, "C T 22 3"]) -> dict[str, dict[str, float]]:
    """Mean distance (m) of every joint from where it should be, in the world and relative to the pelvis."""
    world = (got - true).norm(dim=-1).mean((0, 1))
    local = (_about_pelvis(got) - _about_pelvis(true)).norm(dim=-1).mean((0, 1))
    return {
        name: {"global_error_m": float(world[j]), "local_error_m": float(local[j])}
        for j, name in enumerate(HUMANML3D.names)
    }


def error_by_band(got: Float[Tensor, "C T 22 3"], true: Float[Tensor, "C T 22 3"]) -> list[dict[str, float]]:
    """How much each band of frequencies moves, and how much of it is wrong.

    Joints relative to the pelvis, about their mean over the clip.

    Returns:
        For every band its bounds (Hz), the root mean square of the true movement, of the reconstructed one and of
        their difference (m), over joints, frames and clips.
    """
    moves = {"true": _about_pelvis(true), "reconstructed": _about_pelvis(got)}
    moves["error"] = moves["reconstructed"] - moves["true"]
    found = {name: band_rms(move) for name, move in moves.items()}
    return [
        {"low_hz": low, "high_hz": high, **{f"{name}_rms_m": values[i] for name, values in found.items()}}
        for i, (low, high) in enumerate(BANDS)
    ]


def band_rms(x: Float[Tensor, "C T J 3"], fps: float = FPS) -> list[float]:
    """Root mean square of trajectories in each of `BANDS`, about their mean over time (Hann window)."""
    frames = x.shape[1]
    window = torch.hann_window(frames, dtype=x.dtype)
    spectrum = torch.fft.rfft((x - x.mean(1, keepdim=True)) * window[:, None, None], dim=1)
    # Scaled so that all frequencies together have the mean square of a stationary signal; one side stands for both.
    power = 2 * spectrum.abs().square().sum(-1).mean((0, 2)) / (frames * window.square().sum())
    hertz = torch.fft.rfftfreq(frames, 1 / fps)
    inside = [(hertz >= low) & (hertz < high) for low, high in BANDS]
    inside[-1] |= hertz >= BANDS[-1][1]
    return [math.sqrt(float(power[mask].sum())) for mask in inside]


def measure_tokenizer(tokenizer: Tokenizer, train: Windows, test: Windows, frames: int = 64) -> dict[str, Any]:
    """Everything above, over the first `frames` frames of the clips of both splits."""
    held_out = beginnings(test, frames)
    got, true = reconstructed(tokenizer, held_out)
    return {
        "clips": len(held_out),
        "code_use": {
            "train": code_use(tokenizer, overlapping(train, frames)),
            "test": code_use(tokenizer, held_out),
        },
        "error_by_joint": error_by_joint(got, true),
        "error_by_band": error_by_band(got, true),
    }


def _about_pelvis(joints: Tensor) -> Tensor:
    return joints - joints[..., :1, :]
