"""The rate at which a motion seems to be played: weight, legs and arms of a given size set the pace."""

from __future__ import annotations

import numpy as np

from scenectl.measures.believability.checks.check import Check, Found
from scenectl.measures.believability.evidence import RATE, Evidence
from scenectl.measures.believability.limits import LIMITS
from scenectl.measures.believability.words import span

WINDOW, LEAST = 2.0, 1.0
"""Seconds that are looked at at once, and the fewest."""
TOGETHER = 5
"""Windows that are averaged, each a quarter later than the one before: 4 s where the body gets on all the time."""
WALKS = 0.5
"""Mean speed of the pelvis over the ground (m/s) from which on an adult has a gait, which has a pace."""
_PARTS = {
    "trunk": ("spine3", "neck", "head"),
    "elbows": ("left_elbow", "right_elbow"),
    "hands": ("left_wrist", "right_wrist"),
    "knees": ("left_knee", "right_knee"),
    "feet": ("left_ankle", "right_ankle", "left_foot", "right_foot"),
}
_NOISE = (0.01, 0.03, 0.3, 4.0)
"""What is added to a spread (m), speed, acceleration and jerk (m, s) before their logarithm: what captures shake by."""
FEATURES = (
    "flight",
    *(
        f"{part} {what}"
        for part in ("rise", "way", *_PARTS)
        for what in ("spread", "speed", "acceleration", "jerk")
        if (part, what) != ("way", "spread")
    ),
)
"""Of a window: the share of the time that nothing is in touch, and of the centre of mass's rise and way and of parts of
the body as seen from the pelvis the logarithms of spread, speed, acceleration and jerk: root mean squares over joints,
medians over time, so that a single jump counts for nothing."""


def features(evidence: Evidence, first: int, last: int) -> np.ndarray:
    """`FEATURES` of frames first to last - 1 of a motion at `RATE`."""
    now = slice(first, last)
    center, joints = evidence.center[now] / evidence.size, evidence.joints[now] / evidence.size  # as an adult's
    index = evidence.motion.skeleton.indices
    tracks = [center[:, None, 1:2], center[:, None, ::2]]
    tracks += [joints[:, index(names)] - joints[:, :1] for names in _PARTS.values()]
    found = [float((evidence.carried.lowest[now] > 0.03 * evidence.size).mean())]
    for number, track in enumerate(tracks):
        rates = [track - track.mean(axis=0)]
        for _ in range(3):
            rates.append(np.diff(rates[-1], axis=0) * RATE)
        found += [
            float(np.log(np.median(np.sqrt((rate**2).mean(axis=1).sum(axis=1))) + noise))
            for rate, noise in list(zip(rates, _NOISE, strict=True))[number == 1 :]
        ]
    return np.array(found)


def windows(evidence: Evidence) -> list[tuple[int, int]]:
    """First and last frame (less 1) of all windows in which the body gets on, a quarter of their length apart."""
    size = min(round(WINDOW * RATE), evidence.frames)
    if size < LEAST * RATE:
        return []
    starts = sorted({*range(0, evidence.frames - size + 1, round(WINDOW * RATE / 4)), evidence.frames - size})
    speeds = np.linalg.norm(evidence.velocities[:, 0, ::2], axis=-1)
    return [
        (start, start + size) for start in starts if speeds[start : start + size - 1].mean() > WALKS * evidence.size
    ]


def rates(evidence: Evidence, weights: np.ndarray) -> np.ndarray:
    """The rate at which each of `windows` seems to be played; `weights` are a bias and those of `FEATURES`."""
    return 2 ** np.array([features(evidence, *window) @ weights[1:] + weights[0] for window in windows(evidence)])


def seeming(evidence: Evidence, weights: np.ndarray) -> tuple[float, int, int] | None:
    """The highest rate at which `TOGETHER` of `windows` seem to be played, their first frame and the one after them.

    Their geometric mean: one window in a long dance is noisy. None where there is no gait.
    """
    seen = windows(evidence)
    if not seen:
        return None
    size = min(TOGETHER, len(seen))
    means = np.convolve(np.log2(rates(evidence, weights)), np.full(size, 1 / size), "valid")
    best = int(means.argmax())
    return float(2 ** means[best]), seen[best][0], seen[best + size - 1][1]


def tempo(evidence: Evidence) -> Found | None:
    """The highest rate at which a gait seems to be played (`seeming`), 1 as it was recorded.

    2 to the power of a linear function of `FEATURES`, fitted by ridge regression to recorded clips that are played at
    rates from 0.6 to 2.5 (`scenectl bench limits`).
    """
    found = seeming(evidence, np.array(LIMITS.tempo)) if LIMITS.tempo else None
    if found is None:
        return None
    value, first, last = found
    told = f"the body moves {value:.1f} times as fast as people do {span(evidence.times, first, last - 1)}"
    return Found(value, told, float(evidence.times[(first + last) // 2]))


CHECKS = (Check("tempo", "times", tempo, share=0.98, explains=2),)
