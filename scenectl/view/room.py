"""The scene in a picture: cut open towards the camera, with what moves where it is at the moments that are drawn."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from scenectl.view.camera import Camera, Sight
from scenectl.view.marks import fading
from scenectl.view.shapes import components, facets, inward
from scenectl.view.stage import MATT, Look
from scenes.mesh.colours import OBSTACLE, face_colours
from scenes.mesh.primitives import Plane
from scenes.world.moving import MovingObject
from scenes.world.scene import Scene

if TYPE_CHECKING:
    from pyvista import Plotter

GLASS = 0.22
"""Opacity of what is looked through."""
_ROOMY, _CUT = 2.6, 2.0
"""Height (m) over the floor from which a scene has a ceiling, and the height of the walls that are left of it then."""
_COVERED, _PROBES = 0.1, 60
"""Share of a person's points that may be covered before something is glass, and how many of them are looked at."""
_AROUND, _LEVEL = 0.2, 0.8
"""Metres around what covers somebody within which a wall or a scan is cut open, and the upward part of the normals of
what is not, as floors."""
_PLANE = 0.05
"""Metres between planes that are told apart."""
_HAND = 0.25
"""Metres from a wrist within which a thing is in the hand, whose grasp is 0.1 m further out."""
_SOLID: Look = {"scalars": "colour", "rgb": True, **MATT}
_TILES = ((232, 229, 223), (222, 218, 211))
_MARGIN = 1.5
"""Metres of ground around a person."""


class Solid(NamedTuple):
    """What is drawn of meshes: triangles ``[F, 3, 3]`` (m), and of each its colour ``[F, 3]`` and its piece ``[F]``."""

    triangles: np.ndarray
    colours: np.ndarray
    pieces: np.ndarray


class Room:
    """A scene as pictures show it.

    Attributes:
        scene: what stands around.
        ceiling: height (m) above which everything is left away, so that rooms can be looked into; infinite without.
        one_sided: whether walls are seen from inside only, as those of scans are.
    """

    def __init__(self, scene: Scene, heads: float) -> None:
        """Prepare a scene whose people reach up to `heads` (m, world)."""
        self.scene = scene
        floor = scene.floor.height
        self.one_sided = any(inward(mesh) for mesh in scene.meshes)
        top = float(self.solid.triangles[:, :, 1].max(initial=floor))
        closed = top > floor + _ROOMY or self.one_sided
        self.ceiling = max(floor + _CUT, heads) if closed else float("inf")

    @cached_property
    def solid(self) -> Solid:
        """Meshes and shapes at rest, as one."""
        shapes = [s for s in self.scene.primitives if not isinstance(s, Plane) and s not in self.scene.moving]
        meshes = (*self.scene.meshes, *(shape.mesh() for shape in shapes))
        pieces, count = [np.zeros(0, dtype=int)], 0
        for mesh in meshes:
            pieces.append(components(mesh) + count)
            count = int(pieces[-1].max(initial=count - 1)) + 1
        triangles = np.concatenate([np.zeros((0, 3, 3)), *(mesh.triangles for mesh in meshes)])
        colours = np.concatenate([np.zeros((0, 3), dtype=np.uint8), *(face_colours(mesh) for mesh in meshes)])
        return Solid(triangles, colours, np.concatenate(pieces))

    @property
    def bare(self) -> bool:
        """There is nothing to see of it."""
        return not len(self.solid.triangles) and not self.scene.moving

    @cached_property
    def moving_colours(self) -> list[np.ndarray]:
        """Of each face of each thing that moves."""
        own = (thing.solid if isinstance(thing, MovingObject) else thing.mesh() for thing in self.scene.moving)
        return [face_colours(mesh, OBSTACLE) for mesh in own]  # where it is as in its file, by which colours are found

    def sight(self, time: float) -> Sight:
        """What may hide a person, with what moves where it is at a time (s), and without the ceiling."""
        triangles = np.concatenate([self.solid.triangles, *(thing.mesh(time).triangles for thing in self.scene.moving)])
        return Sight(triangles[triangles[:, :, 1].min(axis=1) < self.ceiling], self.one_sided)

    def draw(self, stage: Plotter, camera: Camera, figures: Sequence[np.ndarray], opacity: float) -> None:
        """Solids, cut open towards the camera, and the ground where the scene has no floor of its own.

        Args:
            stage: to draw on.
            camera: where it is looked from.
            figures: points on each person, ``[n, 3]`` m; what covers many of them is drawn like glass.
            opacity: of solids.
        """
        triangles, colours, pieces = self.solid
        seen = triangles[:, :, 1].min(axis=1) < self.ceiling
        if self.one_sided:  # the walls of an inward-facing room turn their backs to a camera outside
            edges = triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0]
            seen &= (np.cross(*edges) * (camera.position - triangles[:, 0])).sum(-1) > 0
        glass = np.zeros_like(seen)
        glass[seen] = in_the_way(triangles[seen], pieces[seen], figures, Sight(triangles[seen], self.one_sided), camera)
        for name, part, share in (("solid", seen & ~glass, opacity), ("glass", glass, min(opacity, GLASS))):
            if part.any():
                surface = facets(triangles[part], colours[part])
                if np.isfinite(self.ceiling):
                    surface = surface.clip("y", origin=(0.0, self.ceiling, 0.0))
                stage.add_mesh(surface, opacity=share, name=name, **_SOLID)
        if not self.scene.meshes:
            self._draw_ground(stage, np.concatenate([np.zeros((0, 3)), *figures]) if figures else np.zeros((1, 3)))

    def _draw_ground(self, stage: Plotter, around: np.ndarray) -> None:
        """A tiled floor of 0.5 m squares, so that distances can be read off."""
        from pyvista import RectilinearGrid

        low = np.floor(around.min(axis=0)[[0, 2]] - _MARGIN)
        high = np.ceil(around.max(axis=0)[[0, 2]] + _MARGIN)
        x, z = (np.arange(low[k], high[k] + 0.5, 0.5) for k in range(2))
        ground = RectilinearGrid(x, [self.scene.floor.height], z)
        odd = np.add.outer(2 * z[:-1], 2 * x[:-1]).ravel() % 2  # cells go along x first
        ground.cell_data["colour"] = np.where(odd[:, None] > 0, *_TILES).astype(np.uint8)
        stage.add_mesh(ground, scalars="colour", rgb=True, ambient=0.4, diffuse=0.7)

    def draw_moving(self, stage: Plotter, times: Sequence[float]) -> None:
        """What moves, where it is at each time (s): pale at first, solid at last, as the person is."""
        for k, thing in enumerate(self.scene.moving):
            for i, (time, opacity) in enumerate(zip(times, fading(len(times)), strict=True)):
                surface = facets(thing.mesh(time).triangles, self.moving_colours[k])
                stage.add_mesh(surface, opacity=opacity, name=f"moving {k} {i}", **_SOLID)

    def draw_in_hands(self, stage: Plotter, time: float, wrists: np.ndarray, place: np.ndarray, name: str) -> None:
        """What moves and is in a hand of somebody with wrists ``[2, 3]`` (m) at a time (s), moved by `place`."""
        for k, thing in enumerate(self.scene.moving):
            triangles = thing.mesh(time).triangles
            if np.linalg.norm(triangles.reshape(-1, 1, 3) - wrists, axis=-1).min() < _HAND:
                surface = facets(triangles, self.moving_colours[k])
                surface.transform(place, transform_all_input_vectors=False, inplace=True)  # colours are no vectors
                stage.add_mesh(surface, name=f"{name}, thing {k}", **_SOLID)


def in_the_way(
    triangles: np.ndarray, pieces: np.ndarray, figures: Sequence[np.ndarray], sight: Sight, camera: Camera
) -> np.ndarray:
    """Which triangles to look through, ``[F]``, so that nothing covers more than a little of any figure.

    An object goes as a whole. What stands all around a figure, such as walls or a scan, goes side by side.
    """
    glass = np.zeros(len(triangles), dtype=bool)
    if not len(triangles):
        return glass
    around = _enclosing(triangles, pieces, figures)[pieces]
    groups = np.where(around, pieces.max() + 1 + _sides(triangles), pieces)
    holes = []
    for points in figures:
        probes = points[np.linspace(0, len(points) - 1, min(len(points), _PROBES)).astype(int)]
        hits = [sight.hits(camera.position, probe) for probe in probes]
        while True:
            left = [groups[which[~glass[which]]] for which, _ in hits]
            left = [np.unique(each) for each in left if len(each)]
            if len(left) <= _COVERED * len(probes):
                break
            found, counts = np.unique(np.concatenate(left), return_counts=True)
            glass |= groups == found[counts.argmax()]
        holes += [place for which, places in hits for place in places[glass[which] & around[which]]]
    if holes:
        from scipy.spatial import cKDTree

        normals = sight.normals / np.maximum(np.linalg.norm(sight.normals, axis=1, keepdims=True), 1e-12)
        away, _ = cKDTree(np.stack(holes)).query(triangles.mean(axis=1), distance_upper_bound=_AROUND)
        glass |= np.isfinite(away) & around & (normals[:, 1] < _LEVEL)
    return glass


def _enclosing(triangles: np.ndarray, pieces: np.ndarray, figures: Sequence[np.ndarray]) -> np.ndarray:
    """Which pieces, by number, reach around the middle of some figure on all sides."""
    low, high = np.full((pieces.max() + 1, 2), np.inf), np.full((pieces.max() + 1, 2), -np.inf)
    np.minimum.at(low, pieces, triangles[:, :, [0, 2]].min(axis=1))
    np.maximum.at(high, pieces, triangles[:, :, [0, 2]].max(axis=1))
    middles = np.array([points.mean(axis=0)[[0, 2]] for points in figures]).reshape(-1, 1, 2)
    around = np.all((low < middles) & (middles < high), axis=-1)
    return np.asarray(np.any(around, axis=0))


def _sides(triangles: np.ndarray) -> np.ndarray:
    """The plane that each triangle lies in, numbered, ``[F]``: the sides of walls."""
    normals = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
    normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-12)
    offsets = (normals * triangles.mean(axis=1)).sum(axis=1)
    planes = np.column_stack([normals.round(2), (offsets / _PLANE).round()])
    sides: np.ndarray = np.unique(planes, axis=0, return_inverse=True)[1].reshape(-1)
    return sides
