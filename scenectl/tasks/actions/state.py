"""What an action is told and what it answers: the world, the state in which the body will be, and an act."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Literal, TypeAlias

import numpy as np

from objectives import Term
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
        keeps: goals that hold as long as the body stays as it is, such as its contact with a seat.
        touches: joints whose part of the body touches the scene meanwhile.
        feet: where the feet stand of somebody who sits: a place on the ground where they can stand up to.
        holds: goals that hold until what is in the hands is put down.
        put: names of what was put down, which a script takes once.
    """

    place: Place
    heading: float
    posture: Posture = "standing"
    keeps: tuple[Term, ...] = ()
    touches: tuple[str, ...] = ()
    feet: Place | None = None
    holds: tuple[Term, ...] = ()
    put: tuple[str, ...] = ()

    @property
    def held(self) -> str:
        """Name of what is in the hands; nothing where they are empty."""
        return str(self.holds[0].parameters["object"]) if self.holds else ""

    def at(self, place: Sequence[float] | np.ndarray, heading: float) -> State:
        """Standing elsewhere."""
        x, y, z = (float(value) for value in place)
        return State((x, y, z), turn(heading), holds=self.holds, put=self.put)

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
        touches: joints whose part of the body may touch the scene, and from when to when (s).
        last: nobody knows where it leaves the body, so that nothing can follow.
    """

    sentence: str | tuple[Prompt, ...]
    seconds: float
    then: State
    terms: tuple[Term, ...] = ()
    path: np.ndarray | None = None
    touches: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    last: bool = False

    def prompts(self, begin: float, end: float) -> tuple[Prompt, ...]:
        """Its sentences on the clock of a script, in which it is from `begin` to `end` (s)."""
        if isinstance(self.sentence, str):
            return (Prompt(self.sentence, begin, end),)
        begins = [begin, *(min(round(begin + prompt.begin, 3), end) for prompt in self.sentence[1:]), end]
        return tuple(Prompt(p.text, a, b) for p, a, b in zip(self.sentence, begins[:-1], begins[1:], strict=True))


def turn(heading: float) -> float:
    """A heading (rad), or the way from one to another, between -pi and pi."""
    return (heading + math.pi) % (2 * math.pi) - math.pi
