"""Frames a second: how one rate is made of another."""

from __future__ import annotations

_SLACK = 0.005
"""59.94 is taken as 60 frames a second: at 20 fps that is 1 ms in a second."""


def stride_of(rate: float, fps: float) -> int | None:
    """Every how many frames of one rate is a frame of the other; None where that is no whole number."""
    stride = max(round(rate / fps), 1)
    return stride if abs(rate / fps / stride - 1) < _SLACK else None


def told(rate: float, fps: float) -> str:
    """In words, what `Motion.resampled` does: "120 fps, every 6th frame kept"."""
    stride = stride_of(rate, fps)
    if stride is None:
        return f"{rate:.4g} fps, interpolated to {fps:g} fps"
    return f"{rate:.4g} fps" if stride == 1 else f"{rate:.4g} fps, every {stride}. frame kept"
