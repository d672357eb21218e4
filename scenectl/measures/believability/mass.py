"""Where a body's mass is, so that its centre can be told from its joints.

Shares of the body's mass and centres of segments (share of the way from their near end to their far one): D. A. Winter,
Biomechanics and Motor Control of Human Movement, 4th ed., 2009, table 4.1 (after Dempster).
"""

from __future__ import annotations

from functools import cache

import numpy as np

from scenes.motion.skeleton import Skeleton

_SIDED = (
    # share of mass, near end, far end, where between them
    (0.0145, "ankle", "foot", 0.5),
    (0.0465, "knee", "ankle", 0.433),
    (0.1, "hip", "knee", 0.433),
    (0.028, "shoulder", "elbow", 0.436),
    (0.016, "elbow", "wrist", 0.43),
    (0.006, "elbow", "wrist", 1.27),  # the hand, where the proxy body has its palm
    (0.071, "hip", "spine1", 0.5),  # half of the pelvis
)
_MIDDLE = (
    (0.139, "spine1", "spine2", 0.5),
    (0.216, "spine2", "neck", 0.5),
    (0.081, "neck", "head", 1.0),
)


@cache
def shares(skeleton: Skeleton) -> np.ndarray:
    """Weights of joints in the centre of mass, ``[J]``; they sum to 1.

    Raises:
        UserError: the skeleton lacks one of the joints.
    """
    found = np.zeros(len(skeleton.names))
    sided = [
        (mass, f"{side}_{near}", far if far == "spine1" else f"{side}_{far}", way)
        for mass, near, far, way in _SIDED
        for side in ("left", "right")
    ]
    for mass, near, far, way in (*sided, *_MIDDLE):
        found[skeleton.index(near)] += mass * (1 - way)
        found[skeleton.index(far)] += mass * way
    return found
