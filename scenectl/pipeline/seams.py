"""Seams between frames that are kept and frames that were made: no jump of place or speed is left."""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from scenes.motion.motion import Motion

BESIDE = 12
"""Kept frames beside each seam that refinement fits: those further off are put back as they were anyway."""
SETTLE = 20
"""Frames made anew over which a seam's remaining jump dies away, where there are as many."""


def settled(original: Motion, made: Motion, regenerate: Bool[Tensor, " T"], frames: int = SETTLE) -> Motion:
    """The original where it is kept, and what was made elsewhere, without a jump of position or velocity between.

    At each seam, the difference of position and velocity on the kept side decays along a cubic over the frames made
    anew, to nothing before the next seam (inertialisation, as in games).

    Args:
        original: ``[T, J, 3]``, or one for each of those made.
        made: ``[*b, T, J, 3]``.
        regenerate: which frames of `made` count.
        frames: over which a jump dies away, where there are as many.
    """
    offset = original.joints - made.joints
    carried = _carrying(tuple(regenerate.tolist()), frames).to(offset) @ offset.flatten(-2)
    return replace(made, joints=made.joints + carried.unflatten(-1, offset.shape[-2:]))


@lru_cache(maxsize=16)  # of the windows in use: chains of motions meet new lengths for ever
def _carrying(regenerate: tuple[bool, ...], frames: int) -> Float[Tensor, "T T"]:
    """How much of the difference at every frame is added at every other: all of it where a motion is kept."""
    mask = torch.tensor(regenerate)
    carry = torch.diag((~mask).double())
    for seam, toward, room in _seams(mask):
        length = min(frames, room)
        past = seam - toward  # the kept frame before last, where there is one
        inside = 0 <= past < len(mask) and not regenerate[past]
        for i in range(1, length + 1):
            u = i / (length + 1)
            value, slope = 2 * u**3 - 3 * u**2 + 1, (u**3 - 2 * u**2 + u) * (length + 1)
            carry[seam + toward * i, seam] += value + (slope if inside else 0.0)
            if inside:
                carry[seam + toward * i, past] -= slope
    return carry


def _seams(regenerate: Bool[Tensor, " T"]) -> list[tuple[int, int, int]]:
    """Of every seam: its last kept frame, the direction of the frames made anew (1 or -1), and how many they are."""
    mask, out = regenerate.tolist(), []
    for t in range(len(mask) - 1):
        if mask[t] != mask[t + 1]:
            toward = 1 if mask[t + 1] else -1
            seam, room = (t if toward == 1 else t + 1), 0
            while 0 <= seam + toward * (room + 1) < len(mask) and mask[seam + toward * (room + 1)]:
                room += 1
            out.append((seam, toward, room))
    return out
