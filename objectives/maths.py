"""Small differentiable pieces that several goals share."""

from __future__ import annotations

import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor

from scenes.errors import UserError
from scenes.motion.motion import Motion
from scenes.motion.skeleton import Skeleton


def root(square: Float[Tensor, "*s"]) -> Float[Tensor, "*s"]:
    """Square root with a zero subgradient at 0, and at what rounds to it, where autograd's own is infinite."""
    positive = square > torch.finfo(square.dtype).tiny
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


def softened(vectors: Float[Tensor, "*s 3"], near: float) -> tuple[Float[Tensor, "*s 3"], Float[Tensor, "*s"]]:
    """Unit vectors, and their lengths: 1, but less for vectors shorter than `near`, and 0 for those of no length.

    So what has hardly a direction has none, and its gradient stays below 2 / near.
    """
    norm = length(vectors)
    share = norm / near
    short = share < 1
    factor = torch.where(short, (2 - share) / near, 1 / torch.where(short, 1.0, norm))
    return vectors * factor[..., None], torch.where(short, share * (2 - share), 1.0)


def angle_between(
    a: Float[Tensor, "*s 3"], b: Float[Tensor, "*s 3"], near_a: float, near_b: float
) -> Float[Tensor, "*s"]:
    """Angle (rad, 0 to pi) between vectors, which tends to a right angle as one gets shorter than its `near`.

    Its gradient vanishes nowhere but at 0: opposed vectors turn about the vertical.
    """
    (a, size_a), (b, size_b) = softened(a, near_a), softened(b, near_b)
    cosine, normal = (a * b).sum(-1), torch.linalg.cross(a, b)
    side = torch.linalg.cross(torch.linalg.cross(b.detach(), b.new_tensor([0.0, 1.0, 1e-3]).expand_as(b)), b.detach())
    sine = root(normal.square().sum(-1) + 1 - (size_a * size_b).square())
    opposed = (cosine < 0) & (sine < 1e-6)
    about = side / length(side)[..., None].clamp_min(1e-12)
    turned = torch.where(opposed, (normal * about).sum(-1), 0.0), torch.where(opposed, cosine, 1.0)
    return torch.where(opposed, torch.atan2(*turned).abs(), torch.atan2(sine, cosine))


def keyed(
    values: Float[Tensor, "K *v"], at: list[float], motion: Motion
) -> tuple[Float[Tensor, "T *v"], Bool[Tensor, "*b T"]]:
    """A value at the frame nearest to each time (s), and which frames have one; raises UserError for two on one."""
    frames = frames_near(motion, at)
    inside = [f for f in frames if f is not None]
    if len(set(inside)) < len(inside):
        raise UserError(f"two of the times {at} fall on the same frame; keep them {1 / motion.fps:g} s apart")
    spread, mask = values.new_zeros(motion.frames, *values.shape[1:]), torch.zeros_like(motion.valid)
    for frame, value in zip(frames, values, strict=True):
        if frame is not None:
            spread[frame] = value
            mask |= frame_mask(motion, frame)
    return spread, mask


def pelvis_bones(skeleton: Skeleton) -> list[int]:
    """Joints that hang on the root: the hips and the lower spine, which turn with the pelvis as one piece."""
    return [joint for joint, parent in enumerate(skeleton.parents) if parent == 0]


def pelvis_heading(
    bodies: Float[Tensor, "*b J 3"], others: Float[Tensor, "*c J 3"], skeleton: Skeleton
) -> Float[Tensor, "*d 2"]:
    """Cosine and sine of the turn about +y that brings the pelvis of bodies nearest to that of others.

    The least-squares turn of hips and spine. It is smooth, and defined however the pelvis lies, as long as not one of
    the two is upside down beside the other.
    """
    bones = pelvis_bones(skeleton)
    (ax, az), (bx, bz) = ((b[..., bones, :] - b[..., :1, :])[..., ::2].unbind(-1) for b in (bodies, others))
    turn = torch.stack([(bx * ax + bz * az).sum(-1), (bx * az - bz * ax).sum(-1)], dim=-1)
    return turn / (turn.square().sum(-1, keepdim=True) + 1e-16).sqrt()
