"""Pictures: a scene, a person over time, goals, and the distances between them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import NamedTuple

import numpy as np
import torch

from objectives import Context, Mark, Objective
from scenectl.view.camera import ANGLE, Camera, choose
from scenectl.view.evidence import draw_evidence
from scenectl.view.marks import LIFT, WAY, draw_line, draw_marks, places
from scenectl.view.room import GLASS, Room
from scenectl.view.shapes import Hull, body_hull, joined, soft_shadow
from scenectl.view.stage import GLOW, SIZE, Colour, Finish, Stage, polydata, shaded
from scenes.body.body import DEFAULT_BODY, ProxyBody
from scenes.motion.motion import Motion
from scenes.world.scene import Scene

_FIRST, _LAST = np.array([238, 208, 190.0]), np.array([212, 78, 34.0])  # a person's colour at the start and the end
_SKIN = Finish(0.3, 0.72, 0.12)
_TRAIL: Colour = (138, 59, 30)
_STEP, _FEWEST, _MOST = 0.6, 3, 8
"""Metres that the pelvis goes from one pose that is drawn to the next, and how few and many poses are drawn."""
_NEAR, _FAR = 0.4, 0.6
"""Metres of clearance, and of distance on a slice, at the ends of their scales."""


class Slice(NamedTuple):
    """Signed distances on a horizontal plane: points ``[X, Z, 3]`` (m) and distances ``[X, Z]`` (m)."""

    points: np.ndarray
    distances: np.ndarray


@dataclass(frozen=True)
class Picture:
    """Something to look at.

    Attributes:
        scene: what stands around.
        motion: one motion ``[T, J, 3]``, or None for the scene alone.
        path: planned walk ``[P, 3]`` metres, or None.
        objective: whose goals are marked beside a motion, or None.
        title: a line at the top.
        body: the volume of the person.
    """

    scene: Scene
    motion: Motion | None = None
    path: np.ndarray | None = None
    objective: Objective | None = None
    title: str = ""
    body: ProxyBody = field(default=DEFAULT_BODY)

    def draw(
        self,
        png: str | Path,
        at: float | None = None,
        show_slice: bool = False,
        clearance: bool = False,
        show_signs: bool = False,
        size: tuple[int, int] = SIZE,
    ) -> None:
        """Render into a PNG file, off screen.

        Args:
            png: the file, written whole or not at all.
            at: one moment (s) instead of several over the motion.
            show_slice: the distance field on a horizontal plane at hip height.
            clearance: colour the body by its distance to the scene.
            show_signs: where it is uncertain whether space is free, and the holes in meshes.
            size: pixels.
        """
        stage, poses = Stage(size), self.moments(at)
        times = [self.time(frame) for frame in poses] or [0.0]
        self.set_stage(stage, poses, poses, times, show_signs)
        self.room.draw_moving(stage, times)
        if poses:
            self._draw_people(stage, poses, clearance)
        if show_slice:
            self.draw_slice(stage, self.hip_height, 0.0 if at is None else at)
        if show_signs:
            draw_evidence(stage, self.scene)
        stage.write(png)

    def set_stage(
        self, stage: Stage, poses: list[int], shown: list[int], times: Sequence[float], show_signs: bool
    ) -> None:
        """Camera, light, the scene at rest, goals and the title.

        Args:
            stage: to draw on.
            poses: frames that shall be in the picture.
            shown: those of them that nothing may cover.
            times: seconds at which goals that move are drawn.
            show_signs: the scene is looked through.
        """
        camera = self._look(poses, stage.size[0] / stage.size[1])
        stage.look_from(camera.position, camera.target, ANGLE)
        probes = np.concatenate([self.joints(frame) for frame in shown]) if shown else np.zeros((0, 3))
        self.room.draw(stage, camera, probes, GLASS if show_signs else 1.0)
        if self.path is not None:
            draw_line(stage, self.path + np.array([0.0, LIFT, 0.0]), WAY, 0.015)
        draw_marks(stage, self.marks, self.scene.floor.height, times)
        if self.title:
            stage.add_text(self.title, (0.015, 0.945), 24)

    # ---- what is shown when -----------------------------------------------------------------------------------

    @cached_property
    def marks(self) -> list[Mark]:
        """What there is to see of the goals."""
        if self.motion is None or self.objective is None:
            return []
        context = Context(self.scene, self.body)
        return [mark for term in self.objective.counted for mark in term.marks(self.motion, context)]

    @cached_property
    def room(self) -> Room:
        """The scene as it is drawn."""
        heads = -np.inf if self.motion is None else float(self.motion.joint("head")[..., 1].max()) + 0.25
        return Room(self.scene, heads)

    def moments(self, at: float | None) -> list[int]:
        """Frames that are drawn: the one at a time (s), or several over the motion."""
        if self.motion is None:
            return []
        if at is not None:
            return [self.motion.frame_at(at)]
        last = int(self.motion.valid.sum()) - 1
        way = self.motion.joint("pelvis")[: last + 1, [0, 2]].diff(dim=0).norm(dim=-1).sum()
        count = int(np.clip(round(float(way) / _STEP) + 1, _FEWEST, _MOST))
        return [round(k * last / (count - 1)) for k in range(count)] if last > 0 else [0]

    @property
    def hip_height(self) -> float:
        """Height (m) of the slice."""
        return self.scene.floor.height + 0.9

    def time(self, frame: int) -> float:
        """Seconds on the task's clock."""
        return 0.0 if self.motion is None else float(self.motion.times[frame])

    def joints(self, frame: int) -> np.ndarray:
        """The pose at a frame, ``[J, 3]`` m."""
        assert self.motion is not None
        joints: np.ndarray = self.motion.joints[frame].detach().cpu().double().numpy()
        return joints

    def _look(self, poses: list[int], aspect: float) -> Camera:
        """A camera for the motion, or for the whole scene where there is none."""
        sight = self.room.sight(self.time(poses[-1]) if poses else 0.0)  # when what moves is drawn solid
        if not poses:
            low, high = self.scene.bounds
            high = np.array([high[0], min(high[1], low[1] + 2.2), high[2]])
            points = np.stack(np.meshgrid(*zip(low, high, strict=True), indexing="ij"), axis=-1).reshape(-1, 3)
            points = np.concatenate([points, points.mean(axis=0) + np.zeros((40, 3))])
            return choose(points, sight, np.zeros(2), aspect)
        wanted = [self.joints(frame) for frame in poses]
        way = wanted[-1][0] - wanted[0][0]
        length = float(np.hypot(way[0], way[2]))
        along = way[[0, 2]] / length if length > 0.5 else np.zeros(2)
        if self.path is not None:
            wanted.append(self.path[::10])
        spots = [mark for mark in self.marks if mark.role == "goal" and mark.shape in ("ball", "ring")]
        wanted += [places(mark, self.scene.floor.height) for mark in spots]
        points = np.concatenate(wanted)
        return choose(points[np.isfinite(points).all(axis=1)], sight, along, aspect)

    # ---- the parts of a picture -------------------------------------------------------------------------------

    def _draw_people(self, stage: Stage, poses: list[int], clearance: bool) -> None:
        """Bodies from pale (early) to strong (late), their shadows, the pelvis's way and the times."""
        assert self.motion is not None
        shares = np.linspace(0.0, 1.0, len(poses)) if len(poses) > 1 else np.ones(1)
        samples, radii = self.body.points(self.motion)
        below = [samples[f].detach().double().numpy() for f in poses]
        self._draw_shadow(stage, below, radii.numpy(), (0.22 + 0.28 * shares).tolist())
        self.draw_bodies(stage, poses, (1 - shares[:, None]) * _FIRST + shares[:, None] * _LAST, clearance)
        if len(poses) > 1:
            draw_line(stage, self.motion.joint("pelvis")[: poses[-1] + 1].double().numpy(), _TRAIL, 0.008)
        head = self.motion.skeleton.index("head")
        for frame in poses:
            x, y, z = self.joints(frame)[head] + [0.0, 0.24, 0.0]
            stage.add_text(f"{self.time(frame):.1f} s", (x, y, z), 18)

    def draw_body(self, stage: Stage, frame: int, clearance: bool) -> None:
        """The body at one frame, in place of where it was."""
        self.draw_bodies(stage, [frame], _LAST[None], clearance)

    def draw_bodies(self, stage: Stage, frames: list[int], colours: np.ndarray, clearance: bool) -> None:
        """Bodies at some frames in a colour each, ``[n, 3]``, or coloured by their distance to the scene."""
        hulls = [body_hull(self.body, self.joints(frame)) for frame in frames]
        if clearance:
            found = [self.clearances(hull.points, frame) for hull, frame in zip(hulls, frames, strict=True)]
            each = shaded(np.concatenate(found), "bad to good", (0.0, _NEAR))
            stage.add_scale("clearance (m)", "bad to good", (0.0, _NEAR), (0.7, 0.03))
        else:
            each = np.repeat(colours, [len(hull.points) for hull in hulls], axis=0)
            stage.remove("clearance (m)")
        stage.add(joined(hulls), each, _SKIN, name="body")

    def clearances(self, points: np.ndarray, frame: int) -> np.ndarray:
        """Distance (m) of points on the body to the scene at a frame; negative inside."""
        assert self.motion is not None
        time = torch.full((len(points),), float(self.motion.times[frame]))
        with torch.no_grad():
            distance: np.ndarray = self.scene.distance(torch.as_tensor(np.array(points)).float(), time).numpy()
        return distance

    def _draw_shadow(self, stage: Stage, bodies: list[np.ndarray], radii: np.ndarray, strengths: list[float]) -> None:
        x, z, dark = soft_shadow(bodies, radii, strengths)
        points, faces = _plane(x, z, self.scene.floor.height + 0.012)
        shade = np.full((dark.size, 4), 30.0)
        shade[:, 3] = 255 * dark.ravel()
        stage.add(Hull(points.reshape(-1, 3), faces[(shade[faces, 3] >= 1).any(axis=1)]), shade, GLOW)

    def draw_slice(self, stage: Stage, height: float, time: float) -> None:
        """Signed distances on a horizontal plane at a time (s); the white line is the surface."""
        from vtkmodules.util.numpy_support import numpy_to_vtk, vtk_to_numpy
        from vtkmodules.vtkFiltersCore import vtkContourFilter

        found = self.slice_at(height, time)
        faces = _plane(found.points[:, 0, 0], found.points[0, :, 2], height)[1]
        points, distances = found.points.reshape(-1, 3), found.distances.ravel()
        colours = shaded(distances, "inside to outside", (-_FAR, _FAR))
        stage.add(Hull(points, faces), colours, GLOW, 0.6, "slice")
        stage.add_scale("distance (m)", "inside to outside", (-_FAR, _FAR), (0.05, 0.03))
        data, zero = polydata(points, faces), vtkContourFilter()
        data.GetPointData().SetScalars(numpy_to_vtk(np.ascontiguousarray(distances), deep=True))
        zero.SetInputData(data)
        zero.SetValue(0, 0.0)
        zero.Update()
        surface = zero.GetOutput()
        stage.remove("slice surface")
        if surface.GetNumberOfLines():
            lines = vtk_to_numpy(surface.GetLines().GetConnectivityArray()).reshape(-1, 2)
            stage.add_lines(vtk_to_numpy(surface.GetPoints().GetData()), lines, (255, 255, 255), 3.0, "slice surface")

    def slice_at(self, height: float, time: float = 0.0) -> Slice:
        """The distance field at a height (m) and a time (s), on a grid of 4 cm or coarser."""
        low, high = self.scene.bounds
        step = max(0.04, float((high - low)[[0, 2]].max()) / 300)
        x, z = np.arange(low[0], high[0] + step, step), np.arange(low[2], high[2] + step, step)
        points, _ = _plane(x, z, height)
        with torch.no_grad():
            distance = self.scene.distance(torch.as_tensor(points.reshape(-1, 3)).float(), torch.tensor(time))
        return Slice(points, distance.numpy().reshape(len(x), len(z)))


def _plane(x: np.ndarray, z: np.ndarray, height: float) -> tuple[np.ndarray, np.ndarray]:
    """A horizontal grid: points ``[X, Z, 3]`` (m) and triangles ``[F, 3]`` of them."""
    points = np.stack(np.meshgrid(x, [height], z, indexing="ij"), axis=-1)[:, 0]
    i, j = (k.ravel() for k in np.meshgrid(np.arange(len(x) - 1), np.arange(len(z) - 1), indexing="ij"))
    a, c = i * len(z) + j, (i + 1) * len(z) + j
    return points, np.concatenate([np.stack([a, a + 1, c + 1], -1), np.stack([a, c + 1, c], -1)])
