"""Where feet stand: stretches of a motion in which the ball of a foot, or its heel, is at rest."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from scenes.motion.motion import Motion
from scenes.motion.skeleton import size_of

STILL = 0.25
"""Metres a second, for an adult: below it a foot stands.

In walks the balls of feet move at 0.04 m/s most often while they stand, and at 4 while they swing; the valley between
is flat from 0.11 to 0.42 m/s (`scenectl bench plants`). This is in its middle, so
that feet of generated people, which glide a little, stand too."""
SHORTEST = 0.1
"""Seconds that a foot stands at least."""
POINTS = ("left_ankle", "right_ankle", "left_foot", "right_foot")
"""Joints that stand: heels, by the ankle over them, and balls of the feet."""


@dataclass(frozen=True)
class Plant:
    """A stretch of frames in which a joint of a foot is at rest.

    Attributes:
        joint: one of `POINTS`.
        begin, end: its first frame, and the one after its last.
        place: where the joint is in the mean (m, world), ``[3]``.
    """

    joint: str
    begin: int
    end: int
    place: np.ndarray


def plants(motion: Motion) -> list[Plant]:
    """All stretches of one motion ``[T, 22, 3]`` in which a foot's joint moves at under `STILL` for `SHORTEST`.

    A foot that is held still in the air stands as well: whoever plants it holds it where it is.
    """
    still, least = STILL * size_of(motion.skeleton), round(SHORTEST * motion.fps)
    found = []
    for name in POINTS:
        path = motion.joint(name).detach().cpu().double().numpy()
        if len(path) < 2:
            continue
        slow = np.linalg.norm(np.gradient(path, axis=0), axis=-1) * motion.fps < still
        edges = np.flatnonzero(np.diff(np.concatenate([[0], slow.astype(int), [0]])))
        for begin, end in edges.reshape(-1, 2):
            if end - begin >= least:
                found.append(Plant(name, int(begin), int(end), path[begin:end].mean(axis=0)))
    return found
