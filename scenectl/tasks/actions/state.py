"""What an action is told and what it answers: the world, the state in which the body will be, and an act."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Literal, TypeAlias

import numpy as np

from objectives import Context, Term
from scenectl.generators.prompts import Prompt
from scenectl.generators.spec import Spec
from scenes.body.body import ProxyBody
from scenes.motion.frames import Place
from scenes.world.floor.planning import FreeArea, free_area
from scenes.world.scene import Scene

Posture: TypeAlias = Literal["standing", "sitting"]


@dataclass(frozen=True)
class World:
    """What an action may look at.

    Attributes:
        scene: what exists, in the frame that all is stated in.
        body: that acts.
        spec: clock and lengths of the generator.
    """

    scene: Scene
    body: ProxyBody
    spec: Spec
    _areas: dict[tuple[float, float], FreeArea] = field(default_factory=dict, repr=False, compare=False)

    @property
    def context(self) -> Context:
        """What the goals of an action may look at."""
        return Context(self.scene, self.body)

    def area(self, radius: float, height: float) -> FreeArea:
        """Where on the ground somebody of a radius and a height (m) can be; mapped once."""
        if (radius, height) not in self._areas:
            self._areas[radius, height] = free_area(self.scene, radius, height)
        return self._areas[radius, height]


@dataclass(frozen=True)
class State:
    """How the body will be when an action begins, as planned: where it gets to in fact, generation decides.

    Attributes:
        place: on the ground under the pelvis, m; of somebody who sits, where the pelvis is.
        heading: rad about +y, 0 faces +z and pi/2 +x.
        posture: "standing" or "sitting".
        rise: place and heading of where the feet stand, for somebody who sits and may get up.
    """

    place: Place
    heading: float
    posture: Posture = "standing"
    rise: tuple[Place, float] | None = None

    def at(self, place: Sequence[float] | np.ndarray, heading: float) -> State:
        """Standing elsewhere."""
        x, y, z = (float(value) for value in place)
        return State((x, y, z), turn(heading))

    def facing(self, heading: float) -> State:
        """The same, turned."""
        return replace(self, heading=turn(heading))

    def towards(self, x: float, z: float) -> float:
        """Heading (rad) from here to a place; its own where that is here."""
        dx, dz = x - self.place[0], z - self.place[2]
        return self.heading if math.hypot(dx, dz) < 1e-6 else math.atan2(dx, dz)


@dataclass(frozen=True)
class Act:
    """What an action comes to.

    Attributes:
        sentence: what a person does, for the generator; or several with times, in seconds of the act.
        seconds: how long it takes.
        then: the state in which it leaves the body.
        terms: its goals; their times are seconds of the act.
        path: the way that it plans, ``[P, 3]`` m on the ground, where it walks.
    """

    sentence: str | tuple[Prompt, ...]
    seconds: float
    then: State
    terms: tuple[Term, ...] = ()
    path: np.ndarray | None = None

    def prompts(self, begin: float) -> tuple[Prompt, ...]:
        """Its sentences on the clock of a script that it begins at (s)."""
        end = begin + self.seconds
        if isinstance(self.sentence, str):
            return (Prompt(self.sentence, begin, end),)
        ends = [*(prompt.begin for prompt in self.sentence[1:]), self.seconds]
        return tuple(
            Prompt(p.text, begin + p.begin, begin + (e if p.end is None else p.end))
            for p, e in zip(self.sentence, ends, strict=True)
        )


def turn(heading: float) -> float:
    """A heading (rad), or the way from one to another, between -pi and pi."""
    return (heading + math.pi) % (2 * math.pi) - math.pi
