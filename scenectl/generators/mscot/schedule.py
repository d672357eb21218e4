"""How many tokens each scale has for a motion of any length (Eq. 7)."""

from __future__ import annotations

from scenes.errors import UserError

DOWNSAMPLING = 4
"""Frames behind one token of the finest scale."""

MIN_FRAMES, MAX_FRAMES = 36, 196
"""Lengths the shipped models are trained for; the schedule itself has no upper limit."""


def scale_lengths(base: tuple[int, ...], finest: int) -> tuple[int, ...]:
    """Tokens at each scale, ``ceil(rho L_k)`` with ``rho = finest / L_K``; never decreasing, the last is `finest`.

    Raises:
        UserError: `finest` is not positive.
    """
    if finest < 1:
        raise UserError(f"a motion needs at least one token at its finest scale, not {finest}")
    return tuple(-(-finest * length // base[-1]) for length in base)


def tokens_for(frames: int) -> int:
    """Tokens at the finest scale that cover a number of frames."""
    return -(-frames // DOWNSAMPLING)
