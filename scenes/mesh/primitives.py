"""Analytic shapes with exact distances, shapes that move, and solids cut from other solids."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import MISSING, dataclass, fields
from functools import reduce
from typing import Any, TypeAlias

import numpy as np
import torch
from jaxtyping import Float, Int
from torch import Tensor

from scenes.errors import UserError, did_you_mean
from scenes.mesh.mesh import Mesh
from scenes.motion.frames import about_y
from scenes.numbers import finite, positive, vector

Number: TypeAlias = float | int
Vector: TypeAlias = Sequence[Number]
"""Three numbers x, y, z; stored as a tuple of floats."""


@dataclass(frozen=True)
class Waypoints:
    """Positions at times: straight lines between them, held before the first and after the last.

    Attributes:
        times: seconds on the task's clock, ``[K]``, strictly increasing.
        positions: metres, world, ``[K, 3]``.
    """

    times: Sequence[Number]
    positions: Sequence[Vector]

    def __post_init__(self) -> None:
        times = tuple(finite(time, f"waypoint time {i}") for i, time in enumerate(self.times))
        positions = tuple(vector(p, f"waypoint {i}") for i, p in enumerate(self.positions))
        if len(times) == 0 or len(times) != len(positions):
            raise UserError(f"waypoints have {len(times)} times and {len(positions)} positions; give as many of each")
        if any(b <= a for a, b in zip(times, times[1:], strict=False)):
            raise UserError(f"waypoint times are {list(times)}; give seconds, each later than the one before")
        object.__setattr__(self, "times", times)
        object.__setattr__(self, "positions", positions)

    def at(self, time: Float[Tensor, "*t"]) -> Float[Tensor, "*t 3"]:
        """Position (m) at each time (s), differentiable in time."""
        leg, share = self.leg(time)
        steps = np.diff(self.positions, axis=0) if len(self.times) > 1 else np.zeros((1, 3))
        return time.new_tensor(self.positions)[leg] + share.unsqueeze(-1) * time.new_tensor(steps)[leg]

    def leg(self, time: Float[Tensor, "*t"]) -> tuple[Int[Tensor, "*t"], Float[Tensor, "*t"]]:
        """Which of the K - 1 legs each time (s) belongs to, and the share of it that has passed, 0 to 1.

        A single waypoint counts as one leg, of which nothing ever passes.
        """
        if len(self.times) == 1:
            return torch.zeros_like(time, dtype=torch.long), torch.zeros_like(time)
        times = time.new_tensor(self.times)
        leg = (torch.bucketize(time.detach(), times) - 1).clamp(0, len(self.times) - 2)
        return leg, ((time - times[leg]) / (times[leg + 1] - times[leg])).clamp(0.0, 1.0)

    def offset(self, time: Tensor | None, like: Tensor) -> Tensor:
        """Position at `time`, or at 0 s when no time is given, with the type and device of `like`."""
        return self.at(clock(time, like))


def clock(time: Tensor | None, like: Tensor) -> Tensor:
    """A time (s) with the type and device of `like`; 0 s when none is given."""
    return like.new_zeros(()) if time is None else torch.as_tensor(time).to(like)


def moment(time: Number) -> Float[Tensor, ""]:
    """One time (s) in double precision."""
    return torch.tensor(time, dtype=torch.float64)


def _sizes(value: Any, what: str) -> tuple[float, float, float]:
    x, y, z = (positive(length, what) for length in vector(value, what))
    return x, y, z


def _motion(value: Any, what: str) -> Waypoints | None:
    """Waypoints, or a table of them as a task file states it."""
    if value is None or isinstance(value, Waypoints):
        return value
    if not isinstance(value, dict) or set(value) != {"times", "positions"}:
        raise UserError(f"{what} is a table of exactly 'times' and 'positions', not {value!r}")
    if not all(isinstance(entry, list | tuple) for entry in value.values()):
        raise UserError(f"the 'times' and 'positions' of a {what} are lists, not {value!r}")
    return Waypoints(**value)


_CHECKS: dict[str, Callable[[Any, str], Any]] = {
    **dict.fromkeys(("center", "a", "b", "point", "normal"), vector),
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


def csg(op: str, *parts: Primitive | Mesh) -> Mesh:
    """Combine solids into one closed mesh, through manifold3d.

    Args:
        op: "union", "difference" (the first minus all others) or "intersection".
        parts: closed meshes facing outward, or primitives (their meshes at 0 s); at least one, no planes.

    Raises:
        UserError: unknown op, no parts, a part that is not a closed solid, or nothing left.
    """
    import manifold3d

    symbols = {"union": lambda a, b: a + b, "difference": lambda a, b: a - b, "intersection": lambda a, b: a ^ b}
    if op not in symbols:
        raise UserError(f"unknown CSG operation '{op}'{did_you_mean(op, symbols)}")
    if not parts:
        raise UserError(f"CSG {op} of nothing; give at least one solid")
    result = reduce(symbols[op], [_solid(part, index, manifold3d) for index, part in enumerate(parts)])
    mesh = result.to_mesh64()
    if len(mesh.tri_verts) == 0:
        raise UserError(f"CSG {op} leaves nothing; check the places and sizes of its {len(parts)} parts")
    return Mesh(np.asarray(mesh.vert_properties)[:, :3], np.asarray(mesh.tri_verts), op, f"csg {op}")


def _solid(part: Primitive | Mesh, index: int, manifold3d: Any) -> Any:
    if isinstance(part, Plane):
        raise UserError(f"CSG part {index} is a plane, which has no volume; use a large box")
    mesh = part if isinstance(part, Mesh) else part.mesh()
    from scenes.mesh.surface import clean

    vertices, faces, _, _ = clean(mesh.vertices, mesh.faces)
    solid = manifold3d.Manifold(manifold3d.Mesh64(vertices, faces.astype(np.uint64)))
    if solid.status() != manifold3d.Error.NoError or solid.volume() <= 0:
        raise UserError(
            f"CSG part {index} ('{mesh.name}') is not a closed solid facing outward ({solid.status().name}); repair it"
        )
    return solid
