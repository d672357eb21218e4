"""What a robot follows as rows of a least-squares problem, and what each costs."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from scenectl.retarget.robots.humanoid import Humanoid
from scenectl.retarget.robots.targets import TURNED, Targets

PLACES = {
    "ankle": 30.0, "foot": 10.0, "pelvis": 10.0, "wrist": 5.0, "elbow": 2.0, "knee": 2.0, "spine3": 1.0,
}  # fmt: skip
"""Costs of a metre, by our joints: feet stand first, then hands reach, then all the rest looks like the motion."""
TURNS = {"pelvis": 4.0, "spine3": 3.0, "ankle": 2.0, "head": 0.3}
"""Costs of a radian."""
STANDING = 10.0
"""Times the cost of a foot's place while it stands. How it is turned costs no more: a body need not lean for that."""
EASE, STEADY = 0.03, 0.1
"""Costs of a radian away from the robot's rest, for what targets leave open, and from the frame before."""
SMOOTH = 2.0
"""Costs of a radian away from the smoothed joints of the first pass, in the second."""


@dataclass(frozen=True)
class Rows:
    """Points and bodies that follow targets, in the order of their rows.

    Attributes:
        points: (body, where on it) of each place.
        bodies: of each turn.
        places: ``[T, p, 3]``.
        turns: ``[T, r, 3, 3]``.
        costs: ``[T, 3 (p + r)]``.
    """

    points: list[tuple[int, np.ndarray]]
    bodies: list[int]
    places: Float[np.ndarray, "T p 3"]
    turns: Float[np.ndarray, "T r 3 3"]
    costs: Float[np.ndarray, "T k"]


def rows_of(robot: Humanoid, targets: Targets) -> Rows:
    """The targets that a robot has bodies for."""
    points, model, rest = robot.points, robot.model, robot.rest
    names = [name for name in targets.places if name.split("_")[-1] in PLACES and name in points.bodies]
    turned = [name for name in TURNED if name in robot.joints]
    bodies = [model.body(robot.joints[name]).id for name in turned]
    frames = len(targets.source.joints)
    costs = [_cost(name, targets) for name in names]
    costs += [np.full(frames, TURNS[name.split("_")[-1]]) for name in turned]
    turns = [
        targets.turns[name]
        @ points.turn
        @ points.flats.get(name.split("_")[0], np.eye(3))
        @ rest.xmat[body].reshape(3, 3)
        for name, body in zip(turned, bodies, strict=True)
    ]
    return Rows(
        [points.bodies[name] for name in names],
        bodies,
        np.stack([targets.places[name] for name in names], axis=1),
        np.stack(turns, axis=1),
        np.repeat(np.stack(costs, axis=1), 3, axis=1),
    )


def _cost(name: str, targets: Targets) -> Float[np.ndarray, " T"]:
    side, _, part = name.rpartition("_")
    cost = np.full(len(targets.source.joints), PLACES[part])
    for plant in targets.plants:
        if part in ("ankle", "foot") and plant.joint.startswith(side):
            cost[plant.begin : plant.end] = STANDING * PLACES[part]
    return cost
