"""Feet that slide while they carry."""

from __future__ import annotations

import numpy as np

from scenectl.measures.believability.checks.check import Check, Found
from scenectl.measures.believability.evidence import RATE, Evidence, averages
from scenectl.measures.believability.words import span

LOW = 0.1
"""An adult's feet slide at any height (m) below this; others in proportion to their legs, as with `NEAR`."""
NEAR = 0.05
"""Parts of feet no higher (m) than this over the lowest one carry with it."""


def slides(seconds: float, share: float) -> Check:
    """How fast (m/s) the part of the feet that is most at rest is carried over the ground.

    Of balls, heels and toes that are low in two frames the slowest counts: a foot that rolls rests somewhere, and one
    that swings has another beside it. Its velocity over the ground, a vector, is averaged over windows of so many
    seconds with the squared load as weight: flight counts for nothing, and shaking cancels. The fastest average.
    """

    def look(evidence: Evidence) -> Found | None:
        if evidence.frames < 5:
            return None
        velocity, load = _at_rest(evidence)
        moved = np.linalg.norm(averages(velocity * load[:, None], seconds), axis=1)
        means = moved / np.maximum(averages(load, seconds), 0.3)
        first = int(means.argmax())
        last = min(first + round(seconds * RATE), evidence.frames - 1)
        value = float(means[first])
        told = f"the feet that carry slide at {value:.2f} m/s {span(evidence.times, first, last)}"
        return Found(value, told, float(evidence.times[(first + last) // 2]), "feet")

    return Check(f"sliding_{seconds:g}s", "m/s", look, share=share, grows=True)


def _at_rest(evidence: Evidence) -> tuple[np.ndarray, np.ndarray]:
    """Velocity over the ground (m/s) of the slowest carrying part of the feet, ``[T - 1, 2]``, and the squared load."""
    carried = evidence.carried
    count = 2 * carried.feet
    heights = carried.heights[:, :count]
    heights = np.maximum(heights[1:], heights[:-1])
    velocities = np.diff(carried.points[:, :count, ::2], axis=0) * RATE
    low, near = LOW * evidence.size, NEAR * evidence.size
    carries = (heights < low) & (heights <= np.maximum(heights.min(axis=1, keepdims=True), 0.0) + near)
    slowest = np.where(carries, np.linalg.norm(velocities, axis=-1), np.inf).argmin(axis=1)
    load = np.minimum(evidence.load[1:], evidence.load[:-1]).clip(0.0, 3.0) * carries.any(axis=1)
    return velocities[np.arange(len(slowest)), slowest], load**2


CHECKS = (slides(0.5, 0.995), slides(2.0, 0.985))
