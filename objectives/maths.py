"""Small differentiable pieces that several goals share."""

from __future__ import annotations

import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor

from scenes.motion.motion import Motion


def root(square: Float[Tensor, "*s"]) -> Float[Tensor, "*s"]:
    """Square root with a zero subgradient at 0, where autograd's own is infinite."""
    positive = square > 0
    return torch.where(positive, torch.where(positive, square, 1.0).sqrt(), 0.0)


def length(vectors: Float[Tensor, "*s d"]) -> Float[Tensor, "*s"]:
    """Euclidean length along the last axis, with a zero subgradient at the origin."""
    return root(vectors.square().sum(-1))


def beyond(vectors: Float[Tensor, "*s d"], slack: float) -> Float[Tensor, "*s d"]:
    """The vectors shortened by `slack`, zero where they are shorter than it."""
    norm = length(vectors)
    outside = norm > slack
    factor = torch.where(outside, 1 - slack / torch.where(outside, norm, 1.0), 0.0)
    return vectors * factor[..., None]


def frames_near(motion: Motion, at: list[float]) -> list[int | None]:
    """Frame nearest to each time (s, task clock); None where the time lies outside this motion.

    Outside is no error here: a generator that works window by window meets goals stated for other
    windows. `Objective.check` is what catches a time that lies outside the whole task.
    """
    found: list[int | None] = []
    for seconds in at:
        position = (seconds - motion.t0) * motion.fps
        frame = min(round(position), motion.frames - 1) if position <= motion.frames + 1e-6 else motion.frames
        found.append(frame if 0 <= frame < motion.frames else None)
    return found


def frame_mask(motion: Motion, frame: int | None) -> Bool[Tensor, "*b T"]:
    """True at one frame of every sample, nowhere for None."""
    mask = torch.zeros_like(motion.valid)
    if frame is not None:
        mask[..., frame] = True
    return mask


def within(motion: Motion, window: tuple[float, float]) -> Bool[Tensor, " T"]:
    """Frames whose time lies in `window` (s, task clock), ends included to a thousandth of a frame."""
    slack = 1e-3 / motion.fps
    return (motion.times >= window[0] - slack) & (motion.times <= window[1] + slack)


def first_middle_last(motion: Motion) -> Bool[Tensor, "*b T 3"]:
    """Frames 0, L // 2 and L - 1 of every sample's L valid frames (ProgMoGen's keyframes)."""
    count = motion.valid.sum(-1)
    first = motion.valid.long().argmax(-1)
    keys: Int[Tensor, "*b 3"] = torch.stack([first, first + count // 2, first + count - 1], dim=-1)
    frames = torch.arange(motion.frames, device=motion.valid.device)
    return (frames[:, None] == keys[..., None, :]) & motion.valid[..., None]
