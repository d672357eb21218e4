"""Pictures of robots: a trajectory replayed by MuJoCo's kinematics, in its scene, as a row of moments or as a GIF."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from io import BytesIO
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from jaxtyping import Float

from scenectl.retarget.robots.capsules import capsules_of, poses
from scenectl.retarget.robots.standing import standing
from scenectl.retarget.robots.trajectory import Trajectory
from scenectl.view.camera import Camera, choose, look_from
from scenectl.view.marks import draw_line
from scenectl.view.moments import APART
from scenectl.view.room import Room
from scenectl.view.shapes import facets
from scenectl.view.stage import MATT, SIZE, open_stage, shot, write
from scenes.body.mjcf import geom_solid, geoms_of
from scenes.files import atomic_write
from scenes.mesh.scale import TO_Y_UP
from scenes.world.scene import Scene

if TYPE_CHECKING:
    from pyvista import Plotter

FPS = 20
"""Frames a second of a GIF, at most."""
SMALL = (640, 400)
"""Pixels of a GIF."""
_FIGURES = 5
"""Moments of a picture, at most."""
_COARSE = 500
"""Triangles of a shape in a GIF, about: a robot's meshes have thousands a pixel."""
_COLOURS = 128
"""Of a GIF's palette."""
_TRAIL = (138, 59, 30)


@dataclass(frozen=True, eq=False)
class Replay:
    """A trajectory to look at.

    Attributes:
        trajectory: of a robot.
        scene: y up, that it moves in.
    """

    trajectory: Trajectory
    scene: Scene

    @classmethod
    def of(cls, trajectory: Trajectory, scene: Scene | None) -> Replay:
        """In a scene, or on an empty floor under its lowest sole."""
        return cls(trajectory, Scene.empty(lowest(trajectory)) if scene is None else scene)

    def draw(self, png: str | Path) -> None:
        """Some moments of it in one picture, as a PNG file."""
        root = self._places[:, 1] @ TO_Y_UP["z"].T
        way = float(np.linalg.norm(np.diff(root[:, [0, 2]], axis=0), axis=1).sum())
        count = int(np.clip(1 + way / APART, 1, _FIGURES)) if way > APART / 2 else 1
        shown = np.linspace(0, len(root) - 1, count).astype(int).tolist() if count > 1 else [len(root) - 1]
        camera = self._camera(shown, SIZE)
        stage = open_stage()
        look_from(stage, camera)
        self._room.draw(stage, camera, [self._ends(frame) for frame in shown], 1.0)
        self._room.draw_moving(stage, [self._time(shown[-1])])
        for frame in shown:
            for body, actor in self._put(stage):
                actor.user_matrix = self._pose(frame, body)
        if count > 1:
            draw_line(stage, root, _TRAIL, 0.008)
        write(shot(stage), png)

    def animate(self, gif: str | Path) -> None:
        """All of it as an animated GIF."""
        from PIL import Image

        rate = min(float(FPS), self.trajectory.fps)
        times = np.arange(0, (self.trajectory.frames - 0.5) / self.trajectory.fps, 1 / rate)
        frames = np.minimum((times * self.trajectory.fps).round(), self.trajectory.frames - 1).astype(int).tolist()
        camera = self._camera(frames[:: max(1, len(frames) // 20)], SMALL)
        stage = open_stage(SMALL)
        look_from(stage, camera)
        self._room.draw(stage, camera, [self._ends(frame) for frame in frames[:: max(1, len(frames) // 6)]], 1.0)
        images, robot = [], self._put(stage, _COARSE)
        for frame in frames:
            self._room.draw_moving(stage, [self._time(frame)])
            for body, actor in robot:
                actor.user_matrix = self._pose(frame, body)
            stage.render()  # bodies that moved alone are not seen as a change
            image = Image.fromarray(np.asarray(stage.screenshot(return_img=True)))
            images.append(image.quantize(_COLOURS, dither=Image.Dither.NONE))
        stage.close()
        last, buffer = 1000 / rate, BytesIO()
        images[0].save(buffer, "GIF", save_all=True, append_images=images[1:], duration=last, loop=0, optimize=True)
        with atomic_write(gif) as file:
            file.write(buffer.getvalue())

    @cached_property
    def _poses(self) -> tuple[np.ndarray, np.ndarray]:
        return poses(self.trajectory.robot.model, self.trajectory.qpos)

    @property
    def _places(self) -> Float[np.ndarray, "T B 3"]:
        return self._poses[0]

    @cached_property
    def _shapes(self) -> list[tuple[int, Float[np.ndarray, "F 3 3"], Any]]:
        """What is seen of the robot: body, triangles in its frame, and colour of each shape."""
        model = self.trajectory.robot.model
        found = []
        for body in range(1, model.nbody):
            collides, seen = geoms_of(model, body)
            for geom in seen or collides:
                vertices, faces = geom_solid(model, geom)
                found.append((body, vertices[faces], _colour(model, geom)))
        return found

    @cached_property
    def _room(self) -> Room:
        heads = float((self._all[..., 2] + self._radius).max())
        return Room(self.scene, heads)

    @cached_property
    def _all(self) -> Float[np.ndarray, "T C 3"]:
        """Ends of the robot's capsules over time, z up."""
        ends = capsules_of(self.trajectory.robot).placed(*self._poses)
        return ends.reshape(len(ends), -1, 3)

    @property
    def _radius(self) -> float:
        return float(capsules_of(self.trajectory.robot).radii.max())

    def _ends(self, frame: int) -> Float[np.ndarray, "n 3"]:
        """Points on the robot at a frame, y up."""
        found: np.ndarray = self._all[frame] @ TO_Y_UP["z"].T
        return found

    def _time(self, frame: int) -> float:
        return self.trajectory.t0 + frame / self.trajectory.fps

    def _camera(self, frames: Sequence[int], size: tuple[int, int]) -> Camera:
        figures = [self._ends(frame) for frame in frames]
        way = (figures[-1].mean(axis=0) - figures[0].mean(axis=0))[[0, 2]]
        length = float(np.linalg.norm(way))
        along = way / length if length > APART else np.zeros(2)
        sight = self._room.sight(self._time(frames[-1]))
        return choose(np.concatenate(figures), sight, along, size[0] / size[1], figures=figures)

    def _put(self, stage: Plotter, most: int | None = None) -> list[tuple[int, Any]]:
        """Put the robot's shapes on a stage, of `most` triangles each; their bodies and pyvista's actors."""
        found = []
        for body, triangles, colour in self._shapes:
            surface = facets(triangles)
            if most is not None and len(triangles) > most:
                surface = surface.clean().decimate(1 - most / len(triangles))
            found.append((body, stage.add_mesh(surface, color=list(colour), **MATT)))
        return found

    def _pose(self, frame: int, body: int) -> Float[np.ndarray, "4 4"]:
        """From a body to our world at a frame."""
        places, turns = self._poses
        pose = np.eye(4)
        pose[:3, :3], pose[:3, 3] = TO_Y_UP["z"] @ turns[frame, body], TO_Y_UP["z"] @ places[frame, body]
        return pose


def lowest(trajectory: Trajectory) -> float:
    """Height (m) of the lowest sole over a trajectory: of the floor where there is no scene."""
    return float(standing(trajectory).points[..., 2].min())


def _colour(model: Any, geom: int) -> tuple[float, float, float]:
    """Of a geom's material, or its own, sRGB 0 to 1."""
    material = int(model.geom_matid[geom])
    red, green, blue = (model.mat_rgba[material] if material >= 0 else model.geom_rgba[geom])[:3].tolist()
    return red, green, blue
