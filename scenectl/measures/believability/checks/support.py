"""What carries the body: something under it, or nothing while it falls."""

from __future__ import annotations

import numpy as np

from scenectl.measures.believability.checks.check import Check, Found
from scenectl.measures.believability.evidence import RATE, Evidence, averages
from scenectl.measures.believability.words import centimetres, span


def held_by_nothing(seconds: float, share: float) -> Check:
    """How high (m) the body is over the ground while it does not fall.

    Heights of its lowest point over what is below it, weighed by what the ground must bear at that moment
    (`Evidence.load`, 0 in free fall), averaged over windows of so many seconds; the highest.
    """

    def look(evidence: Evidence) -> Found | None:
        if evidence.frames < 5:
            return None
        means = averages(evidence.carried.lowest * evidence.load, seconds)
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


CHECKS = (held_by_nothing(0.5, 0.995), held_by_nothing(3.0, 0.99))
