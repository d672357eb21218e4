"""Ground that rises and falls under a motion: generators make motions on level ground, and a path tells how it lies.

Without it, a generator's body stays at the height of its start: going up, the scene pushes it; going down, nothing
does, and a search stretches or folds legs instead. Like moves of a free start, generators know nothing of this.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import torch

from objectives import Objective
from objectives.library.paths import risen
from scenes.motion.motion import Motion
from scenes.motion.skeleton import FEET

_SOFT = 0.05
"""Metres over which the higher ground passes from foot to foot, so that bodies don't jerk; none on level ground."""


@dataclass(frozen=True)
class Rise:
    """How much higher or lower than at its beginning a path lies under a body.

    Attributes:
        path: what `follow_path` was told, its `height` included.
    """

    path: dict[str, object]

    @classmethod
    def of(cls, objective: Objective) -> Rise | None:
        """Of the first goal that keeps a height over a path; None where none does."""
        found = (t.parameters for t in objective.counted if t.spec.name == "follow_path")
        return next((cls(dict(given)) for given in found if given.get("height") is not None), None)

    def under(self, motion: Motion) -> Motion:
        """The motion with whole bodies, whose limbs stay as they are, on the higher of the grounds under their feet.

        Steps are walls to a foot that is too low, and out of walls no search leads; one that is too high is let down.
        """
        feet = torch.stack([risen(motion, **{**self.path, "joint": foot}) for foot in FEET])  # type: ignore[arg-type]
        higher = _SOFT * (torch.logsumexp(feet / _SOFT, dim=0) - math.log(len(FEET)))
        lift = higher[..., None, None] * motion.joints.new_tensor([0.0, 1.0, 0.0])
        return replace(motion, joints=motion.joints + lift)
