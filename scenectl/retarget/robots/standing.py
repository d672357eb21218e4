"""Where a robot's soles touch the ground over a trajectory, what stands on them, and how far they slide."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import torch
from jaxtyping import Bool, Float, Int

from scenectl.retarget.plants import Plant
from scenectl.retarget.robots.capsules import carried, poses
from scenectl.retarget.robots.humanoid import Humanoid
from scenectl.retarget.robots.mapping import SIDES
from scenectl.retarget.robots.trajectory import Trajectory
from scenes.body.mjcf import geom_solid, geoms_of
from scenes.mesh.scale import TO_Y_UP
from scenes.world.scene import Scene

_LEVEL = 0.01
"""Metres above the lowest point of a foot at rest up to which its shapes are its sole."""
_TOUCHING = 0.015
"""Metres above the lowest point of a sole that stands up to which its points touch the ground: what soles and grounds
give, and less than a heel that has risen by 5 degrees."""
_AIR = 0.05
"""Metres over the ground from which a foot that is still does not stand on it."""
_AROUND = 8
"""Points around a sole that stand for it: as many directions, 22.5 degrees from the farthest they stand for."""


@dataclass(frozen=True, eq=False)
class Sole:
    """Points around a sole, each in the frame of the body that carries it.

    Attributes:
        bodies: of the points, ``[n]``.
        points: metres, ``[n, 3]``.
        friction: of the foot's shapes, in the mean.
    """

    bodies: Int[np.ndarray, " n"]
    points: Float[np.ndarray, "n 3"]
    friction: float


def sole_of(robot: Humanoid, side: str) -> Sole:
    """The lower side of a foot and of all that hangs on it, its sole level; the ankle's point without shapes."""
    model, tree, foot = robot.model, robot.tree, robot.model.body(robot.joints[f"{side}_ankle"]).id
    places, turns = robot.rest.xpos[None], robot.rest.xmat.reshape(1, -1, 3, 3)
    owners, points, frictions = [np.array([foot])], [np.zeros((1, 3))], [1.0]
    for body in (body for body in range(1, model.nbody) if foot in tree.chain(body)):
        collides, seen = geoms_of(model, body)
        for geom in collides or seen:
            corners, _ = geom_solid(model, geom)
            owners.append(np.full(len(corners), body))
            points.append(corners)
            frictions.append(float(model.geom_friction[geom, 0]))
    bodies, where = np.concatenate(owners), np.concatenate(points)
    placed = carried(places, turns, bodies, where)[0] @ robot.points.flats[side].T
    low = np.flatnonzero(placed[:, 2] < placed[:, 2].min() + _LEVEL)
    angles = 2 * np.pi * np.arange(_AROUND) / _AROUND + np.pi / _AROUND
    around = np.unique(low[(placed[low, :2] @ np.stack([np.cos(angles), np.sin(angles)])).argmax(axis=0)])
    return Sole(bodies[around], where[around], float(np.mean(frictions[1:] or frictions)))


@dataclass(frozen=True, eq=False)
class Standing:
    """The soles of a trajectory.

    Attributes:
        trajectory: whose.
        bodies: of all points, the left sole's first, ``[n]``.
        left: how many are the left sole's.
        points: where they are, metres, z up, ``[T, n, 3]``.
        touching: whether each stands on the ground, ``[T, n]``.
        friction: of the soles, in the mean.
    """

    trajectory: Trajectory
    bodies: Int[np.ndarray, " n"]
    left: int
    points: Float[np.ndarray, "T n 3"]
    touching: Bool[np.ndarray, "T n"]
    friction: float

    @cached_property
    def standing(self) -> Bool[np.ndarray, " T"]:
        """Frames at which something touches the ground."""
        found: np.ndarray = np.any(self.touching, axis=1)
        return found

    def outside(self, places: Float[np.ndarray, "T 2"]) -> Float[np.ndarray, " T"]:
        """How far (m) places over the ground are outside the support polygon, 0 inside; NaN where nothing stands."""
        found = np.full(len(places), np.nan)
        for frame in np.flatnonzero(self.standing & np.isfinite(places).all(axis=1)):
            found[frame] = outside(places[frame], self.points[frame, self.touching[frame], :2])
        return found

    def slides(self) -> list[tuple[float, str, int]]:
        """Of each plant: how far (m) its sole goes from where it stood first, our joint, and when (frame).

        It is the way of the point that goes the least of those that touch for longest: a foot that turns on its ball
        goes nowhere, and `turns` tells of it.
        """
        found = []
        for plant, points, touching in self._plants():
            longest = touching.sum(axis=0) == touching.sum(axis=0).max()
            away = np.linalg.norm(points - points[0], axis=-1)[:, longest]
            path = away[:, away.max(axis=0).argmin()]
            found.append((float(path.max()), plant.joint, plant.begin + int(path.argmax())))
        return found

    def turns(self) -> list[tuple[float, str, int]]:
        """Of each plant: how far (degrees) its sole turns on the ground, our joint, and when (frame)."""
        found = []
        for plant, points, _ in self._plants():
            spread = points - points.mean(axis=1, keepdims=True)
            across = spread[0, :, 0] * spread[..., 1] - spread[0, :, 1] * spread[..., 0]
            angle = np.abs(np.degrees(np.arctan2(across.sum(axis=1), (spread[0] * spread).sum(axis=(1, 2)))))
            found.append((float(angle.max()), plant.joint, plant.begin + int(angle.argmax())))
        return found

    def _plants(self) -> Iterator[tuple[Plant, Float[np.ndarray, "t m 2"], Bool[np.ndarray, "t m"]]]:
        """Plants with the points of their soles over the ground and whether they touch, in the frames that they do."""
        for plant in self.trajectory.plants:
            part = slice(0, self.left) if plant.joint.startswith("left") else slice(self.left, None)
            frames = np.arange(plant.begin, plant.end)
            frames = frames[self.touching[frames, part].any(axis=1)]
            if len(frames):
                yield replace(plant, begin=int(frames[0])), self.points[frames, part, :2], self.touching[frames, part]


def standing(trajectory: Trajectory, scene: Scene | None = None) -> Standing:
    """Where the soles are: a foot stands while its source does (`Trajectory.plants`) and the ground is near.

    Without a scene the ground is as high as the lowest point of a sole that stands anywhere.
    """
    robot = trajectory.robot
    soles = [sole_of(robot, side) for side in SIDES]
    bodies = np.concatenate([sole.bodies for sole in soles])
    points = carried(*poses(robot.model, trajectory.qpos), bodies, np.concatenate([sole.points for sole in soles]))
    left = len(soles[0].bodies)
    parts = slice(0, left), slice(left, None)
    touching = np.zeros(points.shape[:2], bool)
    for plant in trajectory.plants:
        touching[plant.begin : plant.end, parts[plant.joint.startswith("right")]] = True
    heights = points[..., 2] - _ground(points, touching, scene)
    for part in parts:
        lowest = points[:, part, 2].min(axis=1, keepdims=True)
        touching[:, part] &= points[:, part, 2] < lowest + _TOUCHING
        touching[:, part] &= heights[:, part].min(axis=1, keepdims=True) < _AIR
    return Standing(trajectory, bodies, left, points, touching, float(np.mean([sole.friction for sole in soles])))


def _ground(
    points: Float[np.ndarray, "T n 3"], stands: Bool[np.ndarray, "T n"], scene: Scene | None
) -> Float[np.ndarray, "T n"]:
    """Height (m) of the ground under points."""
    if scene is None:
        lowest = points[..., 2][stands].min() if stands.any() else 0.0
        return np.full(points.shape[:2], lowest)
    over = points + np.array([0.0, 0.0, _AIR])  # a sole may be a little under its ground
    heights: np.ndarray = scene.ground_under(torch.from_numpy(over @ TO_Y_UP["z"].T)).double().numpy()
    return heights


def outside(place: Float[np.ndarray, "2"], points: Float[np.ndarray, "n 2"]) -> float:
    """How far (m) a place is from the convex hull of points: the nearest mean of them with weights of sum 1."""
    from scipy.optimize import nnls

    strict = 1e4  # metres: what the weights' sum differing from 1 costs
    weights, _ = nnls(np.vstack([(points - place).T, np.full(len(points), strict)]), np.array([0.0, 0.0, strict]))
    away = float(np.linalg.norm(weights @ (points - place)))
    return away if away > 1e-6 else 0.0


def last_of(values: Iterable[tuple[float, str, int]]) -> tuple[float, str, int]:
    """The largest of some findings; nothing found is 0 of nothing at the first frame."""
    return max(values, default=(0.0, "", 0))
