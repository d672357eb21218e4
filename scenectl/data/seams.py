"""Where one stretch of motion goes on as another: how alike frames are, how pieces are laid one after the other.

Poses and velocities are seen from the body, as in a motion graph (Kovar et al. 2002), so that place and facing do not
count.
"""

from __future__ import annotations

import numpy as np
import torch
from jaxtyping import Float
from scipy.ndimage import minimum_filter1d
from torch import Tensor

from scenectl.data.edits.limbs import with_legs
from scenectl.data.edits.timing import minimum_jerk
from scenectl.data.features import to_uniform_skeleton
from scenes.motion.headings import turned
from scenes.motion.skeleton import FEET, HUMANML3D

HALF = 4
"""Frames on either side of a seam over which two pieces are blended: 0.4 s in all."""
NEAR = 5
"""Frames on either side of a seam that count as at the seam: 0.25 s."""
STANCE = (0.015, 0.06)
"""A foot stands that moves less than this in a frame (m), and is less than this over its floor (m)."""
SLIDING = (0.025, 0.05)
"""A foot slides that moves by more than this in a frame (m), less than this over the floor (m), as in GMD's skating."""
SETTLE = 8
"""Frames before and after a stance in which what a planted foot was moved by comes in and dies out."""
_FEET = HUMANML3D.indices(FEET)


def seen_from_body(
    joints: Float[Tensor, "T 22 3"], heading: Float[Tensor, " T"]
) -> tuple[Float[Tensor, "T 22 3"], Float[Tensor, "T-1 22 3"]]:
    """Poses over the point below the pelvis, and steps to the next frame (m), turned back by the headings."""
    ground = joints[:, :1] * joints.new_tensor([1.0, 0.0, 1.0])
    return turned(joints - ground, -heading[:, None]), turned(joints.diff(dim=0), -heading[:-1, None])


def floors(joints: Float[Tensor, "T 22 3"]) -> Float[np.ndarray, " T"]:
    """Height (m) on which the feet stand around each frame: the lowest of them within half a second."""
    lowest: np.ndarray = minimum_filter1d(joints[:, _FEET, 1].amin(-1).numpy(), 21, mode="nearest")
    return lowest


def laid(piece: Float[Tensor, "N 22 3"], onto: Float[Tensor, "W 22 3"], rise: float) -> Float[Tensor, "N 22 3"]:
    """The piece turned about the vertical and moved so that its first W frames lie best on others, `rise` m higher."""
    a, b = (torch.complex(x[..., 2], x[..., 0]).flatten() for x in (onto, piece[: len(onto)]))
    turn = torch.angle(((b - b.mean()).conj() * (a - a.mean())).sum())
    out = turned(piece, turn)
    shift = (onto - out[: len(onto)]).mean((0, 1))
    shift[1] = rise
    return out + shift


def blended(a: Float[Tensor, "W 22 3"], b: Float[Tensor, "W 22 3"]) -> Float[Tensor, "W 22 3"]:
    """From all of `a` to all of `b`; directions of bones are blended, their lengths stay."""
    share = minimum_jerk(torch.linspace(0, 1, len(a)))[:, None, None]
    return to_uniform_skeleton(torch.lerp(a, b, share))


def standing(joints: Float[Tensor, "T 22 3"], floor: Float[np.ndarray, " T"]) -> np.ndarray:
    """Which feet stand in which frames, ``[T, 2]``."""
    feet = joints[:, _FEET].numpy()
    step = np.linalg.norm(np.diff(feet, axis=0), axis=-1)
    slow = np.maximum(np.r_[step[:1], step], np.r_[step, step[-1:]]) < STANCE[0]
    low: np.ndarray = slow & (feet[..., 1] - floor[:, None] < STANCE[1])
    return low


def planted(joints: Float[Tensor, "T 22 3"], stands: np.ndarray, seams: list[int]) -> Float[Tensor, "T 22 3"]:
    """The motion with feet that stand through a blend held where they stood before it, or will after it.

    Args:
        joints: blended at the seams.
        stands: which feet stand when, ``[T, 2]``.
        seams: middle frame of each blend.
    """
    shift = np.zeros((len(joints), 2, 3), np.float32)
    where = joints[:, _FEET].numpy() * np.array([1, 0, 1], np.float32)
    for seam in seams:
        for foot in range(2):
            for run in _runs(stands[:, foot], seam - HALF, seam + HALF):
                shift[:, foot] += _held(where[:, foot] + shift[:, foot], run, (seam - HALF, seam + HALF))
    if not shift.any():
        return joints
    still, zero = joints.new_zeros(len(joints), 3), joints.new_zeros(len(joints), 2, 3)
    # Knees are solved twice: what the solver alone changes would show as a jolt where no foot was moved.
    moved = with_legs(joints, still, torch.from_numpy(shift)) - with_legs(joints, still, zero)
    return to_uniform_skeleton(joints + moved)


def _runs(flags: np.ndarray, first: int, last: int) -> list[tuple[int, int]]:
    """Beginnings and ends of the runs of true flags that reach into ``first .. last``."""
    edges = np.flatnonzero(np.diff(np.r_[0, flags.astype(np.int8), 0])).reshape(-1, 2)
    return [(int(a), int(b)) for a, b in edges if a <= last and b > first]


def _held(where: np.ndarray, run: tuple[int, int], window: tuple[int, int]) -> np.ndarray:
    """Shift of a foot, ``[T, 3]``, that keeps it in one place while it stands within the window."""
    begin, end = max(run[0], window[0]), min(run[1] - 1, window[1])
    anchor = where[begin] if run[0] <= window[0] else where[end]
    shift = np.zeros_like(where)
    shift[begin : end + 1] = anchor - where[begin : end + 1]
    shift[end : run[1]] = shift[end]
    fade = 1 - np.arange(1, SETTLE + 1, dtype=np.float32)[:, None] / (SETTLE + 1)
    fade = fade * fade * (3 - 2 * fade)
    after, before = shift[run[1] : run[1] + SETTLE], shift[max(0, begin - SETTLE) : begin]
    after += fade[: len(after)] * shift[run[1] - 1]
    before += fade[: len(before)][::-1] * shift[begin]
    return shift


def sliding(joints: Float[Tensor, "T 22 3"]) -> np.ndarray:
    """In which frames a foot slides over the floor, which is the lowest that it comes, ``[T]``."""
    feet = joints[:, _FEET].numpy()
    low = feet[..., 1] - feet[..., 1].min() < SLIDING[1]
    fast = np.linalg.norm(np.diff(feet[..., [0, 2]], axis=0), axis=-1) > SLIDING[0]
    slides: np.ndarray = np.r_[(fast & low[1:] & low[:-1]).any(-1), False]
    return slides


def accelerations(joints: Float[Tensor, "T 22 3"]) -> Float[np.ndarray, " T"]:
    """Largest acceleration of a joint in each frame (m/frame^2); first and last as their neighbours."""
    inner = joints.diff(n=2, dim=0).norm(dim=-1).amax(-1).numpy()
    return np.r_[inner[:1], inner, inner[-1:]]


def seam_ratio(joints: Float[Tensor, "T 22 3"], seams: list[int]) -> float:
    """Largest acceleration of a joint within 0.25 s of a seam over its 99th percentile elsewhere."""
    sizes = accelerations(joints)
    near = np.zeros(len(sizes), bool)
    for seam in seams:
        near[max(0, seam - NEAR) : seam + NEAR + 1] = True
    if near.all() or not near.any():
        return 0.0
    return float(sizes[near].max() / max(float(np.percentile(sizes[~near], 99)), 1e-6))
