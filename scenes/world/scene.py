"""Scenes: meshes, analytic shapes, objects that move and a floor, as one distance field."""

from __future__ import annotations

import copy
import hashlib
import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import cached_property, partial, reduce
from itertools import chain
from pathlib import Path
from typing import Any, Unpack

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from scenes.errors import UserError, clipped, did_you_mean
from scenes.mesh.mesh import Mesh, hull, load_mesh
from scenes.mesh.primitives import Capsule, Plane, Primitive, Sphere
from scenes.mesh.surface import Surface, thin_walls
from scenes.motion.frames import HOME, Place, back, shifted
from scenes.numbers import WIDEST, finite
from scenes.sdf.bake import Bake, bake
from scenes.sdf.bake_blocks import bake_blocks
from scenes.sdf.exact import signed_distance
from scenes.sdf.field import DistanceField
from scenes.sdf.free_space import Sides, decide
from scenes.sdf.lattice import Lattice, padded
from scenes.sdf.settings import BakeOptions, BakeSettings, FreeSpace
from scenes.world.floor.ground import Floor, find_floors
from scenes.world.floor.levels import STEP, Levels, fitting
from scenes.world.floor.mapping import held, surfaces
from scenes.world.moving import MovingObject, Trajectory
from scenes.world.reach import Parts, Reach
from scenes.world.things import named_parts

DENSE = 2**26
"""Nodes up to which a stated spacing gives a dense grid: 256 MB."""

_FRAME = (
    "the scene is far from the origin, where single precision is too coarse, so it is computed in a frame that begins "
    "at {} m, in which what is said of its grids, of walks and of goals states places; starts and results are stated "
    "in the world; move the scene to settle it"
)
"""What is said of a scene in a frame of its own."""

SAME = 0.01
"""Metres by which a part that is baked alone may seem farther than the scene with it, and be what is nearest still."""

BUNDLED = Path(__file__).parents[1] / "bundled"


class Scene:
    """What a person can meet: any mix of meshes, primitives and objects that move, and the floor.

    Meshes are baked when distances are first asked for (or read from the cache), so that a scene can be described and
    checked at no cost.
    """

    def __init__(
        self,
        meshes: Sequence[Mesh] = (),
        primitives: Sequence[Primitive] = (),
        floor: float | int | None = None,
        *,
        objects: Sequence[MovingObject] = (),
        name: str = "scene",
        origin: Place = HOME,
        soft: Mapping[str, float] | None = None,
        **baking: Unpack[BakeOptions],
    ) -> None:
        """Describe a scene.

        Args:
            meshes: each is baked into a grid of its own.
            primitives: analytic shapes, which may move.
            floor: height (m) on which soles stand. Stated, or without meshes (then 0), it is a plane that is part of
                the distance; otherwise the floor is that of the meshes, found when asked for.
            objects: rigid things on trajectories, each with a grid of its own; never taken for the floor.
            name: for reports.
            origin: where in the world (m) the frame begins that all coordinates here are stated in.
            soft: by how much (m) some of its parts give, such as cushions, by name (`part`).
            **baking: how each mesh is baked, any of `BakeSettings`. A seed point for `free_space` applies to the meshes
                whose bounds hold it, and must lie within at least one; the others are solid inside. Where a dense grid
                of a stated `spacing` would be large, its nodes are kept near surfaces only (see
                `scenes.sdf.bake_blocks.bake_blocks`).
        """
        self.meshes = tuple(meshes)
        self.primitives = tuple(primitives)
        self.objects = tuple(objects)
        self.baking = BakeSettings(**baking)
        self.name = name
        self.origin = origin
        self.soft = dict(soft or {})
        self.reach: Reach | None = None
        self.stated_floor = 0.0 if floor is None and not self.meshes else floor
        if self.stated_floor is not None:
            finite(self.stated_floor, f"scene '{name}': the floor height")

    @classmethod
    def empty(cls, floor: float | int = 0.0) -> Scene:
        """A floor plane and nothing else."""
        return cls(floor=floor, name="empty")

    def seen_from(self, origin: Place) -> Scene:
        """The same scene in the frame that begins at `origin` (m, world): nothing but coordinates change."""
        if origin == self.origin:
            return self
        by, how = shifted(self.origin, back(origin)), vars(self.baking)
        if not isinstance(self.baking.free_space, str):
            how = {**how, "free_space": shifted(self.baking.free_space, by)}
        return Scene(
            [mesh.moved(by) for mesh in self.meshes],
            [shape.moved(by) for shape in self.primitives],
            None if self.stated_floor is None else self.stated_floor + by[1],
            objects=[thing.moved(by) for thing in self.objects],
            name=self.name,
            origin=origin,
            soft=self.soft,
            **how,
        )

    @property
    def middle(self) -> np.ndarray | None:
        """Middle ``[3]`` (m) of its meshes, without any of its shapes and objects; None of a floor alone.

        Raises:
            UserError: all of it together is wider than `WIDEST`.
        """
        every = [*(mesh.bounds for mesh in self.meshes), *self._loose]
        if every and (wide := float(np.ptp(hull(every), axis=0).max())) > WIDEST:
            raise UserError(
                f"scene '{self.name}' is {wide:.3g} m wide with its shapes and objects, and scenes are {WIDEST:g} m at "
                "most; move them together"
            )
        solids = [mesh.bounds for mesh in self.meshes] or self._loose
        return hull(solids).mean(axis=0) if solids else None

    @cached_property
    def _loose(self) -> list[np.ndarray]:
        """Bounds of what is in no mesh of its own: objects and shapes, with their motions."""
        return [t.bounds for t in self.objects] + [_reach(p) for p in self.primitives if not isinstance(p, Plane)]

    @cached_property
    def planes(self) -> tuple[Plane, ...]:
        """The floor as a plane where it is stated, else nothing."""
        return () if self.stated_floor is None else (Plane((0.0, self.stated_floor, 0.0), (0.0, 1.0, 0.0)),)

    @property
    def padding(self) -> float:
        """Metres of grid around each mesh; thickened walls stand out of it."""
        return self.baking.padding + self.baking.thickness / 2

    @cached_property
    def bakes(self) -> tuple[Bake[Any], ...]:
        """The baked grid of every mesh."""
        rules = [self._free_space_of(mesh) for mesh in self.meshes]
        return tuple(self._baked(mesh, rule) for mesh, rule in zip(self.meshes, rules, strict=True))

    def _baked(self, mesh: Mesh, rule: FreeSpace) -> Bake[Any]:
        """One mesh, on nodes `spacing` apart where that is stated: all of them, or those near surfaces."""
        how, padding = self.baking, self.padding
        if how.spacing is None:
            return bake(mesh, how.resolution, padding, rule, how.cache, thickness=how.thickness)
        size = np.ptp(mesh.bounds, axis=0) + 2 * padding
        if float(np.prod(size / how.spacing + 1)) <= DENSE:
            lattice = Lattice.spaced(mesh.bounds, how.spacing, padding)
            return bake(mesh, free_space=rule, cache=how.cache, lattice=lattice, thickness=how.thickness)
        if how.thickness:
            raise UserError(
                f"mesh '{mesh.name}' is too large for walls to be given a thickness at a spacing of {how.spacing:g} m;"
                " state a coarser spacing or a resolution"
            )
        return bake_blocks(mesh, how.spacing, padding, rule, how.cache)

    @cached_property
    def fields(self) -> tuple[DistanceField, ...]:
        """All that `distance` is the minimum of: grids, primitives, objects, the floor plane if stated, and reach."""
        beyond = () if self.reach is None else (self.reach,)
        return (*(result.grid for result in self.bakes), *self.primitives, *self.objects, *self.planes, *beyond)

    def reached_from(self, place: Place) -> Scene:
        """The same scene as somebody finds it who starts at a place (m, world; on the ground); bakes the meshes.

        Free space that they cannot get to from there counts as solid, as deep as the way back is long (`Reach`). It is
        this scene itself where there is none.
        """
        reach = None if self.parts is None else self.parts.around(place)
        if reach is self.reach:
            return self
        found = copy.copy(self)  # with all that is known of it
        found.reach = reach
        vars(found).pop("fields", None)
        return found

    def with_objects(self, objects: Sequence[MovingObject]) -> Scene:
        """The same scene, with all that is known of it, with other objects."""
        found = copy.copy(self)
        found.objects = tuple(objects)
        for name in ("fields", "_loose", "extent", "bounds", "digest", "_parts", "_bare"):
            vars(found).pop(name, None)
        return found

    @cached_property
    def parts(self) -> Parts | None:
        """Its free space, divided where no way leads through what does not move; None where it is not, or unknown."""
        shapes = [shape.mesh() for shape in self._still if not isinstance(shape, Plane)]
        if not (self.meshes or shapes) or self.ground is None:
            return None
        levels, bounds = self.levels, hull([mesh.bounds for mesh in (*self.meshes, *shapes)])
        sheets = [np.maximum(sheet, 0)[..., None] for sheet in self._sheets]
        grounds = [np.take_along_axis(levels.walkable, sheet, axis=2)[..., 0] for sheet in sheets]
        grounds = [np.where(s >= 0, ground, np.nan) for s, ground in zip(self._sheets, grounds, strict=True)]
        return Parts.of(partial(_least, (*self._still_fields, *self.planes)), bounds, levels, grounds)

    @cached_property
    def named(self) -> dict[str, Mesh]:
        """What does not move of it by name: the nodes of its files, and its meshes (`scenes.world.things`)."""
        return named_parts(self.meshes)

    def part(self, name: str) -> MovingObject:
        """The part of that name alone, as a field of its own; baked when it is first asked.

        Raises:
            UserError: it has no part of that name.
        """
        if name not in self._parts:
            moving = {thing.name: thing for thing in self.objects}
            if name not in moving and name not in self.named:
                raise UserError(
                    f"scene '{self.name}' has no part '{clipped(name)}'{did_you_mean(name, [*moving, *self.named])}"
                )
            still = Trajectory((0.0,), ((0.0, 0.0, 0.0),))
            self._parts[name] = moving.get(name) or MovingObject(
                self.named[name], still, name, cache=self.baking.cache, loose=False
            )
        return self._parts[name]

    @cached_property
    def _parts(self) -> dict[str, MovingObject]:
        """Parts that were asked for."""
        return {}

    @property
    def _still_fields(self) -> tuple[DistanceField, ...]:
        """What does not move, without a stated floor."""
        return (*(result.grid for result in self.bakes), *self._still)

    def distance(self, points: Float[Tensor, "*b 3"], time: Tensor | None = None) -> Float[Tensor, "*b"]:
        """Signed distance (m) to the nearest of all fields, positive in free space, differentiable.

        Args:
            points: metres, world.
            time: seconds on the task's clock, broadcastable to ``points[..., 0]``; None means 0 s.
        """
        found = _least(self.fields, points, time)
        for name, give in self.soft.items():
            part = self.part(name).distance(points, time)
            found = torch.where(part <= found + SAME, part + give, found)
        return found

    def distance_exact(self, points: np.ndarray, time: np.ndarray | float | None = None) -> np.ndarray:
        """Signed distance (m) from the triangles themselves: the oracle that scores motions.

        Slow, and as far as meshes are closed independent of every grid: libigl's point-to-mesh distance with signs as
        `scenes.sdf.exact` finds them; primitives and the floor are analytic; objects are met where they are at each
        point's time.

        Args:
            points: ``[n, 3]`` metres, world.
            time: seconds, scalar or ``[n]``; None means 0 s.

        Returns:
            ``[n]`` float64 metres, positive in free space.
        """
        points = np.asarray(points, dtype=np.float64)
        if points.ndim != 2 or points.shape[1] != 3:
            raise UserError(f"points have shape {points.shape}; give [n, 3]")
        if not np.isfinite(points).all():
            raise UserError("points for an exact distance hold NaN or infinite coordinates; give finite metres")
        tensor = torch.from_numpy(np.ascontiguousarray(points))
        when = None if time is None else torch.as_tensor(np.asarray(time, dtype=np.float64))
        results = [shape.distance(tensor, when).numpy() for shape in (*self.primitives, *self.planes)]
        for number, (sides, walls) in enumerate(self._surfaces):
            results.append(signed_distance(sides, points, partial(self._grid, number), self.baking.thickness))
            if walls is not None:
                results.append(walls.unsigned_distance(points) - self.baking.thickness / 2)
        results += [thing.distance_exact(points, time) for thing in self.objects]
        if self.reach is not None:
            results.append(self.reach.distance(tensor).numpy())
        nearest: np.ndarray = np.minimum.reduce(results)
        for name, give in self.soft.items():
            part = self.part(name).distance_exact(points, time)
            nearest = np.where(part <= nearest + SAME, part + give, nearest)
        return nearest

    def _grid(self, number: int) -> Any:
        return self.bakes[number].grid

    @cached_property
    def _surfaces(self) -> tuple[tuple[Sides, Surface | None], ...]:
        """Every mesh cleaned, which of its space is free, and its walls that are given a thickness."""
        found = []
        for mesh in self.meshes:
            sides = decide(Surface.of(mesh), self._free_space_of(mesh), padded(mesh.bounds, self.padding), mesh.name)
            found.append((sides, thin_walls(sides.surface, self.baking.thickness)))
        return tuple(found)

    def _free_space_of(self, mesh: Mesh) -> FreeSpace:
        """The scene's rule as it applies to one mesh.

        A seed elsewhere says nothing about a small object, and what lies in another mesh is no room around which all
        else is solid, whichever way it faces.
        """
        stated = self.baking.free_space
        if stated == "auto" and any(_within(mesh.bounds, other.bounds) for other in self.meshes if other is not mesh):
            return "outside"
        if isinstance(stated, str) or self._holds_seed(mesh) or not any(map(self._holds_seed, self.meshes)):
            return stated  # no mesh holds it: bake says so
        return "outside"

    def _holds_seed(self, mesh: Mesh) -> bool:
        (low, high), seed = padded(mesh.bounds, self.padding), np.array(self.baking.free_space)
        return bool((low <= seed).all() and (seed <= high).all())

    @property
    def floor(self) -> Floor:
        """The floor: as stated, or the lowest of those found."""
        if self.stated_floor is not None:
            return Floor(height=float(self.stated_floor), found=False)
        return self.floors[0]

    @cached_property
    def floors(self) -> tuple[Floor, ...]:
        """All storeys from low to high, as `find_floors` finds them in what does not move; bakes the meshes.

        Raises:
            UserError: nowhere is there room to stand.
        """
        return find_floors(self.levels, self.name)

    @cached_property
    def ground(self) -> float | None:
        """Height (m, world) of the floor; None where none is stated, nor found in the meshes."""
        try:
            return self.floor.height
        except UserError:
            return None

    @cached_property
    def levels(self) -> Levels:
        """All that can be stood on, in cells of 5 cm (of more in scenes of more than 50 x 50 m); bakes the meshes."""
        return self.levels_in(fitting(self.bounds))

    def levels_in(self, cell: float) -> Levels:
        """All that can be stood on, in cells of side `cell` (m): of meshes, primitives at rest and a stated floor."""
        return self._levels(cell, self.planes)

    def _levels(self, cell: float, stated: tuple[Plane, ...]) -> Levels:
        """What can be stood on of meshes, primitives at rest and the planes that are stated besides."""
        still = (*self._still, *stated)
        planes = [shape for shape in still if isinstance(shape, Plane)]
        meshes = [*self.meshes, *(shape.mesh() for shape in still if not isinstance(shape, Plane))]
        distance = partial(_least, (*self._still_fields, *stated))
        return Levels.of(meshes, planes, distance, self.bounds, cell, self.baking.thickness / 2)

    @property
    def _still(self) -> tuple[Primitive, ...]:
        """The primitives that do not move."""
        return tuple(shape for shape in self.primitives if getattr(shape, "motion", None) is None)

    def ground_at(self, x: Any, z: Any, below: Any = None) -> np.ndarray:
        """Height (m, world) of the ground at places: on slopes and steps, and of the storey that one is on.

        Args:
            x, z: metres, world, of any shapes that broadcast.
            below: heights (m) of soles; the ground is what lies nearest below them, up to 10 cm above them included.
                None: of what can be walked on (`surfaces`: the floor, what steps lead to, storeys, but no tables),
                what is nearest to the floor's height.

        Returns:
            Metres, NaN where there is nothing to stand on.
        """
        if self._bare:
            return np.full(np.broadcast_shapes(np.shape(x), np.shape(z), np.shape(below)), self.floor.height)
        levels, below = (self._walked, np.nan) if below is None else (self.levels, below)
        places = np.stack(np.broadcast_arrays(*(np.asarray(v, np.float64) for v in (x, below, z))), axis=-1)
        main = self.ground
        found: np.ndarray = levels.under(places.reshape(-1, 3), 0.0 if main is None else main)
        return found.reshape(places.shape[:-1])

    @property
    def _bare(self) -> bool:
        """Whether there is nothing to stand on but a plane."""
        return not (self.meshes or self._still)

    @cached_property
    def _walked(self) -> Levels:
        """Of the levels those that can be walked on."""
        levels = self.levels
        kept = np.logical_or.reduce([held(surface, levels.heights.shape) for surface in self._sheets])
        return replace(levels, heights=np.where(kept, levels.heights, np.nan))

    @cached_property
    def _sheets(self) -> list[np.ndarray]:
        """Which of the levels are ground, ``[X, Z]`` each: the main floor, then storeys."""
        return surfaces(self.levels, 0.0 if self.ground is None else self.ground)

    def ground_under(self, points: Float[Tensor, "*b 3"]) -> Float[Tensor, "*b"]:
        """Height (m, world) of what can be walked on, nearest below points; the floor's where there is none."""
        if self._bare:
            return torch.full_like(points[..., 0], self.floor.height)
        main = 0.0 if self.ground is None else self.ground
        found = np.nan_to_num(self._walked.under(points.detach().cpu().double().numpy().reshape(-1, 3), main), nan=main)
        return torch.from_numpy(found).to(points).reshape(points.shape[:-1])

    @property
    def moving(self) -> tuple[MovingObject | Sphere | Capsule, ...]:
        """The objects and primitives whose ``mesh(time)`` depends on the time."""
        shapes = [p for p in self.primitives if isinstance(p, Sphere | Capsule) and p.motion is not None]
        return (*self.objects, *shapes)

    @cached_property
    def extent(self) -> np.ndarray | None:
        """Lowest and highest corner of meshes, shapes that end, and objects with their motions, ``[2, 3]``, metres.

        None of a floor alone.
        """
        solids = [mesh.bounds for mesh in self.meshes] + self._loose
        return hull(solids) if solids else None

    @cached_property
    def bounds(self) -> np.ndarray:
        """The same, ``[2, 3]``, metres; without meshes, 40 x 4 x 40 m of floor around the origin belong to it."""
        solids = [] if self.extent is None else [self.extent]
        if self.meshes:
            return hull(solids)
        low = self.stated_floor or 0.0
        return hull([*solids, np.array([[-20.0, low, -20.0], [20.0, low + 4.0, 20.0]])])

    @cached_property
    def digest(self) -> str:
        """SHA-256 of everything that distances depend on, hexadecimal."""
        how, meshes, objects = self.baking, [m.digest for m in self.meshes], [thing.digest for thing in self.objects]
        voxels = (how.resolution, how.free_space, how.thickness, how.spacing)
        margin = () if how.padding == BakeSettings.padding else (how.padding,)
        text = repr((meshes, self.primitives, self.stated_floor, *voxels, objects, *margin, *sorted(self.soft.items())))
        return hashlib.sha256(text.encode()).hexdigest()

    def report(self) -> list[str]:
        """What was decided about each mesh, one sentence each; bakes them if that has not happened yet."""
        moving = [thing.bake for thing in self.objects]
        return [result.summary for result in (*self.bakes, *moving) if result is not None]

    @property
    def doubts(self) -> tuple[str, ...]:
        """What may be wrong with the scene as it was read and baked, one sentence each; bakes as `report` does."""
        self.report()
        return self.doubts_so_far

    @property
    def doubts_so_far(self) -> tuple[str, ...]:
        """Those of `doubts` that are known before anything more is baked."""
        meshes = [*self.meshes, *(thing.shape for thing in self.objects if isinstance(thing.shape, Mesh))]
        bakes = [] if "bakes" not in vars(self) else list(self.bakes)
        floor = () if "bakes" not in vars(self) else self._floor_doubts
        bakes += [result for thing in self.objects if (result := vars(thing).get("bake")) is not None]
        frame = () if self.origin == HOME else (_FRAME.format(list(self.origin)),)
        found = [frame, *(mesh.doubts for mesh in meshes), *(bake.doubts for bake in bakes), floor]
        return tuple(dict.fromkeys(chain.from_iterable(found)))

    @cached_property
    def _floor_doubts(self) -> tuple[str, ...]:
        """On a floor that is stated where nothing in the meshes is one, nor stands on it."""
        stated = self.stated_floor
        if stated is None or not self.meshes:
            return ()
        try:
            floors = [floor.height for floor in find_floors(self._levels(fitting(self.bounds), ()), self.name)]
        except UserError:
            return ()  # they are no ground, such as a table
        if (
            min(abs(height - stated) for height in (*floors, hull([m.bounds for m in self.meshes])[0, 1]))
            <= STEP + 1e-6
        ):
            return ()
        found = min(floors, key=lambda height: abs(height - stated)) + self.origin[1]
        return (
            f"the floor is stated at {stated + self.origin[1]:g} m, but that of the mesh lies at {found:.3f} m; state "
            "the mesh's unit and up axis if they are others, or leave out 'floor'",
        )

    def __repr__(self) -> str:
        counts = f"meshes={len(self.meshes)}, primitives={len(self.primitives)}, objects={len(self.objects)}"
        return f"Scene('{self.name}', {counts})"


def _least(fields: Sequence[DistanceField], points: Tensor, time: Tensor | None = None) -> Tensor:
    """The least (m) of several fields at points ``[*b, 3]``."""
    return reduce(torch.minimum, (field.distance(points, time) for field in fields))


def _within(inner: np.ndarray, outer: np.ndarray) -> bool:
    return bool((inner[0] > outer[0]).all() and (inner[1] < outer[1]).all())


def _reach(shape: Primitive) -> np.ndarray:
    """Bounds ``[2, 3]`` of a primitive over its whole motion."""
    if isinstance(shape, Sphere | Capsule) and shape.motion is not None:
        return hull([shape.mesh(time).bounds for time in shape.motion.times])
    return shape.mesh().bounds


def load_scene(
    path: str | Path,
    unit: str | None = None,
    up: str | None = None,
    floor: float | int | None = None,
    primitives: Sequence[Primitive] = (),
    objects: Sequence[MovingObject] = (),
    **baking: Unpack[BakeOptions],
) -> Scene:
    """A scene from one mesh file, plus primitives and objects; arguments as `load_mesh` and `Scene` take them."""
    mesh = load_mesh(path, unit, up)
    return Scene([mesh], primitives, floor, objects=objects, name=mesh.name, **baking)


def bundled_names() -> list[str]:
    """Names of the scenes that come with the package."""
    return sorted(path.stem for path in BUNDLED.glob("*.glb"))


def bundled(
    name: str,
    primitives: Sequence[Primitive] = (),
    objects: Sequence[MovingObject] = (),
    **baking: Unpack[BakeOptions],
) -> Scene:
    """A scene that comes with the package; raises UserError for an unknown name.

    Its ``.toml`` file states the floor's height and may state `free_space`.
    """
    if name not in bundled_names():
        raise UserError(f"unknown bundled scene '{name}'{did_you_mean(name, bundled_names())}")
    facts: dict[str, Any] = {}
    if (notes := BUNDLED / f"{name}.toml").is_file():
        facts = tomllib.loads(notes.read_text(encoding="utf-8"))
    baking.setdefault("free_space", facts.get("free_space", "auto"))
    return Scene(
        [load_mesh(BUNDLED / f"{name}.glb")], primitives, facts.get("floor"), objects=objects, name=name, **baking
    )
