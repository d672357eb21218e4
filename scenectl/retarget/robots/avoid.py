"""Avoidance: a robot's capsules stay clear of each other and of the scene while inverse kinematics moves it.

Both classes are tasks and limits as mink's solver takes them, by their methods alone. As a task, each gap that is too
small asks to be as wide as it should be; it is weighed against all other tasks. As a limit, no gap that is wide enough
may close below that in one step; gaps that are too small already may not close further. Standing still always
satisfies it, so it takes no solution from limits of joints and speeds that allow that.
"""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
import torch
from jaxtyping import Bool, Float, Int

from scenectl.retarget.robots.capsules import NEAR, Capsules, capsules_of, carried, poses
from scenes.mesh.scale import TO_Y_UP
from scenes.world.scene import Scene

if TYPE_CHECKING:
    from mink import Constraint

    from scenectl.retarget.robots.humanoid import Humanoid

MARGIN = NEAR
"""Metres that stay free between capsules and what they avoid: mink's default."""
REACH = 0.05
"""Metres beyond what gaps should be from which they are limited: at 50 frames a second, nothing slower than 2.5 m/s
jumps it."""
PASSES, ENOUGH = 3, 0.003
"""How often inverse kinematics is repeated with the scene where it was left, and metres that are clear enough."""
WORTH = 0.9
"""Share of its depth from which a pass is the last: what stands in the way where a foot stands is not avoidable."""
_MOST = 4
"""Samples of a body that count at a frame, the nearest ones: three hold a flat sole."""
_SKIN = 0.2
"""Metres beyond which pairs are not looked at until something has moved by half of that: of 0.1, 0.2 and 0.4, the
fastest with a G1 that walks."""
COST = 300.0
"""Of a metre of gap, in mink's units: as much as of a foot that stands (`rows.STANDING`)."""


@dataclass(frozen=True, eq=False)
class Rows:
    """Gaps that are watched at one configuration.

    Attributes:
        distance: metres, ``[k]``.
        least: what each should be at least, metres, ``[k]``.
        gradient: of the distance, by what moves the configuration (its `qvel`), ``[k, nv]``.
    """

    distance: Float[np.ndarray, " k"]
    least: Float[np.ndarray, " k"]
    gradient: Float[np.ndarray, "k V"]


_NONE = Rows(np.zeros(0), np.zeros(0), np.zeros((0, 0)))


class Avoidance:
    """Gaps that stay open."""

    def __init__(self, robot: Humanoid, cost: float = COST, margin: float = MARGIN) -> None:
        """Prepare a robot's capsules; they shall stay `margin` (m) apart, weighed by `cost`."""
        self.capsules: Capsules = capsules_of(robot)
        self.cost, self.margin = cost, margin
        self.frame, self._known = 0, (b"", _NONE)

    @abstractmethod
    def rows(self, data: Any) -> Rows:
        """The gaps below `REACH` where MuJoCo's data has the bodies (after `mj_kinematics` and `mj_comPos`)."""

    def at(self, frame: int) -> None:
        """Attend to a frame."""
        self.frame, self._known = frame, (b"", _NONE)

    def _rows(self, data: Any) -> Rows:
        """`rows`, found once for both the task and the limit of a configuration."""
        key = data.qpos.tobytes()
        if self._known[0] != key:
            self._known = key, self.rows(data)
        return self._known[1]

    def compute_qp_residual(self, configuration: Any) -> tuple[np.ndarray, np.ndarray, float]:
        """As mink's tasks: a weighted Jacobian, a weighted error, and no damping."""
        rows = self._rows(configuration.data)
        small = rows.distance < rows.least
        return self.cost * rows.gradient[small], self.cost * (rows.least - rows.distance)[small], 0.0

    def compute_qp_inequalities(self, configuration: Any, dt: float) -> Constraint:
        """As mink's limits: G dq <= h."""
        from mink import Constraint

        rows = self._rows(configuration.data)
        return Constraint(-rows.gradient, np.maximum(rows.distance - rows.least, 0.0))

    def _along(
        self,
        data: Any,
        bodies: Int[np.ndarray, " k"],
        points: Float[np.ndarray, "k 3"],
        normals: Float[np.ndarray, "k 3"],
    ) -> Float[np.ndarray, "k V"]:
        """How fast points (m, world) that bodies carry move along normals, for each way to move."""
        (a, b, c), (x, y, z) = (points - data.subtree_com[self._root]).T, normals.T
        screws = np.stack([b * z - c * y, c * x - a * z, a * y - b * x, x, y, z], axis=1)
        found: np.ndarray = screws @ data.cdof.T * self._moved[bodies]
        return found

    @cached_property
    def _root(self) -> int:
        return int(self.capsules.model.jnt_bodyid[0])

    @cached_property
    def _moved(self) -> Bool[np.ndarray, "B V"]:
        """Which bodies each way to move moves."""
        model = self.capsules.model
        found = model.dof_bodyid == np.arange(model.nbody)[:, None]
        for body in range(1, model.nbody):
            found[body] |= found[model.body_parentid[body]]
        return found


class SelfAvoidance(Avoidance):
    """The robot's capsules stay clear of each other: of `Capsules.pairs`, the nearest of each two bodies."""

    _listed: tuple[Float[np.ndarray, "C 2 3"], Int[np.ndarray, " n"]] | None = None

    def rows(self, data: Any) -> Rows:
        """See `Avoidance.rows`; the gradient is that of the nearest points of both."""
        capsules = self.capsules
        places = capsules.placed(data.xpos[None], data.xmat.reshape(1, -1, 3, 3))[0]
        gaps = capsules.self_distances(places, self.margin + REACH, self._among(places))
        bodies = capsules.bodies[capsules.pairs[gaps.pairs]]
        near = _lowest(gaps.distance, bodies @ [capsules.model.nbody, 1], 1, self.margin + REACH)
        first, second = bodies[near].T
        between = gaps.b[near] - gaps.a[near]
        length = np.linalg.norm(between, axis=1, keepdims=True)
        normals = np.where(length > 1e-9, between / np.maximum(length, 1e-9), [0.0, 0.0, 1.0])
        ends = np.concatenate([gaps.b[near], gaps.a[near]])
        there, here = np.split(
            self._along(data, np.concatenate([second, first]), ends, np.concatenate([normals, normals])), 2
        )
        return Rows(gaps.distance[near], np.full(len(near), self.margin), there - here)

    def _among(self, places: Float[np.ndarray, "C 2 3"]) -> Int[np.ndarray, " n"]:
        """Pairs that may be near: a list that holds until an end has gone half of `_SKIN` (Verlet, 1967)."""
        if self._listed is None or 4 * np.square(places - self._listed[0]).sum(axis=-1).max() > _SKIN**2:
            self._listed = places, self.capsules.self_distances(places, self.margin + REACH + _SKIN).pairs
        return self._listed[1]


@dataclass(frozen=True, eq=False)
class _Planes:
    """What is near samples at one frame: samples ``[k]``, and the distance (m) of their balls as a plane each.

    ``distance + normals . (place - places)`` is how far a ball is from the scene where it is at ``place``.
    """

    samples: Int[np.ndarray, " k"]
    places: Float[np.ndarray, "k 3"]
    distance: Float[np.ndarray, " k"]
    normals: Float[np.ndarray, "k 3"]


class SceneAvoidance(Avoidance):
    """The robot's capsules stay clear of a scene: soles may stand on it as deep as they do at rest.

    `look` asks the scene once for all frames of a trajectory, where a first pass of inverse kinematics put the robot,
    and keeps a plane for each sample that is near something; `at` says which of them count. After a second pass `look`
    again, where the robot was moved far.
    """

    def __init__(
        self, robot: Humanoid, scene: Scene, t0: float = 0.0, cost: float = COST, margin: float = MARGIN
    ) -> None:
        """Prepare a robot for a scene in our world (y up) whose clock is at `t0` (s) at the first frame."""
        super().__init__(robot, cost, margin)
        self.scene, self.t0 = scene, t0
        self.least = np.minimum(margin, self.capsules.rest_heights)
        self._near: list[_Planes] = []

    def look(self, qpos: Float[np.ndarray, "T Q"], fps: float) -> float:
        """See what is near at each frame; returns the depth (m) to which anything is too near, 0 where nothing is."""
        capsules = self.capsules
        points, owners = capsules.samples
        places = carried(*poses(capsules.model, qpos), capsules.bodies[owners], points)
        times = self.t0 + np.arange(len(qpos)) / fps
        distance, normals = scene_distance(self.scene, places, times[:, None])
        distance -= capsules.radii[owners]
        self._near = []
        for frame in range(len(qpos)):
            near = _lowest(distance[frame] - self.least, capsules.bodies[owners], _MOST, REACH)
            self._near.append(_Planes(near, places[frame, near], distance[frame, near], normals[frame, near]))
        return float(np.maximum(self.least - distance, 0.0).max(initial=0.0))

    def rows(self, data: Any) -> Rows:
        """See `Avoidance.rows`; of the planes that `look` left for `frame`."""
        planes = self._near[self.frame]
        points, owners = self.capsules.samples
        bodies = self.capsules.bodies[owners[planes.samples]]
        turns = data.xmat.reshape(1, -1, 3, 3)
        places = carried(data.xpos[None], turns, bodies, points[planes.samples])[0]
        distance = planes.distance + ((places - planes.places) * planes.normals).sum(axis=1)
        least = self.least[planes.samples]
        near = np.flatnonzero(distance < least + REACH)
        gradient = self._along(data, bodies[near], places[near], planes.normals[near])
        return Rows(distance[near], least[near], gradient)


def clear(
    solve: Callable[[Sequence[Avoidance], Float[np.ndarray, "T Q"] | None], Float[np.ndarray, "T Q"]],
    robot: Humanoid,
    fps: float,
    scene: Scene | None = None,
    t0: float = 0.0,
) -> Float[np.ndarray, "T Q"]:
    """Move a robot clear of itself and of a scene.

    Args:
        solve: inverse kinematics with some avoidance as tasks and as limits, from what is known of the qpos on; calls
            `Avoidance.at` for each frame.
        robot: whose.
        fps: frames a second.
        scene: y up, or None.
        t0: time (s) of the first frame on the scene's clock.

    Returns:
        The robot's qpos over time. What is still in the way was not avoidable at its cost.
    """
    own = SelfAvoidance(robot)
    qpos = solve([own], None)
    if scene is None:
        return qpos
    there = SceneAvoidance(robot, scene, t0)
    deep = there.look(qpos, fps)
    for _ in range(PASSES):
        if deep < ENOUGH:
            break
        moved = solve([own, there], qpos)
        before, deep = deep, there.look(moved, fps)
        if deep < before:
            qpos = moved
        if deep > WORTH * before:
            break
    return qpos


def _lowest(
    values: Float[np.ndarray, " n"], groups: Int[np.ndarray, " n"], most: int, below: float
) -> Int[np.ndarray, " k"]:
    """Indices of the lowest values of each group, `most` of each, that are `below` a value."""
    order = np.lexsort((values, groups))
    _, begin, count = np.unique(groups[order], return_index=True, return_counts=True)
    rank = np.arange(len(order)) - np.repeat(begin, count)
    found: np.ndarray = order[(rank < most) & (values[order] < below)]
    return found


def scene_distance(
    scene: Scene, points: Float[np.ndarray, "*n 3"], times: Float[np.ndarray, "*m"]
) -> tuple[Float[np.ndarray, "*n"], Float[np.ndarray, "*n 3"]]:
    """Distance (m) of points in MuJoCo's world (z up) to a scene in ours, and its gradient in MuJoCo's.

    Args:
        scene: y up.
        points: metres.
        times: seconds on the scene's clock, broadcastable to ``[*n]``.
    """
    turn = TO_Y_UP["z"]
    ours = torch.from_numpy(points @ turn.T).requires_grad_()
    when = torch.from_numpy(np.broadcast_to(times, points.shape[:-1]).copy())
    with torch.enable_grad():
        distance = scene.distance(ours, when)
        (gradient,) = torch.autograd.grad(distance.sum(), ours)
    return distance.detach().double().numpy(), gradient.double().numpy() @ turn
