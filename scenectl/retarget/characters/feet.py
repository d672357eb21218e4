"""Feet of characters: where they are held, and how they are turned there.

A foot is held by the character's own joints: its ankle as high over the ground as it is over its sole, its toes
likewise. Where heel and ball stand together the sole is level across, and along it unless ours is tilted by more than
`LEVEL`. Where the ball stands alone, the toes stay level while the heel is up.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float
from scipy.spatial import ConvexHull
from scipy.spatial.transform import Rotation

from scenectl.retarget.characters.character import Character
from scenectl.retarget.characters.limbs import eased
from scenectl.retarget.plants import Plant
from scenes.body.body import DEFAULT_BODY
from scenes.motion.motion import Motion
from scenes.motion.skeleton import HUMANML3D, size_of

LEVEL = 0.14
"""Radians (8 degrees) by which a sole that stands may be tilted and counts as level. `scenectl bench characters` (the
rigs of the tests, seven examples) says the price: feet sink by 8 mm at most with this, by 17 with twice as much, and by
6 with none."""
GROUND = 0.04
"""Metres, of an adult, by which a sole may be over or under the ground where the motion starts and counts as on it.
There feet sink by 8 mm at most with this, by 16 with half as much, and by 20 with twice as much."""
SIDES = ("left", "right")

_BALLS = ("left_foot", "right_foot")
_AT = HUMANML3D.index


@dataclass(frozen=True)
class Way:
    """Where places of a motion are on the character's way.

    Attributes:
        ground: the point (m) that stays, on the ground on which the motion starts.
        ratio: how many times as far from it everything is.
        sole, ankle: how high (m) balls and ankles of the motion's skeleton are over its soles in the T-pose.
    """

    ground: Float[np.ndarray, " 3"]
    ratio: float
    sole: float
    ankle: float

    @classmethod
    def of(cls, motion: Motion, found: Sequence[Plant], ratio: float) -> Way:
        """Of a motion in which feet stand so: its ground is the lowest for balls that stand about as high as the first.

        Where none stands it is under the lowest place of one.
        """
        sole = DEFAULT_BODY.sole_offset * size_of(motion.skeleton)
        balls = sorted((plant for plant in found if plant.joint.endswith("foot")), key=lambda plant: plant.begin)
        heights = [float(plant.place[1]) for plant in balls] or [float(motion.select(_BALLS)[..., 1].min())]
        low = min(h for h in heights if abs(h - heights[0]) < GROUND * size_of(motion.skeleton))
        start = motion.joints[0, 0].numpy()
        drop = -float(np.mean([motion.skeleton.offsets[_AT(f"{side}_foot")][1] for side in SIDES]))
        return cls(np.array([start[0], low - sole, start[2]]), ratio, sole, sole + drop)

    def place(self, points: np.ndarray, before: float, after: float) -> np.ndarray:
        """Points (m) that stood so high over the sole in the motion, and stand so high on the character."""
        up = np.array([0.0, 1.0, 0.0])
        moved: np.ndarray = self.ground + self.ratio * (points - self.ground - before * up) + after * up
        return moved

    @property
    def floor(self) -> Float[np.ndarray, " 3"]:
        """Where a ball of the motion's skeleton stands on the ground that stays."""
        return self.ground + self.sole * np.array([0.0, 1.0, 0.0])

    def grounded(self, ball: Plant) -> bool:
        """Whether a ball stands on the ground where the motion starts."""
        return bool(abs(ball.place[1] - self.sole - self.ground[1]) < GROUND * self.size)

    @property
    def size(self) -> float:
        """How many times as large as an adult the motion's skeleton is."""
        return self.sole / DEFAULT_BODY.sole_offset


@dataclass(frozen=True, eq=False)
class Foot:
    """One foot of a character.

    Attributes:
        side: "left" or "right".
        hip, knee, ankle: nodes.
        leg: length (m) of thigh and shin.
        rest: rotation of the foot at rest against the T-pose, ``[3, 3]``.
        toe: from the ankle to the toe joint at rest, where there is one, else to the ball (m), ``[3]``.
        sole: corners of the foot's hull from the ankle, at rest (m), ``[n, 3]``.
        high, low, ball: heights (m) of ankle, toe joint and ball over the sole.
        way: of the motion.
    """

    side: str
    hip: int
    knee: int
    ankle: int
    leg: float
    rest: Float[np.ndarray, "3 3"]
    toe: Float[np.ndarray, " 3"]
    sole: Float[np.ndarray, "n 3"]
    high: float
    low: float
    ball: float
    way: Way

    @classmethod
    def of(cls, character: Character, way: Way, side: str) -> Foot:
        """The foot of a character in a motion."""
        hip, knee, ankle, toe = (character.joints.get(f"{side}_{name}") for name in ("hip", "knee", "ankle", "foot"))
        assert hip is not None and knee is not None and ankle is not None
        at, ball = character.origins, character.place[_AT(f"{side}_foot")]
        rest = character.turned[_AT(f"{side}_ankle")]
        to_toe = (ball if toe is None else at[toe]) - at[ankle]
        leg = float(np.linalg.norm(at[knee] - at[hip]) + np.linalg.norm(at[ankle] - at[knee]))
        high = float(character.ankles[SIDES.index(side)])
        low, over = (high + float(rest[:, 1] @ to) for to in (to_toe, ball - at[ankle]))
        points = character.hanging_on(ankle) - at[ankle]
        sole = points[ConvexHull(points, qhull_options="QJ").vertices]
        return cls(side, hip, knee, ankle, leg, rest, to_toe, sole, high, low, over, way)

    def held(
        self, turns: np.ndarray, ankle: np.ndarray, found: Sequence[Plant], window: int
    ) -> tuple[list[Plant], np.ndarray]:
        """Turn the foot in `turns [T, 22, 3, 3]`; where it is held, and where its ankle shall be, ``[T, 3]``."""
        heels, balls = ([p for p in found if p.joint == f"{self.side}_{name}"] for name in ("ankle", "foot"))
        flat = self._flat(turns, heels, balls, window)
        heels, balls = self._places(flat, heels, balls)
        alone = set(range(len(heels))) - {i for i, _ in flat}
        heels = [self._raised(heel, turns) if i in alone else heel for i, heel in enumerate(heels)]
        foot, toes = turns[:, _AT(f"{self.side}_ankle")], turns[:, _AT(f"{self.side}_foot")]
        by, held = np.zeros_like(ankle), np.zeros(len(ankle), dtype=bool)
        bends, stands = np.zeros_like(ankle), np.zeros(len(ankle), dtype=bool)
        for plant, offset in (*((h, np.zeros(3)) for h in heels), *((b, self.toe) for b in balls)):
            own = slice(plant.begin, plant.end)
            by[own] = plant.place - foot[own] @ offset - ankle[own]
            held[own] = True
        for plant in balls:
            own = slice(plant.begin, plant.end)
            heading, tilt, _ = self._pose(foot[own])
            level = self._turned(heading, np.maximum(tilt, 0.0))
            bends[own], stands[own] = _vectors(level @ foot[own].swapaxes(1, 2)), True
        toes[:] = _matrices(eased(bends, stands, window)) @ foot
        return [*heels, *balls], ankle + eased(by, held, window)

    def _flat(
        self, turns: np.ndarray, heels: list[Plant], balls: list[Plant], window: int
    ) -> dict[tuple[int, int], np.ndarray]:
        """Turn the foot flat where both heel and ball stand; how it is turned then, by their numbers."""
        foot = turns[:, _AT(f"{self.side}_ankle")]
        by, held = np.zeros((len(foot), 3)), np.zeros(len(foot), dtype=bool)
        flat = {}
        most = [0.0 if self.way.grounded(ball) else np.pi for ball in balls]  # how far the toes can be up there
        for ball, tilt_most in zip(balls, most, strict=True):
            own = slice(ball.begin, ball.end)
            heading, tilt, across = self._pose(foot[own])
            by[own] = _vectors(self._turned(heading, np.minimum(tilt, tilt_most), across) @ foot[own].swapaxes(1, 2))
            held[own] = True
        for i, heel in enumerate(heels):
            for k, ball in enumerate(balls):
                own = slice(max(heel.begin, ball.begin), min(heel.end, ball.end))
                if own.stop <= own.start:
                    continue
                heading, tilt, _ = self._pose(foot[own])
                mean = np.arctan2(np.sin(heading).mean(), np.cos(heading).mean())
                slope = np.sign(tilt.mean()) * max(abs(tilt.mean()) - LEVEL, 0.0)
                flat[i, k] = self._turned(np.array([mean]), np.array([min(slope, most[k])]))[0]
                by[own], held[own] = _vectors(flat[i, k] @ foot[own].swapaxes(1, 2)), True
        foot[:] = _matrices(eased(by, held, window)) @ foot
        return flat

    def _places(
        self, flat: dict[tuple[int, int], np.ndarray], heels: list[Plant], balls: list[Plant]
    ) -> tuple[list[Plant], list[Plant]]:
        """The plants where the character's ankle and toe joint are: heels by the balls that stand with them."""
        way = self.way
        level = [np.array([1.0, 0.0 if way.grounded(ball) else 1.0, 1.0]) for ball in balls]
        balls = [
            replace(ball, place=way.place(way.floor + share * (ball.place - way.floor), way.sole, self.low))
            for ball, share in zip(balls, level, strict=True)
        ]
        heels = [replace(heel, place=way.place(heel.place, way.ankle, self.high)) for heel in heels]
        first = set[int]()
        for (i, k), turn in flat.items():
            if i in first:
                balls[k] = replace(balls[k], place=heels[i].place + turn @ self.toe)
            else:
                heels[i] = replace(heels[i], place=balls[k].place - turn @ self.toe)
            first.add(i)
        return heels, balls

    def _raised(self, heel: Plant, turns: np.ndarray) -> Plant:
        """A heel that stands alone, over the ground where the foot would be in it as it is turned."""
        down = turns[heel.begin : heel.end, _AT(f"{self.side}_ankle"), 1] @ self.sole.T
        under = self.way.ground[1] - float(heel.place[1] + down.min())
        near = under < GROUND * self.way.size * self.way.ratio  # further down the ground is another
        return replace(heel, place=heel.place + np.array([0.0, max(under, 0.0) if near else 0.0, 0.0]))

    def _pose(self, foot: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Heading, tilt (toes up) and what is left across (rad) of the foot where it is turned so from rest."""
        heading, tilt, across = Rotation.from_matrix(foot @ self.rest).as_euler("YXZ").T
        return heading, -tilt, across

    def _turned(self, heading: np.ndarray, tilt: np.ndarray, across: np.ndarray | float = 0.0) -> np.ndarray:
        """Rotations from rest with that heading and tilt, level across or not."""
        angles = np.stack(np.broadcast_arrays(heading, -tilt, across), axis=-1)
        turned: np.ndarray = Rotation.from_euler("YXZ", angles).as_matrix() @ self.rest.T
        return turned


def _vectors(turns: np.ndarray) -> np.ndarray:
    vectors: np.ndarray = Rotation.from_matrix(turns).as_rotvec()
    return vectors


def _matrices(vectors: np.ndarray) -> np.ndarray:
    turns: np.ndarray = Rotation.from_rotvec(vectors).as_matrix()
    return turns
