"""Pictures and the window: a scene, a person over time, goals, and the distances between them."""

from __future__ import annotations

import ctypes
import os
import sys
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import torch

from objectives import Objective, Term
from objectives.parameters import FloorPoint, Point, instances
from objectives.tracks import TrackBase
from scenectl.view.camera import ANGLE, Camera, Sight, choose, triangles_to_vtk
from scenectl.view.evidence import open_edges, uncertain_blocks
from scenectl.view.shapes import BodyShape, components, face_colours, inward, soft_shadow
from scenes.body.body import DEFAULT_BODY, ProxyBody
from scenes.errors import UserError
from scenes.files import atomic_write
from scenes.mesh.mesh import Mesh
from scenes.mesh.primitives import Plane
from scenes.mesh.surface import Surface
from scenes.motion.motion import Motion
from scenes.sdf.bake import Bake
from scenes.sdf.signs import UNCERTAIN
from scenes.world.scene import Scene

SIZE = (1600, 1000)
_BACK, _HORIZON = "#f4f2ee", "#dfe5ea"
_FIRST, _LAST = np.array([238, 208, 190.0]), np.array([212, 78, 34.0])  # a person's colour at the start and the end
_GLASS = 0.22  # opacity of what is looked through
_PATH, _GOAL, _OBSTACLE = "#2f7d6b", "#c8322b", (122, 94, 168)


@dataclass(frozen=True)
class Picture:
    """Something to look at.

    Attributes:
        scene: what stands around.
        motion: one motion ``[T, J, 3]``, or None for the scene alone.
        path: planned walk ``[P, 3]`` metres, or None.
        objective: whose targets are marked, or None.
        title: a line at the top.
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
        plotter = self._plotter(off_screen=True, size=size)
        poses = self._moments(at)
        camera = self._look(poses, size[0] / size[1])
        self._add_scene(plotter, camera, poses, _GLASS if show_signs else 1.0)
        self._add_goals(plotter)
        self.add_moving(plotter, [self._time(frame) for frame in poses] or [0.0])
        self._add_people(plotter, poses, clearance)
        if show_slice:
            self._add_slice(plotter, self._hip_height, 0.0 if at is None else at)
        if show_signs:
            self._add_signs(plotter)
        write_png(plotter, png)

    def window(self, show_slice: bool = False, show_signs: bool = False) -> None:
        """Open a window with a time slider; s shows or hides the slice, c the clearances. Blocks until closed."""
        if sys.platform == "linux" and not (os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")):
            raise UserError("there is no screen to open a window on; use --png FILE")
        plotter = self._plotter(off_screen=False, size=SIZE)
        self.interactive(plotter, show_slice, show_signs)
        plotter.show()

    def interactive(self, plotter: Any, show_slice: bool, show_signs: bool = False) -> _Window:
        """Fill a plotter with what the window shows, its sliders and keys; returns what they move."""
        poses = self._moments(None)
        camera = self._look(poses, SIZE[0] / SIZE[1])
        self._add_scene(plotter, camera, poses[:1], _GLASS if show_signs else 1.0)
        self._add_goals(plotter)
        if show_signs:
            self._add_signs(plotter)
        return _Window(self, plotter, show_slice)

    # ---- what is shown when -----------------------------------------------------------------------------------

    def _moments(self, at: float | None) -> list[int]:
        """Frames that are drawn."""
        if self.motion is None:
            return []
        if at is not None:
            return [self.motion.frame_at(at)]
        last = int(self.motion.valid.sum()) - 1
        way = self.motion.joint("pelvis")[: last + 1, [0, 2]].diff(dim=0).norm(dim=-1).sum()
        count = int(np.clip(round(float(way) / 0.6) + 1, 3, 8))
        return [round(k * last / (count - 1)) for k in range(count)] if last > 0 else [0]

    @property
    def _hip_height(self) -> float:
        return self.scene.floor.height + 0.9

    def _time(self, frame: int) -> float:
        """Seconds on the task's clock."""
        return 0.0 if self.motion is None else float(self.motion.times[frame])

    def _joints(self, frame: int) -> np.ndarray:
        assert self.motion is not None
        joints: np.ndarray = self.motion.joints[frame].detach().cpu().double().numpy()
        return joints

    @cached_property
    def _solids(self) -> list[tuple[np.ndarray, np.ndarray, np.ndarray]]:
        """(triangles ``[F, 3, 3]``, colours ``[F, 3]``, piece of each face ``[F]``) of every mesh and shape at rest."""
        found = [(mesh.triangles, face_colours(mesh), components(mesh)) for mesh in self.scene.meshes]
        for shape in self.scene.primitives:
            if not isinstance(shape, Plane) and shape not in self.scene.moving:
                mesh = shape.mesh()
                found.append((mesh.triangles, face_colours(mesh), np.zeros(len(mesh.faces), dtype=int)))
        return found

    @cached_property
    def _inward(self) -> bool:
        return any(inward(mesh) for mesh in self.scene.meshes)

    def _look(self, poses: list[int], aspect: float) -> Camera:
        """A camera for the motion, or for the whole scene where there is none."""
        parts = [triangles for triangles, _, _ in self._solids]
        last = self._time(poses[-1]) if poses else 0.0  # when what moves is drawn solid
        parts += [thing.mesh(last).triangles for thing in self.scene.moving]
        triangles = np.concatenate(parts) if parts else np.zeros((0, 3, 3))
        along = np.zeros(2)
        if not poses:
            low, high = self.scene.bounds
            high = np.array([high[0], min(high[1], low[1] + 2.2), high[2]])
            points = np.array(
                [[x, y, z] for x in (low[0], high[0]) for y in (low[1], high[1]) for z in (low[2], high[2])]
            )
            points = np.concatenate([points, points.mean(axis=0) + np.zeros((40, 3))])
        else:
            points = np.concatenate([self._joints(frame) for frame in poses])
            way = self._joints(poses[-1])[0] - self._joints(poses[0])[0]
            along = way[[0, 2]] / max(float(np.hypot(way[0], way[2])), 1e-6)
            along = along if np.hypot(way[0], way[2]) > 0.5 else np.zeros(2)
            if self.path is not None:
                points = np.concatenate([points, self.path[::10]])
            points = np.concatenate([points, *self._targets()])
        return choose(points, Sight(self._cut(triangles), self._inward), along, aspect)

    def _targets(self) -> list[np.ndarray]:
        """Places that goals name, ``[1, 3]`` each, for the picture to hold them."""
        floor, found = self.scene.floor.height, []
        for term in () if self.objective is None else self.objective.counted:
            if term.goal == "joint_target":
                found += [np.array([list(p)]) for p in instances(dict(term.parameters), Point)]
                found += [np.array([[p.x, floor, p.z]]) for p in instances(dict(term.parameters), FloorPoint)]
        return found

    def _cut(self, triangles: np.ndarray) -> np.ndarray:
        """Triangles that do not belong to a ceiling."""
        return triangles[triangles[:, :, 1].min(axis=1) < self._ceiling]

    @cached_property
    def _ceiling(self) -> float:
        """Height above which everything is left away, so that rooms can be looked into; infinite without a ceiling."""
        floor = self.scene.floor.height
        tops = [t[:, :, 1].max() for t, _, _ in self._solids] or [floor]
        heads = 0.0 if self.motion is None else float(self.motion.joint("head")[..., 1].max()) + 0.25
        return max(floor + 2.0, heads) if max(tops) > floor + 2.6 or self._inward else float("inf")

    # ---- the parts of a picture -------------------------------------------------------------------------------

    def _plotter(self, off_screen: bool, size: tuple[int, int]) -> Any:
        pv = load_pyvista(off_screen)
        plotter = pv.Plotter(off_screen=off_screen, window_size=list(size), lighting="none")
        set_stage(plotter)
        plotter.enable_anti_aliasing("msaa", multi_samples=8)
        return plotter

    def _add_scene(self, plotter: Any, camera: Camera, poses: list[int], opacity: float) -> None:
        """Solids (cut open towards the camera), the ground where the scene has no floor of its own, and light."""
        look_from(plotter, camera)
        probes = np.concatenate([self._joints(frame) for frame in poses]) if poses else np.zeros((0, 3))
        for triangles, colours, pieces in self._solids:
            seen = triangles[:, :, 1].min(axis=1) < self._ceiling
            if self._inward:  # the walls of an inward-facing room turn their backs to a camera outside
                edges = triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0]
                seen &= (np.cross(*edges) * (camera.position - triangles[:, 0])).sum(-1) > 0
            glass = seen & np.isin(pieces, self._in_the_way(triangles[seen], pieces[seen], probes, camera))
            self._add_triangles(plotter, triangles[seen & ~glass], colours[seen & ~glass], opacity)
            self._add_triangles(plotter, triangles[glass], colours[glass], min(opacity, _GLASS))
        if not self.scene.meshes:
            self._add_ground(plotter, probes if len(probes) else np.zeros((1, 3)))
        add_light(plotter, camera)

    def _in_the_way(self, triangles: np.ndarray, pieces: np.ndarray, probes: np.ndarray, camera: Camera) -> np.ndarray:
        """Objects that cover more than a little of the person: they are drawn like glass."""
        if len(triangles) == 0 or len(probes) == 0:
            return np.zeros(0, dtype=int)
        sight = Sight(triangles, self._inward)
        hits = [np.unique(pieces[sight.covering(camera.position, p)]) for p in probes[:: max(1, len(probes) // 120)]]
        which, counts = np.unique(np.concatenate(hits), return_counts=True)
        small = np.array([(pieces == piece).mean() < 0.5 for piece in which], dtype=bool)
        way: np.ndarray = which[(counts > 0.06 * len(hits)) & small] if len(which) else which
        return way

    def _add_triangles(self, plotter: Any, triangles: np.ndarray, colours: np.ndarray, opacity: float) -> None:
        if len(triangles) == 0:
            return
        data = triangles_to_vtk(triangles)
        data.cell_data["colour"] = colours
        if np.isfinite(self._ceiling):
            data = data.clip("y", origin=(0.0, self._ceiling, 0.0))
        plotter.add_mesh(
            data, scalars="colour", rgb=True, opacity=opacity, ambient=0.36, diffuse=0.75, specular=0.03,
            smooth_shading=False, show_scalar_bar=False,
        )  # fmt: skip

    def _add_ground(self, plotter: Any, around: np.ndarray) -> None:
        """A tiled floor of 0.5 m squares, so that distances can be read off."""
        import pyvista as pv

        low = np.floor(around.min(axis=0)[[0, 2]] - 1.5)
        high = np.ceil(around.max(axis=0)[[0, 2]] + 1.5)
        counts = (2 * (high - low)).astype(int)
        height = self.scene.floor.height
        plane = pv.Plane(
            center=((low[0] + high[0]) / 2, height, (low[1] + high[1]) / 2), direction=(0.0, 1.0, 0.0),
            i_size=high[1] - low[1], j_size=high[0] - low[0], i_resolution=counts[1], j_resolution=counts[0],
        )  # fmt: skip
        centres = plane.cell_centers().points
        odd = (np.floor(centres[:, 0] * 2) + np.floor(centres[:, 2] * 2)) % 2
        plane.cell_data["colour"] = np.where(odd[:, None] > 0, [232, 229, 223], [222, 218, 211]).astype(np.uint8)
        plotter.add_mesh(plane, scalars="colour", rgb=True, ambient=0.4, diffuse=0.7, show_scalar_bar=False)

    def _add_people(self, plotter: Any, poses: list[int], clearance: bool) -> None:
        """Bodies from pale (early) to strong (late), their shadows, the pelvis's way and the times."""
        if not poses:
            return
        assert self.motion is not None
        shares = np.linspace(0.0, 1.0, len(poses)) if len(poses) > 1 else np.ones(1)
        samples, radii = self.body.points(self.motion)
        self._add_shadow(
            plotter,
            [samples[f].detach().double().numpy() for f in poses],
            radii.numpy(),
            (0.22 + 0.28 * shares).tolist(),
        )
        for frame, share in zip(poses, shares, strict=True):
            colour = ((1 - share) * _FIRST + share * _LAST).astype(int).tolist()
            self.add_body(plotter, frame, colour, clearance)
        if len(poses) > 1:
            self._add_line(plotter, self.motion.joint("pelvis")[: poses[-1] + 1].double().numpy(), "#8a3b1e", 0.008)
        self._add_times(plotter, poses)

    def add_body(self, plotter: Any, frame: int, colour: list[int], clearance: bool, name: str | None = None) -> Any:
        """One body; returns its mesh."""
        import pyvista as pv

        shape = BodyShape(self.body)
        faces = np.column_stack([np.full(len(shape.faces), 3), shape.faces])
        vertices, normals = shape.vertices(self._joints(frame))
        data = pv.PolyData(vertices, faces.ravel())
        data.point_data.active_normals = normals
        look: dict[str, Any] = {"interpolation": "phong", "ambient": 0.3, "diffuse": 0.72, "specular": 0.12}
        look["name"] = name
        if clearance:
            data.point_data["clearance (m)"] = self.clearances(data.points, frame)
            bar = {"title": "clearance (m)", "color": "black", "width": 0.25, "position_x": 0.7, "position_y": 0.03}
            plotter.add_mesh(data, scalars="clearance (m)", cmap="RdYlGn", clim=[0.0, 0.4], scalar_bar_args=bar, **look)
        else:
            plotter.add_mesh(data, color=colour, **look)
        return data

    def clearances(self, points: np.ndarray, frame: int) -> np.ndarray:
        """Distance (m) of points on the body to the scene at a frame; negative inside."""
        assert self.motion is not None
        time = torch.full((len(points),), float(self.motion.times[frame]))
        with torch.no_grad():
            distance: np.ndarray = self.scene.distance(torch.as_tensor(np.array(points)).float(), time).numpy()
        return distance

    def _add_shadow(self, plotter: Any, bodies: list[np.ndarray], radii: np.ndarray, strengths: list[float]) -> None:
        import pyvista as pv

        x, z, dark = soft_shadow(bodies, radii, strengths)
        height = self.scene.floor.height + 0.012
        grid = pv.StructuredGrid(*np.meshgrid(x, [height], z, indexing="ij"))
        shade = np.zeros((dark.size, 4), dtype=np.uint8)
        shade[:, :3], shade[:, 3] = 30, (255 * dark).astype(np.uint8).ravel(order="F")
        grid.point_data["shade"] = shade
        plotter.add_mesh(grid, scalars="shade", rgba=True, lighting=False, show_scalar_bar=False)

    def _add_times(self, plotter: Any, poses: list[int]) -> None:
        assert self.motion is not None
        heads = [self._joints(frame)[self.motion.skeleton.index("head")] + [0.0, 0.24, 0.0] for frame in poses]
        texts = [f"{float(self.motion.times[frame]):.1f} s" for frame in poses]
        plotter.add_point_labels(
            np.array(heads), texts, font_size=18, text_color="#40403c", shape=None, show_points=False,
            always_visible=True, bold=False,
        )  # fmt: skip

    def _add_line(self, plotter: Any, points: np.ndarray, colour: str, radius: float) -> None:
        import pyvista as pv

        kept = points[np.r_[True, np.linalg.norm(np.diff(points, axis=0), axis=1) > 1e-4]]
        if len(kept) > 1:
            plotter.add_mesh(pv.lines_from_points(kept).tube(radius=radius), color=colour, ambient=0.4)

    def _add_goals(self, plotter: Any) -> None:
        """The planned path, targets, tracks and obstacles of goals."""
        lift = np.array([0.0, 0.02, 0.0])
        if self.path is not None:
            self._add_line(plotter, self.path + lift, _PATH, 0.015)
            self._add_ring(plotter, self.path[-1] + lift, 0.1)
        for term in () if self.objective is None else self.objective.counted:
            self._add_term(plotter, term)
        if self.title:
            plotter.add_text(self.title, position=(0.015, 0.945), viewport=True, font_size=12, color="#40403c")

    def _add_term(self, plotter: Any, term: Term) -> None:
        """What one goal says about places."""
        import pyvista as pv

        floor, parameters = self.scene.floor.height, term.parameters
        if term.goal == "square_region":
            half, centre = parameters["half"], parameters.get("center", FloorPoint(0.0, 0.0))
            corners = [(-half, -half), (half, -half), (half, half), (-half, half), (-half, -half)]
            square = np.array([[centre.x + x, floor + 0.02, centre.z + z] for x, z in corners])
            self._add_line(plotter, square, _GOAL, 0.015)
        elif term.goal == "sphere_repulsion":
            for p in instances(parameters["center"], Point):
                plotter.add_mesh(pv.Sphere(radius=parameters["radius"], center=p), color=_OBSTACLE, opacity=0.5)
        elif term.goal == "joint_target":
            for p in instances(dict(parameters), Point):
                plotter.add_mesh(pv.Sphere(radius=max(term.allowed, 0.03), center=p), color=_GOAL, opacity=0.85)
            for f in instances(dict(parameters), FloorPoint):
                self._add_ring(plotter, np.array([f.x, floor + 0.02, f.z]), max(term.allowed, 0.05))
        for track in instances(dict(parameters), TrackBase):
            times = torch.linspace(*track.span, 120, dtype=torch.float64)
            for column in track.position(times).permute(1, 0, 2).numpy():
                self._add_line(plotter, column, _GOAL, 0.01)

    def _add_ring(self, plotter: Any, centre: np.ndarray, radius: float) -> None:
        import pyvista as pv

        ring = pv.Disc(center=centre, inner=0.8 * radius, outer=radius + 0.03, normal=(0.0, 1.0, 0.0), c_res=48)
        plotter.add_mesh(ring, color=_GOAL, lighting=False)
        plotter.add_mesh(
            pv.Disc(center=centre, inner=0.0, outer=0.03, normal=(0.0, 1.0, 0.0), c_res=24), color=_GOAL, lighting=False
        )

    @cached_property
    def _moving_colours(self) -> list[np.ndarray]:
        return [face_colours(thing.mesh(), _OBSTACLE) for thing in self.scene.moving]

    def add_moving(self, plotter: Any, times: list[float]) -> None:
        """What moves, where it is at each time (s): pale at first, solid at last, as the person is."""
        shares = np.linspace(0.0, 1.0, len(times)) if len(times) > 1 else np.ones(1)
        for k, thing in enumerate(self.scene.moving):
            for i, (time, share) in enumerate(zip(times, shares, strict=True)):
                data = triangles_to_vtk(thing.mesh(time).triangles)
                data.cell_data["colour"] = self._moving_colours[k]
                plotter.add_mesh(
                    data, scalars="colour", rgb=True, opacity=0.15 + 0.85 * share**2, ambient=0.36, diffuse=0.75,
                    show_scalar_bar=False, name=f"moving {k} {i}",
                )  # fmt: skip

    def _add_signs(self, plotter: Any) -> None:
        """Uncertain voxels, coloured by how much of the evidence agrees, the holes in meshes, and the summaries."""
        bar = {"title": "agreeing evidence (%)", "color": "black", "width": 0.25, "position_x": 0.7, "position_y": 0.03}
        for result, segments in ((baked, Surface.of(mesh).open_edges) for mesh, baked in self._baked):
            if (blocks := uncertain_blocks(result)) is not None:
                plotter.add_mesh(
                    blocks, scalars="agreeing evidence (%)", cmap="plasma", clim=[0, UNCERTAIN], opacity=0.35,
                    lighting=False, scalar_bar_args=bar,
                )  # fmt: skip
            if (lines := open_edges(segments)) is not None:
                plotter.add_mesh(lines, color=_GOAL, line_width=2, lighting=False)
        text = "\n".join(f"{mesh.name}: {result.signs.summary}" for mesh, result in self._baked)
        plotter.add_text(text, position=(0.015, 0.02), viewport=True, font_size=12, color="#40403c")

    @property
    def _baked(self) -> list[tuple[Mesh, Bake[Any]]]:
        return list(zip(self.scene.meshes, self.scene.bakes, strict=True))

    def _add_slice(self, plotter: Any, height: float, time: float) -> Any:
        """Signed distances on a horizontal plane at a time (s); the white line is the surface."""
        data = self.slice_at(height, time)
        bar = {"title": "distance (m)", "color": "black", "width": 0.25, "position_x": 0.05, "position_y": 0.03}
        plotter.add_mesh(
            data, scalars="distance (m)", cmap="RdBu", clim=[-0.6, 0.6], opacity=0.6, lighting=False, name="slice",
            scalar_bar_args=bar,
        )  # fmt: skip
        zero = data.contour([0.0], scalars="distance (m)")
        if zero.n_points:
            plotter.add_mesh(zero, color="white", line_width=3, name="slice surface", lighting=False)
        return data

    def slice_at(self, height: float, time: float = 0.0) -> Any:
        """The distance field at a height (m) and a time (s), as a grid of 4 cm or coarser."""
        import pyvista as pv

        low, high = self.scene.bounds
        step = max(0.04, float((high - low)[[0, 2]].max()) / 300)
        x, z = np.arange(low[0], high[0] + step, step), np.arange(low[2], high[2] + step, step)
        grid = pv.StructuredGrid(*np.meshgrid(x, [height], z, indexing="ij"))
        with torch.no_grad():
            distance = self.scene.distance(torch.as_tensor(np.array(grid.points)).float(), torch.tensor(time))
        grid.point_data["distance (m)"] = distance.numpy()
        return grid


class _Window:
    """The state of the interactive window: which frame, and what is switched on."""

    def __init__(self, picture: Picture, plotter: Any, show_slice: bool) -> None:
        self.picture, self.plotter = picture, plotter
        self.frame, self.clearance, self.slice, self.height = 0, False, show_slice, picture._hip_height
        if picture.motion is not None:
            end = float(picture.motion.times[-1])
            plotter.add_slider_widget(self.at, [picture.motion.t0, end], value=picture.motion.t0, title="time (s)",
                                      pointa=(0.35, 0.08), pointb=(0.95, 0.08), color="black")  # fmt: skip
            plotter.add_key_event("c", self.toggle_clearance)
            plotter.add_key_event("Right", lambda: self.step(1))
            plotter.add_key_event("Left", lambda: self.step(-1))
        plotter.add_key_event("s", self.toggle_slice)
        floor = picture.scene.floor.height
        plotter.add_slider_widget(self.at_height, [floor, floor + 2.0], value=self.height, title="slice (m)",
                                  pointa=(0.03, 0.08), pointb=(0.25, 0.08), color="black")  # fmt: skip
        keys = "s slice   c clearance   left/right one frame   q leave"
        plotter.add_text(keys, position="lower_left", font_size=9, color="#40403c")
        self.redraw()

    def at(self, seconds: float) -> None:
        """The time slider was moved."""
        assert self.picture.motion is not None
        self.frame = self.picture.motion.frame_at(seconds)
        self.redraw()

    def step(self, frames: int) -> None:
        """One frame on or back."""
        assert self.picture.motion is not None
        self.frame = int(np.clip(self.frame + frames, 0, self.picture.motion.frames - 1))
        self.redraw()

    def at_height(self, height: float) -> None:
        """The slice's slider was moved."""
        self.height = height
        self.redraw()

    def toggle_clearance(self) -> None:
        """Colour the body by its distance to the scene, or not."""
        self.clearance = not self.clearance
        self.redraw()

    def toggle_slice(self) -> None:
        """Show the distance field, or not."""
        self.slice = not self.slice
        self.redraw()

    def redraw(self) -> None:
        """What moves, the body and the slice as they are now."""
        now = self.picture._time(self.frame)
        self.picture.add_moving(self.plotter, [now])
        if self.picture.motion is not None:
            self.picture.add_body(self.plotter, self.frame, _LAST.astype(int).tolist(), self.clearance, name="body")
        for name in ("slice", "slice surface"):
            self.plotter.remove_actor(name, render=False)
        if self.slice:
            self.picture._add_slice(self.plotter, self.height, now)


def set_stage(plotter: Any) -> None:
    """The background of all pictures."""
    plotter.set_background(_BACK, top=_HORIZON)


def look_from(plotter: Any, camera: Camera) -> None:
    """Put the plotter's camera where one was chosen."""
    plotter.camera.position, plotter.camera.focal_point = camera.position.tolist(), camera.target.tolist()
    plotter.camera.up, plotter.camera.view_angle = (0.0, 1.0, 0.0), ANGLE


def write_png(plotter: Any, png: str | Path) -> None:
    """What a plotter shows as a file, written whole or not at all; closes the plotter."""
    from PIL import Image

    image = plotter.screenshot(return_img=True)
    plotter.close()
    with atomic_write(png) as file:
        Image.fromarray(image).save(file, format="PNG")


def add_light(plotter: Any, camera: Camera) -> None:
    """A key light over the camera's left shoulder, a soft one from the right, and a little from above."""
    import pyvista as pv

    back = camera.position - camera.target
    right = np.cross([0.0, 1.0, 0.0], back)
    scale = float(np.linalg.norm(back))
    right = right / max(float(np.linalg.norm(right)), 1e-9) * scale
    for offset, strength in (
        (back - 0.5 * right + [0.0, 0.7 * scale, 0.0], 0.62),
        (back + 0.9 * right + [0.0, 0.2 * scale, 0.0], 0.3),
        (np.array([0.0, scale, 0.0]) - 0.3 * back, 0.34),
    ):
        light = pv.Light(
            position=(camera.target + offset).tolist(), focal_point=camera.target.tolist(), intensity=strength
        )
        light.positional = False
        plotter.add_light(light)


_OFF_SCREEN = {
    "libEGL.so.1": "vtkEGLRenderWindow",
    "libOSMesa.so.8": "vtkOSOpenGLRenderWindow",
    "libOSMesa.so.6": "vtkOSOpenGLRenderWindow",
}


def load_pyvista(off_screen: bool) -> Any:
    """pyvista, where something can be drawn; raises UserError naming what to install otherwise."""
    if off_screen and sys.platform == "linux" and not os.environ.get("DISPLAY"):
        # VTK would try the X server first, complain, and crash where nothing else is there
        window = next((kind for library, kind in _OFF_SCREEN.items() if _loads(library)), None)
        if window is None:
            raise UserError(
                "pictures need EGL to be drawn without a screen; install it with: apt-get install libegl1 libegl-mesa0 "
                "libgl1-mesa-dri"
            )
        os.environ.setdefault("VTK_DEFAULT_OPENGL_WINDOW", window)
    try:
        import pyvista as pv
    except ImportError as error:
        raise UserError(
            f"pictures need VTK, which cannot be loaded ({error}); install its libraries with: apt-get install libgl1 "
            "libx11-6 libxrender1"
        ) from error
    return pv


def _loads(library: str) -> bool:
    try:
        ctypes.CDLL(library)
    except OSError:
        return False
    return True
