"""Where to look from, and what to cut away so that the person is seen."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from scenectl.view.shapes import facets

if TYPE_CHECKING:
    from pyvista import Plotter

ANGLE = 26.0
"""Vertical opening of the camera, degrees: long enough that nothing near the edge is distorted."""
_ROOM = 0.5
"""Metres that are left free around what shall be seen: there is writing over people's heads."""
_SHORT = 0.02
"""Metres before a point at which sight of it ends, so that what it lies on does not cover it."""


class Camera(NamedTuple):
    """A place to look from and what is in the middle of the picture, ``[3]`` m, world."""

    position: np.ndarray
    target: np.ndarray

    def project(self, points: np.ndarray, size: tuple[int, int]) -> tuple[np.ndarray, np.ndarray]:
        """Where points ``[..., 3]`` are in a picture: ``[..., 2]`` pixels from its upper left; and pixels a metre.

        What is behind the camera is not a number.
        """
        back = (self.position - self.target) / np.linalg.norm(self.position - self.target)
        right, up = _axes(back)
        offset = points - self.position
        depth = -(offset @ back)
        scale = size[1] / (2 * math.tan(math.radians(ANGLE / 2)) * np.where(depth > 1e-3, depth, np.nan))
        flat = np.stack([offset @ right, -(offset @ up)], axis=-1) * scale[..., None]
        return flat + np.array(size) / 2, scale


def look_from(stage: Plotter, camera: Camera) -> None:
    """Look by light that comes with the camera: a key light over its left shoulder, a soft one from the right, and a
    little from above."""
    from pyvista import Light

    stage.camera.position, stage.camera.focal_point = camera.position.tolist(), camera.target.tolist()
    stage.camera.up, stage.camera.view_angle = (0.0, 1.0, 0.0), ANGLE
    back = camera.position - camera.target
    scale = float(np.linalg.norm(back))
    up = np.array([0.0, scale, 0.0])
    right = np.cross(up, back)
    right *= scale / max(float(np.linalg.norm(right)), 1e-9)
    for offset, strength in (
        (back - 0.5 * right + 0.7 * up, 0.62),
        (back + 0.9 * right + 0.2 * up, 0.3),
        (up - 0.3 * back, 0.34),
    ):
        place = (camera.target + offset).tolist()
        light = Light(position=place, focal_point=camera.target.tolist(), intensity=strength, positional=False)
        stage.add_light(light)


class Sight:
    """Lines of sight against triangles ``[F, 3, 3]`` (m), each of which may be seen from its front side only."""

    def __init__(self, triangles: np.ndarray, one_sided: bool) -> None:
        from vtkmodules.vtkCommonDataModel import vtkStaticCellLocator

        self.triangles, self.one_sided = triangles, one_sided
        edge_a, edge_b = triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0]
        self.normals = np.cross(edge_a, edge_b)
        self._locator = vtkStaticCellLocator()
        if len(triangles):
            self._locator.SetDataSet(facets(triangles))
            self._locator.BuildLocator()

    def covering(self, eye: np.ndarray, point: np.ndarray) -> np.ndarray:
        """Indices of the triangles that cover `point` when seen from `eye`."""
        return self.hits(eye, point)[0]

    def hits(self, eye: np.ndarray, point: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Indices of the triangles that cover `point` when seen from `eye`, and where, ``[n, 3]`` m."""
        if not len(self.triangles):
            return np.zeros(0, dtype=int), np.zeros((0, 3))
        from vtkmodules.vtkCommonCore import vtkIdList, vtkPoints

        places, cells = vtkPoints(), vtkIdList()
        towards = point + _SHORT * (eye - point) / np.linalg.norm(eye - point)
        self._locator.IntersectWithLine(eye.tolist(), towards.tolist(), 1e-4, places, cells)
        count = cells.GetNumberOfIds()
        found = np.array([cells.GetId(k) for k in range(count)], dtype=int)
        where = np.array([places.GetPoint(k) for k in range(count)]).reshape(-1, 3)
        if self.one_sided and count:
            front = (self.normals[found] * (eye - self.triangles[found, 0])).sum(-1) > 0
            found, where = found[front], where[front]
        return found, where


def choose(
    points: np.ndarray,
    sight: Sight,
    along: np.ndarray,
    aspect: float,
    room: float = _ROOM,
    figures: Sequence[np.ndarray] = (),
) -> Camera:
    """The camera from which most of `points` are seen and figures stand apart, best a low side view of the motion.

    Args:
        points: what shall be in the picture and seen, ``[n, 3]`` metres.
        sight: what may be in the way.
        along: direction of the motion on the floor, ``[2]`` (x, z); zero for none.
        aspect: width over height of the picture.
        room: metres left free around the points.
        figures: poses ``[J, 3]`` that shall not cover each other.
    """
    probe = points[np.linspace(0, len(points) - 1, min(len(points), 90)).astype(int)]
    views = []
    for elevation in (24.0, 34.0, 46.0, 60.0):
        for azimuth in np.arange(0.0, 360.0, 22.5):
            e, a = math.radians(elevation), math.radians(azimuth + 10.0)
            back = np.array([math.cos(e) * math.sin(a), math.sin(e), math.cos(e) * math.cos(a)])
            side = abs(float(along @ np.array([math.cos(a), -math.sin(a)])))  # 1 when the motion crosses the view
            views.append((0.004 * abs(elevation - 30.0) - 0.15 * side + _overlap(figures, back), back))
    best: tuple[float, Camera] | None = None
    for cost, back in sorted(views, key=lambda view: view[0]):
        if best is not None and cost >= best[0]:
            break  # no view that is left can be better, whatever it hides
        camera = seen_along(back, points, aspect, room)
        hidden = float(np.mean([len(sight.covering(camera.position, p)) > 0 for p in probe]))
        if best is None or cost + hidden < best[0]:
            best = (cost + hidden, camera)
    assert best is not None
    return best[1]


def seen_along(back: np.ndarray, points: np.ndarray, aspect: float, room: float = _ROOM) -> Camera:
    """The camera in the direction `back` (a unit vector) that has points ``[n, 3]`` and `room` (m) around in view."""
    target = (points.min(axis=0) + points.max(axis=0)) / 2
    return Camera(target + back * _distance(points, target, back, aspect, room), target)


def _overlap(figures: Sequence[np.ndarray], back: np.ndarray) -> float:
    """How much of the box around each figure is another's, in the mean, when they are seen along `back`."""
    if len(figures) < 2:
        return 0.0
    flat = np.stack(figures) @ np.stack(_axes(back), axis=1)
    low, high = flat.min(axis=1), flat.max(axis=1)
    shared = (np.minimum(high[:, None], high) - np.maximum(low[:, None], low)).clip(min=0.0).prod(axis=-1)
    area = (high - low).prod(axis=-1)
    shared /= np.maximum(np.minimum(area[:, None], area), 1e-9)
    np.fill_diagonal(shared, 0.0)
    return float(shared.max(axis=1).mean())


def _axes(back: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Right and up of a picture of what lies along -`back`."""
    right = np.cross([0.0, 1.0, 0.0], back)
    right /= np.linalg.norm(right)
    return right, np.cross(back, right)


def _distance(points: np.ndarray, target: np.ndarray, back: np.ndarray, aspect: float, room: float) -> float:
    """How far away the camera must be so that all points and `room` metres around them are in the picture."""
    right, up = _axes(back)
    offset = points - target
    half = math.tan(math.radians(ANGLE / 2))
    need_x = (np.abs(offset @ right) + room) / (half * aspect) + offset @ back
    need_y = (np.abs(offset @ up) + room) / half + offset @ back
    return float(max(need_x.max(), need_y.max()))
