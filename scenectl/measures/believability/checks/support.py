"""What carries the body: something under it, or nothing while it falls."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from scenectl.measures.believability.checks.check import Check, Found
from scenectl.measures.believability.evidence import RATE, Evidence, averages
from scenectl.measures.believability.words import centimetres, span


def held_by_nothing(seconds: float, share: float, taken: Callable[[np.ndarray, float], np.ndarray]) -> Check:
    """How high (m) the body is over the ground while it does not fall.

    Heights of its lowest point over what is below it, weighed by what the ground must bear at that moment
    (`Evidence.load`, 0 in free fall), taken together over windows of so many seconds; the highest.
    """

    def look(evidence: Evidence) -> Found | None:
        if evidence.frames < 5:
            return None
        means = taken(evidence.carried.lowest * evidence.load, seconds)
        first = int(means.argmax())
        last = min(first + round(seconds * RATE), evidence.frames) - 1
        when = span(evidence.times, first, last)
        told = f"everything {centimetres(float(means[first]))} above the ground {when}, which is no free fall"
        return Found(float(means[first]), told, float(evidence.times[(first + last) // 2]))

    return Check(f"unsupported_{seconds:g}s", "m", look, share=share)


def support(evidence: Evidence, near: float) -> list[str]:
    """What supports the body in each frame at `RATE`: "both", "left_foot", "right_foot", "other", "flight" or "none".

    A part of the body supports it that is no higher than `near` (m) over what is below.
    """
    carried, load = evidence.carried, evidence.load
    left, right = (carried.foot(side) <= near for side in (0, 1))
    other = carried.lowest <= near
    told = np.where(load < 0.5, "flight", "none")
    told = np.where(other, "other", told)
    told = np.where(left, "left_foot", np.where(right, "right_foot", told))
    return [str(word) for word in np.where(left & right, "both", told)]


def _quartiles(values: np.ndarray, seconds: float) -> np.ndarray:
    """What three quarters of each window of so many seconds are above: one moment of a jump counts for nothing."""
    size = min(round(seconds * RATE), len(values))
    found: np.ndarray = np.quantile(np.lib.stride_tricks.sliding_window_view(values, size), 0.25, axis=1)
    return found


CHECKS = (held_by_nothing(0.7, 0.99, _quartiles), held_by_nothing(3.0, 0.982, averages))
