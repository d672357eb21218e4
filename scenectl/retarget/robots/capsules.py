"""A robot's own capsules, `scenectl body`'s, on MuJoCo's bodies: where they are, and how far from each other."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any
from weakref import WeakKeyDictionary

import numpy as np
from jaxtyping import Float, Int

from scenes.body.mjcf import geom_frame, geom_solid, geoms_of
from scenes.body.proxies import fit_part
from scenes.body.rig import Part
from scenes.errors import UserError
from scenes.mesh.content import joined
from scenes.motion.frames import transform

if TYPE_CHECKING:
    from scenectl.retarget.robots.humanoid import Humanoid

NEAR = 0.005
"""Metres between capsules of what is built to touch: as much as avoidance keeps free (`avoid.MARGIN`)."""
_SPACING = 1.0
"""Radii between samples of a capsule: at flat surfaces nothing is overlooked, 0.13 radii where a point touches."""
_FITTED: WeakKeyDictionary[Humanoid, Capsules] = WeakKeyDictionary()


@dataclass(frozen=True, eq=False)
class Capsules:
    """Capsules around the shapes of a robot's bodies.

    Attributes:
        model: MuJoCo's.
        bodies: the body that carries each, ``[C]``.
        ends: of their segments, in their bodies' frames, metres, ``[C, 2, 3]``.
        radii: metres, ``[C]``.
        sole: height (m) of what the robot stands on, where it stands in its file.
        limbs: of all bodies of the model, the one that stands for its limb (`Tree.limbs`), ``[nbody]``.
    """

    model: Any
    bodies: Int[np.ndarray, " C"]
    ends: Float[np.ndarray, "C 2 3"]
    radii: Float[np.ndarray, " C"]
    sole: float
    limbs: Int[np.ndarray, " nbody"]

    @cached_property
    def links(self) -> tuple[str, ...]:
        """The name of each one's body."""
        return tuple(self.model.body(int(body)).name for body in self.bodies)

    @cached_property
    def pairs(self) -> Int[np.ndarray, "P 2"]:
        """Capsules that shall not meet.

        Left out are those on one limb or on limbs that a joint joins (a hip's links lie in one another, and so do a
        hand's), those of bodies that the file excludes from contact, and those nearer than `NEAR` in the pose of the
        file: these were built that way, or their capsules are too thick there to tell anything. The same pairs are
        disabled first by MoveIt's setup assistant ("adjacent links" and "in collision by default").
        """
        model = self.model
        limbs = self.limbs[self.bodies]
        above = self.limbs[model.body_parentid[np.array([self._first(int(limb)) for limb in limbs])]]
        excluded = {(int(mark) >> 16, int(mark) & 0xFFFF) for mark in model.exclude_signature}
        first, second = np.triu_indices(len(self.bodies), k=1)
        apart = (limbs[first] != limbs[second]) & (above[first] != limbs[second]) & (above[second] != limbs[first])
        for one, other in excluded:
            a, b = self.bodies[first], self.bodies[second]
            apart &= ~(((a == one) & (b == other)) | ((a == other) & (b == one)))
        pairs = np.stack([first[apart], second[apart]], axis=1)
        places = self.placed(*poses(model, model.qpos0[None]))[0]
        gaps = segments_apart(places[pairs[:, 0]], places[pairs[:, 1]])[0] - self.radii[pairs].sum(axis=1)
        found: np.ndarray = pairs[gaps > NEAR]
        return found

    def _first(self, limb: int) -> int:
        """The first body of a limb: its parent is another's."""
        while self.limbs[self.model.body_parentid[limb]] == self.limbs[limb] and self.model.body_parentid[limb]:
            limb = int(self.model.body_parentid[limb])
        return limb

    @cached_property
    def samples(self) -> tuple[Float[np.ndarray, "S 3"], Int[np.ndarray, " S"]]:
        """Points on the segments in their bodies' frames (m), a radius apart at most, and the capsule of each."""
        points, owners = [], []
        for index, ((a, b), radius) in enumerate(zip(self.ends, self.radii, strict=True)):
            length = float(np.linalg.norm(b - a))
            share = np.linspace(0, 1, 1 + math.ceil(length / max(_SPACING * radius, length / 100, 1e-9)))
            points.append(a + share[:, None] * (b - a))
            owners += [index] * len(share)
        return np.concatenate(points), np.array(owners)

    @cached_property
    def rest_heights(self) -> Float[np.ndarray, " S"]:
        """How far (m) each sample's ball is over what the robot stands on at rest; soles reach a little below."""
        points, owners = self.samples
        placed = carried(*poses(self.model, self.model.qpos0[None]), self.bodies[owners], points)[0]
        heights: np.ndarray = placed[:, 2] - self.radii[owners] - self.sole
        return heights

    def placed(self, places: Float[np.ndarray, "T B 3"], turns: Float[np.ndarray, "T B 3 3"]) -> np.ndarray:
        """Ends ``[T, C, 2, 3]`` (m) where the bodies are."""
        both = [carried(places, turns, self.bodies, self.ends[:, end]) for end in range(2)]
        return np.stack(both, axis=2)

    def self_distances(
        self, places: Float[np.ndarray, "C 2 3"], reach: float = math.inf, among: Int[np.ndarray, " n"] | None = None
    ) -> Gaps:
        """Of those of `pairs` that are within `reach` (m), the capsules' ends being at ``places``; `among` some."""
        pairs = np.arange(len(self.pairs)) if among is None else among
        first, second = self.pairs[pairs].T
        distance, a, b = segments_apart(places[first], places[second])
        distance -= self.radii[first] + self.radii[second]
        near = np.flatnonzero(distance <= reach)
        return Gaps(pairs[near], distance[near], a[near], b[near])


@dataclass(frozen=True, eq=False)
class Gaps:
    """Between some of `Capsules.pairs`.

    Attributes:
        pairs: which, ``[k]``.
        distance: of their surfaces, metres, ``[k]``.
        a, b: nearest points of the segments, ``[k, 3]``.
    """

    pairs: Int[np.ndarray, " k"]
    distance: Float[np.ndarray, " k"]
    a: Float[np.ndarray, "k 3"]
    b: Float[np.ndarray, "k 3"]


def capsules_of(robot: Humanoid) -> Capsules:
    """Capsules around a robot's bodies, fitted once (a Unitree G1's in 2 s) and kept with the robot.

    Capsules and balls of the file stand for themselves; `fit_part` fits one around all else of a body, as for
    `scenectl body`.

    Raises:
        UserError: it has no shapes.
    """
    if robot not in _FITTED:
        _FITTED[robot] = _fitted(robot)
    return _FITTED[robot]


def _fitted(robot: Humanoid) -> Capsules:
    model, found, places, lowest = robot.model, [], poses(robot.model, robot.model.qpos0[None]), [math.inf]
    try:
        for body in range(1, model.nbody):
            collides, seen = geoms_of(model, body)
            geoms = collides or seen
            found += [(body, *own) for geom in geoms if (own := _own(model, geom)) is not None]
            if rest := [geom_solid(model, geom) for geom in geoms if _own(model, geom) is None]:
                fitted = fit_part(Part.of(model.body(body).name, np.eye(4), *joined(rest)))
                found += [(body, np.array([capsule.a, capsule.b]), capsule.radius) for capsule in fitted.capsules]
            for corners, _ in (geom_solid(model, geom) for geom in geoms):
                lowest.append(float(carried(*places, [body] * len(corners), corners)[..., 2].min()))
    except UserError as error:
        raise UserError(f"robot file '{robot.source}' {error}") from error
    if not found:
        raise UserError(f"robot file '{robot.source}' has no shapes on its bodies; export it with its meshes")
    bodies, ends, radii = zip(*found, strict=True)
    return Capsules(
        model, np.array(bodies), np.array(ends), np.array(radii), min(lowest), robot.tree.limbs(robot.joints.values())
    )


def _own(model: Any, geom: int) -> tuple[np.ndarray, float] | None:
    """Ends ``[2, 3]`` (m, body) and radius (m) of a geom that is a capsule or a sphere."""
    from mujoco import mjtGeom

    kind, (radius, half, _) = int(model.geom_type[geom]), model.geom_size[geom]
    if kind not in (int(mjtGeom.mjGEOM_CAPSULE), int(mjtGeom.mjGEOM_SPHERE)):
        return None
    along = half if kind == int(mjtGeom.mjGEOM_CAPSULE) else 0.0
    return transform(geom_frame(model, geom), np.array([[0.0, 0.0, -along], [0.0, 0.0, along]])), float(radius)


def poses(
    model: Any, qpos: Float[np.ndarray, "T Q"]
) -> tuple[Float[np.ndarray, "T B 3"], Float[np.ndarray, "T B 3 3"]]:
    """Where all bodies are at each of some frames: places (m) and rotations to the world."""
    import mujoco

    data = mujoco.MjData(model)
    places, turns = np.zeros((len(qpos), model.nbody, 3)), np.zeros((len(qpos), model.nbody, 3, 3))
    for frame, q in enumerate(qpos):
        data.qpos[:] = q
        mujoco.mj_kinematics(model, data)
        places[frame], turns[frame] = data.xpos, data.xmat.reshape(-1, 3, 3)
    return places, turns


def carried(
    places: Float[np.ndarray, "T B 3"],
    turns: Float[np.ndarray, "T B 3 3"],
    bodies: Sequence[int] | Int[np.ndarray, " n"],
    points: Float[np.ndarray, "n 3"],
) -> Float[np.ndarray, "T n 3"]:
    """World positions (m) of points in the frames of some bodies."""
    found: np.ndarray = places[:, bodies] + np.einsum("tnij,nj->tni", turns[:, bodies], points)
    return found


def segments_apart(
    first: Float[np.ndarray, "n 2 3"], second: Float[np.ndarray, "n 2 3"]
) -> tuple[Float[np.ndarray, " n"], Float[np.ndarray, "n 3"], Float[np.ndarray, "n 3"]]:
    """Distance (m) between segments and their nearest points (Ericson, Real-Time Collision Detection, 5.1.9)."""
    p, d = first[:, 0], first[:, 1] - first[:, 0]
    q, e = second[:, 0], second[:, 1] - second[:, 0]
    r = p - q
    a, b, f = (d * d).sum(-1), (d * e).sum(-1), (e * e).sum(-1)
    c, g = (d * r).sum(-1), (e * r).sum(-1)
    least = 1e-12  # square metres: shorter segments are points, and shares on them are 0
    across = a * f - b * b
    s = np.where(across > 1e-9 * a * f, np.clip((b * g - c * f) / np.where(across > 0, across, 1), 0, 1), 0.0)
    t = np.where(f > least, (b * s + g) / np.where(f > least, f, 1), 0.0)
    inner = np.clip(t, 0, 1)
    s = np.where(a > least, np.clip((b * inner - c) / np.where(a > least, a, 1), 0, 1), 0.0)
    one, other = p + s[:, None] * d, q + inner[:, None] * e
    return np.linalg.norm(one - other, axis=-1), one, other
