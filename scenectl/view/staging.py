"""Staging: a scene, a person over time, goals, and the distances between them, as they are put on a stage."""

from __future__ import annotations

from collections.abc import Container, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
import torch

from objectives import Context, Mark, Objective, TermReport
from scenectl.measures.believability.verdict import Verdict
from scenectl.view.camera import Camera, choose, look_from
from scenectl.view.evidence import draw_evidence
from scenectl.view.labels import short
from scenectl.view.marks import LIFT, WAY, draw_line, draw_marks, draw_moving_marks, places, shares
from scenectl.view.moments import APART, Moment, Seen, Shown, moments_of, seen
from scenectl.view.room import GLASS, Room
from scenectl.view.shapes import body_hull, soft_shadow
from scenectl.view.stage import ROUND, scaled
from scenes.body.body import DEFAULT_BODY, ProxyBody
from scenes.motion.motion import Motion
from scenes.world.scene import Scene

if TYPE_CHECKING:
    from pyvista import Plotter, RectilinearGrid

_PALE, _STRONG = np.array([238.0, 208.0, 190.0]), np.array([212.0, 78.0, 34.0])
"""A person's colour at the start and at the end."""
_TRAIL = (138, 59, 30)
_NEAR, _FAR = 0.4, 0.6
"""Metres of clearance, and of distance on a slice, at the ends of their scales."""
_CLEARANCE, _DISTANCE = "clearance (m)", "distance (m)"


@dataclass(frozen=True)
class Staging:
    """Something to look at, and how each part of it is put on a stage.

    Attributes:
        scene: what stands around.
        motion: one motion ``[T, J, 3]``, or None for the scene alone.
        path: planned walk ``[P, 3]`` metres, or None.
        objective: whose goals are marked beside a motion, or None.
        title: a line at the top.
        body: the volume of the person.
        reports: how well each goal of the objective is met, or nothing.
        verdict: on the body, or None.
        acts: of a script, one after the other.
    """

    scene: Scene
    motion: Motion | None = None
    path: np.ndarray | None = None
    objective: Objective | None = None
    title: str = ""
    body: ProxyBody = field(default=DEFAULT_BODY)
    reports: Sequence[TermReport] = ()
    verdict: Verdict | None = None
    acts: Sequence[Shown] = ()

    def set_stage(self, stage: Plotter, camera: Camera, shown: Sequence[int], show_signs: bool) -> None:
        """Camera, light, the scene at rest, goals and the evidence of signs.

        Args:
            stage: to draw on.
            camera: where to look from.
            shown: frames at which nothing may cover the person.
            show_signs: where it is uncertain whether space is free; the scene is looked through then.
        """
        look_from(stage, camera)
        self.room.draw(stage, camera, [self.surface(frame) for frame in shown], GLASS if show_signs else 1.0)
        if self.path is not None:
            draw_line(stage, self.path + np.array([0.0, LIFT, 0.0]), WAY, 0.015)
        for goal in self.goals:
            draw_marks(stage, goal.marks, self.ground, goal.met)
        if show_signs:
            draw_evidence(stage, self.scene)

    def draw_moving(self, stage: Plotter, times: Sequence[float]) -> None:
        """What moves of the scene and the goals, in place of where it was: where it is at some times (s)."""
        self.room.draw_moving(stage, times)
        for k, goal in enumerate(self.goals):
            applies = {time: goal.applies(self.frame_at(time)) for time in times}
            draw_moving_marks(stage, goal.marks, self.ground, applies, goal.met, f"goal {k}")

    # ---- what is shown when -----------------------------------------------------------------------------------

    @cached_property
    def goals(self) -> list[Seen]:
        """What there is to see of the goals that count."""
        if self.motion is None or self.objective is None:
            return []
        context, reports = Context(self.scene, self.body), {report.name: report for report in self.reports}
        return [seen(term, self.motion, context, reports.get(term.name)) for term in self.objective.counted]

    @property
    def marks(self) -> list[Mark]:
        """Those of all goals."""
        return [mark for goal in self.goals for mark in goal.marks]

    @cached_property
    def room(self) -> Room:
        """The scene as it is drawn."""
        heads = -np.inf if self.motion is None else float(self.motion.joint("head")[..., 1].max()) + 0.25
        return Room(self.scene, heads)

    def moments(self, at: float | None) -> list[Moment]:
        """What is drawn: the moment at a time (s), or several over the motion."""
        if self.motion is None:
            return []
        if at is not None:
            return [Moment(self.frame_at(at))]
        return moments_of(self.motion, self.goals, self.verdict, self.acts)

    def told(self, moment: Moment, but: Container[str] = ()) -> str:
        """The time of a moment, and what it is about except for some names."""
        about = [short(name) for name in moment.about if name not in but]
        return "\n".join([f"{self.time(moment.frame):.1f} s", *about[:2]])

    @property
    def hip_height(self) -> float:
        """Height (m) of the slice."""
        return self.level + 0.9

    @property
    def level(self) -> float:
        """Height (m) of the ground that the person begins on; the floor's without one."""
        return self.scene.floor.height if self.motion is None else float(self.ground(self.joints(0)[:1])[0])

    def ground(self, points: np.ndarray) -> np.ndarray:
        """Height (m) of the ground at points ``[P, 3]``: of the storey that the person is on where nearest to them."""
        if self.motion is None:
            return np.full(len(points), self.scene.floor.height)
        from scipy.spatial import KDTree

        pelvis = self.motion.joint("pelvis").detach().cpu().double().numpy()
        _, nearest = KDTree(pelvis[:, [0, 2]]).query(points[:, [0, 2]])
        places = np.stack([points[:, 0], pelvis[nearest, 1], points[:, 2]], axis=1)
        heights: np.ndarray = self.scene.ground_under(torch.from_numpy(places)).numpy()
        return heights

    def time(self, frame: int) -> float:
        """Seconds on the task's clock."""
        return 0.0 if self.motion is None else float(self.motion.times[frame])

    def frame_at(self, time: float) -> int:
        """The frame at a time (s)."""
        return 0 if self.motion is None else self.motion.frame_at(time)

    def joints(self, frame: int) -> np.ndarray:
        """The pose at a frame, ``[J, 3]`` m."""
        assert self.motion is not None
        joints: np.ndarray = self.motion.joints[frame].detach().cpu().double().numpy()
        return joints

    def wrists(self, frame: int) -> np.ndarray:
        """Both at a frame, ``[2, 3]`` m."""
        assert self.motion is not None
        names = self.motion.skeleton.names
        return self.joints(frame)[[names.index(f"{side}_wrist") for side in ("left", "right")]]

    @property
    def end(self) -> float:
        """The time (s) of the last frame."""
        return 0.0 if self.motion is None else self.time(int(self.motion.valid.sum()) - 1)

    def surface(self, frame: int) -> np.ndarray:
        """Samples of the body at a frame, ``[M, 3]`` m."""
        return self._samples[frame]

    @cached_property
    def _samples(self) -> np.ndarray:
        assert self.motion is not None
        samples: np.ndarray = self.body.points(self.motion)[0].detach().cpu().double().numpy()
        return samples

    def points(self, moments: Sequence[Moment]) -> np.ndarray:
        """What shall be in a picture of some moments, ``[n, 3]`` m: people, their way and goals; or the whole scene."""
        if not moments:
            low, high = self.scene.bounds
            high = np.array([high[0], min(high[1], low[1] + 2.2), high[2]])
            points = np.stack(np.meshgrid(*zip(low, high, strict=True), indexing="ij"), axis=-1).reshape(-1, 3)
            return np.concatenate([points, points.mean(axis=0) + np.zeros((40, 3))])
        wanted = [self.joints(moment.frame) for moment in moments]
        if self.path is not None:
            wanted.append(self.path[::10])
        spots = [mark for mark in self.marks if mark.role == "goal" and mark.shape in ("ball", "ring")]
        points = np.concatenate([*wanted, *(places(mark, self.ground) for mark in spots)])
        return points[np.isfinite(points).all(axis=1)]

    def look(self, moments: Sequence[Moment], aspect: float) -> Camera:
        """A camera for some moments, or for the whole scene where there are none."""
        sight = self.room.sight(self.time(moments[-1].frame) if moments else 0.0)  # when what moves is drawn solid
        figures = [self.joints(moment.frame) for moment in moments]
        way = figures[-1][0] - figures[0][0] if figures else np.zeros(3)
        length = float(np.hypot(way[0], way[2]))
        along = way[[0, 2]] / length if length > APART else np.zeros(2)
        return choose(self.points(moments), sight, along, aspect, figures=figures)

    # ---- the parts of a picture -------------------------------------------------------------------------------

    def draw_people(self, stage: Plotter, frames: Sequence[int], clearance: bool) -> None:
        """Bodies from pale (early) to strong (late), their shadows and the pelvis's way."""
        assert self.motion is not None
        self._draw_shadow(stage, frames)
        for k, frame in enumerate(frames):
            self.draw_body(stage, frame, clearance, _STRONG if len(frames) == 1 else self.colour(frame), f"person {k}")
        if len(frames) > 1:
            draw_line(stage, self.motion.joint("pelvis")[: frames[-1] + 1].double().numpy(), _TRAIL, 0.008)

    def colour(self, frame: int) -> np.ndarray:
        """Of a person at a frame, sRGB 0 to 255: pale at first and strong at last."""
        share = self.time(frame) / self.end if self.end > 0 else 1.0
        mixed: np.ndarray = (1 - share) * _PALE + share * _STRONG
        return mixed

    def draw_body(
        self,
        stage: Plotter,
        frame: int,
        clearance: bool,
        colour: np.ndarray = _STRONG,
        name: str | None = None,
        place: np.ndarray | None = None,
        legend: bool = True,
    ) -> None:
        """The body at a frame, moved by `place`, in a colour (sRGB 0 to 255) or by its distance to the scene."""
        hull = body_hull(self.body, self.joints(frame))
        look = {"color": colour.astype(int).tolist()}
        if clearance:
            hull.point_data[_CLEARANCE] = self.clearances(hull.points, frame)
            look = {**scaled(_CLEARANCE, "RdYlGn", (0.0, _NEAR), 0.7), "show_scalar_bar": legend}
        if place is not None:
            hull.transform(place, transform_all_input_vectors=True, inplace=True)
        stage.add_mesh(hull, name=name, ambient=0.3, diffuse=0.72, specular=0.12, **ROUND, **look)

    def clearances(self, points: np.ndarray, frame: int) -> np.ndarray:
        """Distance (m) of points on the body to the scene at a frame; negative inside."""
        assert self.motion is not None
        time = torch.full((len(points),), float(self.motion.times[frame]))
        with torch.no_grad():
            distance: np.ndarray = self.scene.distance(torch.as_tensor(np.array(points)).float(), time).numpy()
        return distance

    def _draw_shadow(self, stage: Plotter, poses: Sequence[int]) -> None:
        from pyvista import StructuredGrid

        bodies, strengths = [self.surface(frame) for frame in poses], [0.22 + 0.28 * s for s in shares(len(poses))]
        over = [body - [0.0, self.ground(body[:1])[0], 0.0] for body in bodies]
        x, z, dark = soft_shadow(over, self.body.radii().numpy(), strengths)
        flat = np.stack(np.broadcast_arrays(x[:, None], 0.0, z), axis=-1)
        grid = StructuredGrid(flat[..., 0], self.ground(flat.reshape(-1, 3)).reshape(dark.shape) + 0.012, flat[..., 2])
        shade = np.full((dark.size, 4), 30, dtype=np.uint8)
        shade[:, 3] = 255 * dark.ravel(order="F")
        grid.point_data["shade"] = shade
        stage.add_mesh(grid, scalars="shade", rgba=True, lighting=False)

    def draw_slice(self, stage: Plotter, height: float, time: float) -> None:
        """Signed distances on a horizontal plane at a time (s); the white line is the surface."""
        grid = self.slice_at(height, time)
        look = scaled(_DISTANCE, "RdBu", (-_FAR, _FAR), 0.05)
        stage.add_mesh(grid, opacity=0.6, lighting=False, name="slice", **look)
        surface = grid.contour([0.0], scalars=_DISTANCE)
        stage.remove_actor("slice surface")
        if surface.n_points:
            stage.add_mesh(surface, color="white", line_width=3, lighting=False, name="slice surface")

    def slice_at(self, height: float, time: float = 0.0) -> RectilinearGrid:
        """The distance field at a height (m) and a time (s), on a grid of 4 cm or coarser."""
        from pyvista import RectilinearGrid

        low, high = self.scene.bounds
        step = max(0.04, float((high - low)[[0, 2]].max()) / 300)
        x, z = (np.arange(low[k], high[k] + step, step) for k in (0, 2))
        grid = RectilinearGrid(x, [height], z)
        with torch.no_grad():
            distance = self.scene.distance(torch.as_tensor(np.array(grid.points)).float(), torch.tensor(time))
        grid.point_data[_DISTANCE] = distance.numpy()
        return grid
