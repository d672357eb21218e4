"""Where to look from, and what to cut away so that the person is seen."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from scenectl.view.shapes import facets

if TYPE_CHECKING:
    from pyvista import Plotter

ANGLE = 26.0
"""Vertical opening of the camera, degrees: long enough that nothing near the edge is distorted."""


class Camera(NamedTuple):
    """A place to look from and what is in the middle of the picture, ``[3]`` m, world."""

    position: np.ndarray
    target: np.ndarray


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
        if not len(self.triangles):
            return np.zeros(0, dtype=int)
        from vtkmodules.vtkCommonCore import vtkIdList, vtkPoints

        hits, cells = vtkPoints(), vtkIdList()
        towards = point + 0.02 * (eye - point) / np.linalg.norm(eye - point)
        self._locator.IntersectWithLine(eye.tolist(), towards.tolist(), 1e-4, hits, cells)
        found = np.array([cells.GetId(k) for k in range(cells.GetNumberOfIds())], dtype=int)
        if self.one_sided and len(found):
            found = found[(self.normals[found] * (eye - self.triangles[found, 0])).sum(-1) > 0]
        return found


def choose(points: np.ndarray, sight: Sight, along: np.ndarray, aspect: float, room: float = 0.7) -> Camera:
    """The camera from which most of `points` are seen, preferring a low side view of the motion.

    Args:
        points: what shall be in the picture and seen, ``[n, 3]`` metres.
        sight: what may be in the way.
        along: direction of the motion on the floor, ``[2]`` (x, z); zero for none.
        aspect: width over height of the picture.
        room: metres left free around the points.
    """
    low, high = points.min(axis=0), points.max(axis=0)
    target = (low + high) / 2
    target[1] = low[1] + 0.5 * (high[1] - low[1])
    probe = points[np.linspace(0, len(points) - 1, min(len(points), 90)).astype(int)]
    views = []
    for elevation in (24.0, 34.0, 46.0, 60.0):
        for azimuth in np.arange(0.0, 360.0, 22.5):
            e, a = math.radians(elevation), math.radians(azimuth + 10.0)
            back = np.array([math.cos(e) * math.sin(a), math.sin(e), math.cos(e) * math.cos(a)])
            side = abs(float(along @ np.array([math.cos(a), -math.sin(a)])))  # 1 when the motion crosses the view
            views.append((0.004 * abs(elevation - 30.0) - 0.15 * side, back))
    best: tuple[float, Camera] | None = None
    for cost, back in sorted(views, key=lambda view: view[0]):
        if best is not None and cost >= best[0]:
            break  # no view that is left can be better, whatever it hides
        eye = target + back * _distance(points, target, back, aspect, room)
        hidden = float(np.mean([len(sight.covering(eye, p)) > 0 for p in probe]))
        if best is None or cost + hidden < best[0]:
            best = (cost + hidden, Camera(eye, target))
    assert best is not None
    return best[1]


def _distance(points: np.ndarray, target: np.ndarray, back: np.ndarray, aspect: float, room: float) -> float:
    """How far away the camera must be so that all points and `room` metres around them are in the picture."""
    right = np.cross([0.0, 1.0, 0.0], back)
    right /= np.linalg.norm(right)
    up = np.cross(back, right)
    offset = points - target
    half = math.tan(math.radians(ANGLE / 2))
    need_x = (np.abs(offset @ right) + room) / (half * aspect) + offset @ back
    need_y = (np.abs(offset @ up) + room) / half + offset @ back
    return float(max(need_x.max(), need_y.max()))
