"""Rigid objects that move: each keeps one grid in a frame of its own, and questions are carried into that frame.

Nothing is baked again while an object moves: a point at a time becomes a point of the object's frame, where the
object rests, and gradients find their way back through that change of frame. The exact distances that score motions
take the same way to the object's triangles.
"""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial
from itertools import pairwise
from typing import Any

import numpy as np
import torch
from jaxtyping import Bool, Float
from torch import Tensor

from scenes.errors import UserError, shown
from scenes.mesh.mesh import Mesh, hull
from scenes.mesh.primitives import Plane, Primitive
from scenes.mesh.surface import Surface
from scenes.motion.frames import rotations
from scenes.motion.waypoints import Number, Vector, Waypoints, clock, moment
from scenes.numbers import finite
from scenes.sdf.bake import Bake, bake
from scenes.sdf.exact import signed_distance
from scenes.sdf.field import DistanceField
from scenes.sdf.free_space import Sides, decide
from scenes.sdf.grid import SdfGrid
from scenes.sdf.settings import Cache, check_resolution

PADDING = 0.3
"""Metres of grid around an object. Beyond its grid a distance is a bound from below (see `SdfGrid.distance`), which is
more than this: more than the thickest part of a body and its margin, so that nothing there counts as touched."""

AWAY = 10.0
"""Distance (m) of what is elsewhere: more than anything asks for."""

HALF_TURN = 1e-3
"""A turn may exceed a half by twice this many radians and still go the way it was stated: people write 3.1416."""


@dataclass(frozen=True)
class Trajectory:
    """Where a rigid object is over time: straight lines and even turns between poses, held at both ends.

    A point p of the object is at ``rotation @ p + position`` in the world. Turns go the shorter way (spherical linear
    interpolation); a half turn of headings goes the way their numbers say.

    Attributes:
        times: seconds on the task's clock, ``[K]``, strictly increasing.
        positions: of the origin of the object's frame, metres, world, ``[K, 3]``.
        headings: radians about +y, ``[K]``, pi/2 turns +z to +x; or None.
        quaternions: rotations as (w, x, y, z), ``[K, 4]``; or None. Without either the object doesn't turn.

    Raises:
        UserError: not as many of each as times, times that don't increase, both kinds of rotation, or a quaternion
            whose length is not 1 (to 1 %).
    """

    times: Sequence[Number]
    positions: Sequence[Vector]
    headings: Sequence[Number] | None = None
    quaternions: Sequence[Sequence[Number]] | None = None

    def __post_init__(self) -> None:
        way = Waypoints(self.times, self.positions)
        object.__setattr__(self, "times", way.times)
        object.__setattr__(self, "positions", way.positions)
        if self.headings is not None and self.quaternions is not None:
            raise UserError("a trajectory states both headings and quaternions; keep one of them")
        for name, size in (("headings", 1), ("quaternions", 4)):
            if (given := getattr(self, name)) is not None:
                object.__setattr__(self, name, _rows(name, given, len(way.times), size))

    @cached_property
    def way(self) -> Waypoints:
        """The positions alone."""
        return Waypoints(self.times, self.positions)

    def moved(self, by: Vector) -> Trajectory:
        """The same elsewhere, by so much (m)."""
        return replace(self, positions=self.way.moved(by).positions)

    @property
    def turns(self) -> bool:
        """The rotation changes over time."""
        return bool(self._legs[3].any())

    def at(self, time: Float[Tensor, "*t"]) -> tuple[Float[Tensor, "*t 3"], Float[Tensor, "*t 3 3"]]:
        """Position (m) and rotation matrix at each time (s), differentiable in time."""
        leg, share = self.way.leg(time)
        still, swing, lean, angle = (time.new_tensor(part)[leg] for part in self._legs)
        turned = (share * angle)[..., None, None]
        return self.way.at(time), still + turned.sin() * swing + (1 - turned.cos()) * lean

    @cached_property
    def _legs(self) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """R, R [n], R [n]^2, each ``[L, 3, 3]``, and the angle (rad, ``[L]``) that each leg turns about n.

        By Rodrigues' formula the rotation is R exp(a [n]) = R + sin(a) R [n] + (1 - cos(a)) R [n]^2 after the angle a.
        """
        axis, angle = self._steps
        cross = np.cross(axis[:, None], np.eye(3)).transpose(0, 2, 1)  # its columns are n x e
        still = rotations(self._unit[: len(axis)])
        return still, still @ cross, still @ cross @ cross, angle

    @cached_property
    def _steps(self) -> tuple[np.ndarray, np.ndarray]:
        """Axis ``[L, 3]``, in the frame where the leg begins, and angle ``[L]`` (rad, 0 to about pi) of each leg."""
        if len(self.times) == 1:
            return np.zeros((1, 3)), np.zeros(1)
        a, b = self._unit[:-1], self._unit[1:]
        scalar = (a * b).sum(axis=1)
        vector = a[:, :1] * b[:, 1:] - b[:, :1] * a[:, 1:] - np.cross(a[:, 1:], b[:, 1:])
        shorter = np.where(scalar < -HALF_TURN, -1.0, 1.0)  # q and -q are the same rotation
        sine = np.linalg.norm(vector, axis=1)
        axis = shorter[:, None] * vector / np.maximum(sine, 1e-300)[:, None]
        return axis, 2 * np.arctan2(sine, shorter * scalar)

    @property
    def _unit(self) -> np.ndarray:
        """Unit quaternions (w, x, y, z), ``[K, 4]``."""
        if self.quaternions is not None:
            given = np.array(self.quaternions)
            return np.asarray(given / np.linalg.norm(given, axis=1, keepdims=True))
        half = np.zeros(len(self.times)) if self.headings is None else np.array(self.headings) / 2
        return np.stack([np.cos(half), np.zeros_like(half), np.sin(half), np.zeros_like(half)], axis=1)


def _rows(name: str, given: Sequence[Number] | Sequence[Sequence[Number]], count: int, size: int) -> tuple[object, ...]:
    """Headings or quaternions as tuples of floats."""
    wanted = "radians" if size == 1 else "w, x, y, z"
    entries: Any = given
    try:
        rows = np.array([row if size == 1 else list(row) for row in entries], dtype=object)
        rows = np.vectorize(partial(finite, what=f"trajectory {name}"), otypes=[np.float64])(rows)
    except (TypeError, ValueError) as error:
        raise UserError(f"trajectory {name} are {shown(given)}; give {wanted}, finite numbers") from error
    if rows.shape != ((count,) if size == 1 else (count, size)):
        what = "one angle (rad)" if size == 1 else "four numbers w, x, y, z"
        raise UserError(f"trajectory {name} have shape {list(rows.shape)} for {count} times; give {what} for each time")
    if size == 1:
        return tuple(rows.tolist())
    lengths = np.linalg.norm(rows, axis=1)
    worst = int(np.abs(lengths - 1).argmax())
    if abs(lengths[worst] - 1) > 0.01:
        raise UserError(
            f"trajectory quaternion {worst} has length {lengths[worst]:.3g}; give unit quaternions w, x, y, z"
        )
    return tuple(tuple(row) for row in rows.tolist())


@dataclass(frozen=True, eq=False)
class MovingObject:
    """A rigid object on a trajectory: a distance field of its own.

    What a mesh encloses is solid, whichever way it faces. A mesh is baked when distances are first asked for.

    Attributes:
        shape: a mesh, a primitive at rest, or a grid that was baked before, in the object's own frame (m).
        trajectory: where that frame is over time.
        name: for reports; by default the mesh's.
        resolution: nodes along the longest side of a mesh's grid, 8 to 512.
        cache: folder of bakes, "default", or None.
        gone: from when to when (s) it is elsewhere, as in somebody's hands: nothing is at its place.
        loose: it is a thing of its own, which can be taken; a part of a mesh is not.

    Raises:
        UserError: a plane, a primitive with a motion of its own, or the grid of a room (all else would be solid).
    """

    shape: Mesh | Primitive | SdfGrid | Bake[SdfGrid]
    trajectory: Trajectory
    name: str = ""
    resolution: int = 128
    cache: Cache = "default"
    gone: tuple[tuple[float, float], ...] = ()
    loose: bool = True

    def __post_init__(self) -> None:
        check_resolution(self.resolution)
        shape = self.shape
        if not self.name:
            name = shape.name if isinstance(shape, Mesh) else type(shape).__name__.lower()
            object.__setattr__(self, "name", name)
        if isinstance(shape, Plane):
            raise UserError(f"object '{self.name}' is a plane, which has no end; use a large box")
        if getattr(shape, "motion", None) is not None:
            raise UserError(f"object '{self.name}' has a motion inside its trajectory; keep one of them")
        grid = shape.grid if isinstance(shape, Bake) else shape
        if isinstance(grid, SdfGrid) and grid.beyond < 0:
            raise UserError(f"object '{self.name}' is the grid of a room, solid all around; bake a closed object")

    @cached_property
    def bake(self) -> Bake[SdfGrid] | None:
        """The bake of a mesh, or the one that was given; None for the other shapes."""
        if isinstance(self.shape, Mesh):
            return bake(self.shape, self.resolution, padding=PADDING, free_space="outside", cache=self.cache)
        return self.shape if isinstance(self.shape, Bake) else None

    @property
    def field(self) -> DistanceField:
        """The distance field in the object's own frame."""
        if self.bake is not None:
            return self.bake.grid
        assert not isinstance(self.shape, Mesh | Bake)
        return self.shape

    def _grid(self) -> SdfGrid:
        assert isinstance(self.field, SdfGrid)
        return self.field

    @property
    def lipschitz(self) -> float:
        """The most by which `distance` changes over a metre, m/m: what its own field states, 1 for exact distances."""
        return float(getattr(self.field, "lipschitz", 1.0))

    @cached_property
    def solid(self) -> Mesh:
        """Its triangles in its own frame; those of a grid lie where the interpolant is 0."""
        if isinstance(self.shape, Mesh):
            return self.shape
        if isinstance(self.shape, Bake | SdfGrid):
            return _zero_level(self.shape if isinstance(self.shape, SdfGrid) else self.shape.grid, self.name)
        return self.shape.mesh()

    def local(self, points: Float[Tensor, "*b 3"], time: Tensor | None = None) -> Float[Tensor, "*b 3"]:
        """World points (m) in the object's frame at `time` (s; 0 s when None)."""
        position, rotation = self.trajectory.at(clock(time, points))
        x, y, z = (points - position).split(1, dim=-1)
        return x * rotation[..., 0, :] + y * rotation[..., 1, :] + z * rotation[..., 2, :]

    def turned(self, vectors: Float[Tensor, "*b 3"], time: Tensor | None = None) -> Float[Tensor, "*b 3"]:
        """Vectors of the object's frame as they are in the world at `time` (s; 0 s when None)."""
        _, rotation = self.trajectory.at(clock(time, vectors))
        return (rotation @ vectors[..., None])[..., 0]

    def world(self, points: Float[Tensor, "*b 3"], time: Tensor | None = None) -> Float[Tensor, "*b 3"]:
        """Points of the object's frame (m) in the world at `time` (s; 0 s when None)."""
        position, _ = self.trajectory.at(clock(time, points))
        return self.turned(points, time) + position

    def distance(self, points: Float[Tensor, "*b 3"], time: Tensor | None = None) -> Float[Tensor, "*b"]:
        """Signed distance (m, positive outside), differentiable once in points and time.

        Args:
            points: metres, world.
            time: seconds on the task's clock, broadcastable to ``points[..., 0]``; None means 0 s.
        """
        distance = self.field.distance(self.local(points, time))
        return torch.where(self._away(clock(time, points)), AWAY, distance) if self.gone else distance

    def _away(self, time: Float[Tensor, "*t"]) -> Bool[Tensor, "*t"]:
        """Whether it is elsewhere at each time (s)."""
        away = torch.zeros_like(time, dtype=torch.bool)
        for begin, end in self.gone:
            away = away | ((time > begin) & (time < end))
        return away

    def distance_exact(self, points: np.ndarray, time: np.ndarray | float | None = None) -> np.ndarray:
        """Signed distance (m) from the triangles, or the analytic shape, at the given times.

        Args:
            points: ``[n, 3]`` float64 metres, world.
            time: seconds, scalar or ``[n]``; None means 0 s.

        Returns:
            ``[n]`` float64 metres, positive outside.
        """
        when = None if time is None else torch.as_tensor(np.asarray(time, dtype=np.float64))
        given = torch.from_numpy(np.ascontiguousarray(points))
        local = self.local(given, when)
        if isinstance(self.shape, Mesh | Bake | SdfGrid):
            found = signed_distance(self._sides, np.ascontiguousarray(local.numpy()), self._grid)
        else:
            found = self.shape.distance(local).numpy()
        return np.where(self._away(clock(when, given)).numpy(), AWAY, found) if self.gone else found

    @cached_property
    def _sides(self) -> Sides:
        surface = Surface.of(self.solid)
        return decide(surface, "outside", surface.bounds, self.name)

    def moved(self, by: Vector) -> MovingObject:
        """The same on a trajectory elsewhere, by so much (m)."""
        return replace(self, trajectory=self.trajectory.moved(by))

    def mesh(self, time: Number = 0.0) -> Mesh:
        """Its triangles where they are at `time` (s), world metres."""
        position, rotation = (part.numpy() for part in self.trajectory.at(moment(time)))
        solid = self.solid
        return Mesh(solid.vertices @ rotation.T + position, solid.faces, self.name, solid.source, solid.unit, solid.up)

    @cached_property
    def bounds(self) -> np.ndarray:
        """Lowest and highest corner over its whole way, ``[2, 3]``, world metres; turns are followed in small steps."""
        times, fine = self.trajectory.times, self.trajectory.turns
        moments = np.unique(
            np.concatenate([np.linspace(a, b, 17 if fine else 2) for a, b in pairwise((*times, times[-1]))])
        )
        return hull([self.mesh(float(time)).bounds for time in moments])

    @cached_property
    def digest(self) -> str:
        """SHA-256 of everything that its distances depend on, hexadecimal."""
        shape = self.shape
        if isinstance(shape, Mesh):
            what: object = (shape.digest, self.resolution)
        elif isinstance(shape, Bake | SdfGrid):
            grid = shape if isinstance(shape, SdfGrid) else shape.grid
            what = (
                hashlib.sha256(grid.arrays()["values"].tobytes()).hexdigest(),
                grid.origin.tolist(),
                grid.spacing,
                grid.margin,
            )
        else:
            what = shape
        return hashlib.sha256(repr((what, self.trajectory, *self.gone)).encode()).hexdigest()


def _zero_level(grid: SdfGrid, name: str) -> Mesh:
    from skimage.measure import marching_cubes

    try:
        vertices, faces, _, _ = marching_cubes(grid.arrays()["values"], 0.0)
    except ValueError as error:
        raise UserError(f"object '{name}' is a grid that is nowhere 0, so it has no surface; bake it again") from error
    return Mesh(grid.nodes(vertices), faces, name, "grid")
