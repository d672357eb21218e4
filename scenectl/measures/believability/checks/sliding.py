"""Feet that slide while they carry."""

from __future__ import annotations

import numpy as np

from scenectl.measures.believability.checks.check import Check, Found
from scenectl.measures.believability.evidence import RATE, Evidence, averages
from scenectl.measures.believability.words import span

LOW = 0.1
"""Feet slide at any height (m) below this."""
NEAR = 0.03
"""Parts of feet no higher (m) than this over the lowest one carry with it."""
WINDOW = 1.0


def slide(evidence: Evidence) -> Found | None:
    """How fast (m/s) the part of the feet that is most at rest moves over the ground, weighed by what it carries.

    Of balls, heels and toes that are low in two frames the slowest counts: a foot that rolls rests somewhere, and one
    that swings has another beside it. Averaged over windows of `WINDOW` s with the load as weight, so that flight counts
    for nothing.
    """
    if evidence.frames < 5:
        return None
    carried = evidence.carried
    count = 2 * carried.feet
    heights = carried.heights[:, :count]
    heights = np.maximum(heights[1:], heights[:-1])
    speeds = np.linalg.norm(np.diff(carried.points[:, :count, ::2], axis=0), axis=-1) * RATE
    lowest = heights.min(axis=1, keepdims=True)
    carries = (heights < LOW) & (heights <= np.maximum(lowest, 0.0) + NEAR)
    slowest = np.where(carries, speeds, np.inf).min(axis=1)
    load = np.minimum(evidence.load[1:], evidence.load[:-1]) * carries.any(axis=1)
    moved = np.where(np.isfinite(slowest), slowest, 0.0)
    weights = averages(load, WINDOW)
    means = averages(moved * load, WINDOW) / np.maximum(weights, 0.3)
    first = int(means.argmax())
    last = min(first + round(WINDOW * RATE), evidence.frames - 1)
    value = float(means[first])
    told = f"the feet that carry slide at {value:.2f} m/s {span(evidence.times, first, last)}"
    return Found(value, told, float(evidence.times[(first + last) // 2]), "feet")


CHECKS = (Check("sliding", "m/s", slide),)
