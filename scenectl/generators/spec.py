"""What a family of generators can do: asked by tasks, edits and benches before any weights are read."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal, TypeAlias

from scenectl.generators.prompts import Prompts
from scenes.errors import UserError
from scenes.motion.motion import Pose2D
from scenes.motion.skeleton import HUMANML3D, Skeleton

Ability: TypeAlias = Literal["edit", "conditions", "sentences", "parts"]
"""Edits of finished motions, goals as network inputs, several sentences along one motion, sentences for body parts."""


@dataclass(frozen=True)
class Spec:
    """Clock, skeleton, lengths and abilities.

    Attributes:
        fps: frames a second of its motions.
        shortest, longest: seconds of a motion.
        window: seconds made at once; longer motions are made of windows that agree, and an edit is of one.
        abilities: what it can do besides one sentence.
        skeleton: of its motions.
    """

    fps: float
    shortest: float
    longest: float
    window: float
    abilities: frozenset[Ability] = frozenset()
    skeleton: Skeleton = HUMANML3D

    def frames(self, seconds: float) -> int:
        """Frames of a motion of so many seconds; raises UserError where it is too short or too long."""
        if not self.shortest <= seconds <= self.longest:
            raise UserError(f"seconds is {seconds:g}; a motion lasts from {self.shortest:g} to {self.longest:g} s")
        return round(seconds * self.fps)

    @property
    def window_frames(self) -> int:
        """Frames made at once."""
        return round(self.window * self.fps)

    @property
    def shortest_frames(self) -> int:
        """Frames of the shortest motion."""
        return round(self.shortest * self.fps)


def check_request(
    name: str, spec: Spec, prompts: Prompts | str, seconds: float, start: Pose2D, samples: int
) -> tuple[Prompts, int]:
    """What a family is asked for: the sentences, act by act, or one where it takes no more, and the frames.

    Raises:
        UserError: no sentence, several for a family that takes one, one that begins too late, a length outside the
            spec's, a start that is no place, no sample.
    """
    told, frames = Prompts.of(prompts), spec.frames(seconds)
    if "sentences" not in spec.abilities:
        told.single(name)
    told.check(seconds)
    if "sentences" in spec.abilities:
        told = told.act_by_act(seconds)
    if not all(map(math.isfinite, (*start.position, start.heading))):
        raise UserError(f"the start is {start.position}, heading {start.heading:g}; give finite metres and radians")
    if samples < 1:
        raise UserError(f"samples is {samples}; ask for at least 1")
    return told, frames
