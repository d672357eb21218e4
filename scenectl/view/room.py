"""The scene in a picture: cut open towards the camera, with what moves where it is at the moments that are drawn."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from scenectl.view.camera import Camera, Sight
from scenectl.view.marks import OBSTACLE, fading
from scenectl.view.shapes import components, face_colours, facets, inward
from scenectl.view.stage import MATT, Look
from scenes.mesh.primitives import Plane
from scenes.world.scene import Scene

if TYPE_CHECKING:
    from pyvista import Plotter

GLASS = 0.22
"""Opacity of what is looked through."""
_ROOMY, _CUT = 2.6, 2.0
"""Height (m) over the floor from which a scene has a ceiling, and the height of the walls that are left of it then."""
_COVERED, _PROBES = 0.06, 120
"""Share of the person's joints that an object may cover before it is glass, and how many of them are looked at."""
_SOLID: Look = {"scalars": "colour", "rgb": True, **MATT}
_TILES = ((232, 229, 223), (222, 218, 211))
_MARGIN = 1.5
"""Metres of ground around a person."""


class Solid(NamedTuple):
    """A mesh as it is drawn: triangles ``[F, 3, 3]`` (m), and of each its colour ``[F, 3]`` and its piece ``[F]``."""

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
        tops = [float(solid.triangles[:, :, 1].max()) for solid in self.solids]
        closed = max(tops, default=floor) > floor + _ROOMY or self.one_sided
        self.ceiling = max(floor + _CUT, heads) if closed else float("inf")

    @cached_property
    def solids(self) -> list[Solid]:
        """Meshes and shapes at rest."""
        shapes = [s for s in self.scene.primitives if not isinstance(s, Plane) and s not in self.scene.moving]
        meshes = (*self.scene.meshes, *(shape.mesh() for shape in shapes))
        return [Solid(mesh.triangles, face_colours(mesh), components(mesh)) for mesh in meshes]

    @cached_property
    def moving_colours(self) -> list[np.ndarray]:
        """Of each face of each thing that moves."""
        return [face_colours(thing.mesh(), OBSTACLE) for thing in self.scene.moving]

    def sight(self, time: float) -> Sight:
        """What may hide a person, with what moves where it is at a time (s), and without the ceiling."""
        parts = [solid.triangles for solid in self.solids]
        parts += [thing.mesh(time).triangles for thing in self.scene.moving]
        triangles = np.concatenate([np.zeros((0, 3, 3)), *parts])
        return Sight(triangles[triangles[:, :, 1].min(axis=1) < self.ceiling], self.one_sided)

    def draw(self, stage: Plotter, camera: Camera, probes: np.ndarray, opacity: float) -> None:
        """Solids, cut open towards the camera, and the ground where the scene has no floor of its own.

        Args:
            stage: to draw on.
            camera: where it is looked from.
            probes: the person's joints, ``[n, 3]`` m; what covers many of them is drawn like glass.
            opacity: of solids.
        """
        for solid in self.solids:
            triangles = solid.triangles
            seen = triangles[:, :, 1].min(axis=1) < self.ceiling
            if self.one_sided:  # the walls of an inward-facing room turn their backs to a camera outside
                edges = triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0]
                seen &= (np.cross(*edges) * (camera.position - triangles[:, 0])).sum(-1) > 0
            way = self._in_the_way(triangles[seen], solid.pieces[seen], probes, camera)
            glass = seen & np.isin(solid.pieces, way)
            for part, share in ((seen & ~glass, opacity), (glass, min(opacity, GLASS))):
                if part.any():
                    surface = facets(triangles[part], solid.colours[part])
                    if np.isfinite(self.ceiling):
                        surface = surface.clip("y", origin=(0.0, self.ceiling, 0.0))
                    stage.add_mesh(surface, opacity=share, **_SOLID)
        if not self.scene.meshes:
            self._draw_ground(stage, probes if len(probes) else np.zeros((1, 3)))

    def _in_the_way(self, triangles: np.ndarray, pieces: np.ndarray, probes: np.ndarray, camera: Camera) -> np.ndarray:
        """Objects, but not the walls around, that cover more than a little of the person."""
        if len(triangles) == 0 or len(probes) == 0:
            return np.zeros(0, dtype=int)
        sight = Sight(triangles, self.one_sided)
        looked = probes[:: max(1, len(probes) // _PROBES)]
        hits = [np.unique(pieces[sight.covering(camera.position, p)]) for p in looked]
        which, counts = np.unique(np.concatenate(hits), return_counts=True)
        small = np.array([(pieces == piece).mean() < 0.5 for piece in which], dtype=bool)
        return which[(counts > _COVERED * len(hits)) & small]

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
