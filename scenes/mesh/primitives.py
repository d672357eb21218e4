"""Analytic shapes with exact distances, shapes that move, and solids cut from other solids."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import MISSING, dataclass, fields, replace
from typing import Any, TypeAlias, TypeVar

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from scenes.errors import UserError, clipped, did_you_mean, shown
from scenes.mesh.mesh import Mesh
from scenes.motion.frames import about_y, shifted
from scenes.motion.waypoints import Number, Vector, Waypoints, moment
from scenes.numbers import finite, positive, vector


def _sizes(value: Any, what: str) -> tuple[float, float, float]:
    x, y, z = (positive(length, what) for length in vector(value, what))
    return x, y, z


def _motion(value: Any, what: str) -> Waypoints | None:
    """Waypoints, or a table of them as a task file states it."""
    if value is None or isinstance(value, Waypoints):
        return value
    if not isinstance(value, dict) or set(value) != {"times", "positions"}:
        keys = f"one with {', '.join(repr(key) for key in value)}" if isinstance(value, dict) else shown(value)
        raise UserError(f"{what} is a table of exactly 'times' and 'positions', not {clipped(keys)}")
    if not all(isinstance(entry, list | tuple) for entry in value.values()):
        raise UserError(f"the 'times' and 'positions' of a {what} are lists, not {shown(value)}")
    return Waypoints(**value)


AnyShape = TypeVar("AnyShape", bound="_Shape")

_PLACES = ("center", "a", "b", "point")
"""Fields of shapes that are places in the world."""

_CHECKS: dict[str, Callable[[Any, str], Any]] = {
    **dict.fromkeys((*_PLACES, "normal"), vector),
    **dict.fromkeys(("radius", "height"), positive),
    "size": _sizes,
    "yaw": finite,
    "motion": _motion,
}
"""What becomes of a shape's field, by its name."""


class _Shape:
    """Fields of a shape are checked, and stored as floats."""

    def __post_init__(self) -> None:
        for entry in fields(self):  # type: ignore[arg-type]  # every shape is a dataclass
            object.__setattr__(self, entry.name, self.checked(entry.name, getattr(self, entry.name)))

    @classmethod
    def checked(cls, name: str, value: Any) -> Any:
        """What a field becomes; raises UserError for a value that it cannot have."""
        return _CHECKS[name](value, f"{cls.__name__.lower()} {'end ' if name in ('a', 'b') else ''}{name}")

    def moved(self: AnyShape, by: Vector) -> AnyShape:
        """The same elsewhere, by so much (m)."""
        stated = vars(self)
        new: dict[str, Any] = {name: shifted(stated[name], by) for name in _PLACES if name in stated}
        if stated.get("motion") is not None:
            new["motion"] = stated["motion"].moved(by)
        return replace(self, **new)  # type: ignore[type-var]  # every shape is a dataclass


@dataclass(frozen=True)
class Box(_Shape):
    """A box, upright, turned by `yaw`.

    Attributes:
        center: metres, world.
        size: full edge lengths along its own x, y and z, metres.
        yaw: radians about +y; +pi/2 turns its +z axis to +x.
    """

    center: Vector
    size: Vector
    yaw: Number = 0.0

    def distance(self, points: Float[Tensor, "*b 3"], time: Tensor | None = None) -> Float[Tensor, "*b"]:
        """Exact signed distance (m, positive outside) at `points` (m); `time` is ignored, a box does not move."""
        local = (points - points.new_tensor(self.center)) @ points.new_tensor(about_y(self.yaw))
        q = local.abs() - points.new_tensor(self.size) / 2
        outside: Tensor = torch.linalg.vector_norm(q.clamp_min(0), dim=-1)
        return outside + q.amax(dim=-1).clamp_max(0)

    def mesh(self) -> Mesh:
        """Its surface as 12 triangles facing outward."""
        import trimesh

        solid = trimesh.creation.box(extents=self.size)
        return Mesh(solid.vertices @ about_y(self.yaw).T + self.center, solid.faces, "box", "primitive")


@dataclass(frozen=True)
class Sphere(_Shape):
    """A ball.

    Attributes:
        center: metres, world; where `motion` is given, only a note of where it starts.
        radius: metres.
        motion: where the centre is over time, or None for a ball at rest.
    """

    center: Vector
    radius: Number
    motion: Waypoints | None = None

    def center_at(self, time: Tensor | None, like: Tensor) -> Float[Tensor, "*t 3"]:
        """Centre (m) at `time` (s); at 0 s when None."""
        return like.new_tensor(self.center) if self.motion is None else self.motion.offset(time, like)

    def distance(self, points: Float[Tensor, "*b 3"], time: Tensor | None = None) -> Float[Tensor, "*b"]:
        """Exact signed distance (m, positive outside) at `points` (m) and `time` (s; 0 s when None)."""
        away: Tensor = torch.linalg.vector_norm(points - self.center_at(time, points), dim=-1)
        return away - self.radius

    def mesh(self, time: Number = 0.0) -> Mesh:
        """Its surface at `time` (s) as 1280 triangles facing outward, vertices on the sphere."""
        import trimesh

        solid = trimesh.creation.icosphere(subdivisions=3, radius=self.radius)
        center = self.center_at(moment(time), moment(time)).numpy()
        return Mesh(solid.vertices + center, solid.faces, "sphere", "primitive")


@dataclass(frozen=True)
class Capsule(_Shape):
    """All points within `radius` of the segment from `a` to `b`.

    Attributes:
        a, b: ends of the segment, metres, world.
        radius: metres.
        motion: where the segment's midpoint is over time (it moves without turning), or None at rest.
    """

    a: Vector
    b: Vector
    radius: Number
    motion: Waypoints | None = None

    def ends_at(self, time: Tensor | None, like: Tensor) -> tuple[Float[Tensor, "*t 3"], Float[Tensor, "*t 3"]]:
        """Both ends (m) at `time` (s); at 0 s when None."""
        a, b = like.new_tensor(self.a), like.new_tensor(self.b)
        if self.motion is None:
            return a, b
        middle, half = self.motion.offset(time, like), (b - a) / 2
        return middle - half, middle + half

    def distance(self, points: Float[Tensor, "*b 3"], time: Tensor | None = None) -> Float[Tensor, "*b"]:
        """Exact signed distance (m, positive outside) at `points` (m) and `time` (s; 0 s when None)."""
        a, _ = self.ends_at(time, points)
        axis = points.new_tensor(self.b) - points.new_tensor(self.a)
        squared = axis.square().sum().clamp_min(torch.finfo(points.dtype).tiny)
        along = (((points - a) * axis).sum(-1, keepdim=True) / squared).clamp(0.0, 1.0)
        away: Tensor = torch.linalg.vector_norm(points - a - along * axis, dim=-1)
        return away - self.radius

    def mesh(self, time: Number = 0.0) -> Mesh:
        """Its surface at `time` (s) as triangles facing outward, vertices on the capsule."""
        import trimesh

        a, b = (end.numpy() for end in self.ends_at(moment(time), moment(time)))
        length = float(np.linalg.norm(b - a))
        solid = trimesh.creation.capsule(height=length, radius=self.radius, count=(24, 24))
        direction = (b - a) / length if length > 0 else np.array([0.0, 0.0, 1.0])
        turned = trimesh.geometry.align_vectors([0.0, 0.0, 1.0], direction)[:3, :3]
        centred = solid.vertices - solid.bounds.mean(axis=0)
        return Mesh(centred @ turned.T + (a + b) / 2, solid.faces, "capsule", "primitive")


@dataclass(frozen=True)
class Cylinder(_Shape):
    """An upright cylinder.

    Attributes:
        center: metres, world, at half its height.
        radius, height: metres.
    """

    center: Vector
    radius: Number
    height: Number

    def distance(self, points: Float[Tensor, "*b 3"], time: Tensor | None = None) -> Float[Tensor, "*b"]:
        """Exact signed distance (m, positive outside) at `points` (m); `time` is ignored."""
        local = points - points.new_tensor(self.center)
        side = torch.linalg.vector_norm(local[..., [0, 2]], dim=-1) - self.radius
        q = torch.stack([side, local[..., 1].abs() - self.height / 2], dim=-1)
        outside: Tensor = torch.linalg.vector_norm(q.clamp_min(0), dim=-1)
        return outside + q.amax(dim=-1).clamp_max(0)

    def mesh(self) -> Mesh:
        """Its surface as triangles facing outward, the rim with 48 corners on the circle."""
        import trimesh

        solid = trimesh.creation.cylinder(radius=self.radius, height=self.height, sections=48)
        upright = solid.vertices[:, [1, 2, 0]]  # a cyclic change of axes keeps the triangles facing outward
        return Mesh(upright + self.center, solid.faces, "cylinder", "primitive")


@dataclass(frozen=True)
class Plane(_Shape):
    """The half space behind a plane.

    Attributes:
        point: any point of the plane, metres, world.
        normal: towards free space; any length but 0.
    """

    point: Vector
    normal: Vector = (0.0, 1.0, 0.0)

    def __post_init__(self) -> None:
        super().__post_init__()
        length = math.sqrt(sum(n * n for n in self.normal))
        if length == 0:
            raise UserError("plane normal is (0, 0, 0); give the direction in which space is free")
        object.__setattr__(self, "normal", tuple(n / length for n in self.normal))

    def distance(self, points: Float[Tensor, "*b 3"], time: Tensor | None = None) -> Float[Tensor, "*b"]:
        """Exact signed distance (m, positive in front) at `points` (m); `time` is ignored."""
        return (points - points.new_tensor(self.point)) @ points.new_tensor(self.normal)

    def mesh(self, extent: float = 20.0) -> Mesh:
        """A square of side `extent` metres around `point`, facing along the normal: for pictures."""
        normal = np.array(self.normal)
        helper = np.eye(3)[np.abs(normal).argmin()]
        u = np.cross(helper, normal)
        u /= np.linalg.norm(u)
        v = np.cross(normal, u)
        corners = [np.array(self.point) + extent / 2 * (s * u + t * v) for s, t in ((-1, -1), (1, -1), (1, 1), (-1, 1))]
        return Mesh(np.array(corners), np.array([[0, 1, 2], [0, 2, 3]]), "plane", "primitive")


Primitive: TypeAlias = Box | Sphere | Capsule | Cylinder | Plane

PRIMITIVES: dict[str, type[Primitive]] = {
    "box": Box,
    "sphere": Sphere,
    "capsule": Capsule,
    "cylinder": Cylinder,
    "plane": Plane,
}
"""Shapes by the name that task files use."""


def primitive(shape: str, **parameters: Any) -> Primitive:
    """Build a shape from plain values, as a task file states them.

    ``motion`` may be a mapping ``{"times": [...], "positions": [[x, y, z], ...]}``. Raises UserError for an unknown
    shape, an unknown parameter (naming the nearest) or a missing one.
    """
    if shape not in PRIMITIVES:
        raise UserError(f"unknown primitive '{shape}'{did_you_mean(shape, PRIMITIVES)}")
    kind = PRIMITIVES[shape]
    known = kind.__dataclass_fields__
    for name in parameters:
        if name not in known:
            raise UserError(f"primitive '{shape}': unknown parameter '{name}'{did_you_mean(name, known)}")
    missing = [name for name, entry in known.items() if entry.default is MISSING and name not in parameters]
    if missing:
        raise UserError(f"primitive '{shape}': missing {' and '.join(missing)}; it takes {', '.join(known)}")
    return kind(**{name: kind.checked(name, value) for name, value in parameters.items()})
