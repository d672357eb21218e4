"""A row of poses side by side, for moments at which a person stays where they are."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from objectives import Mark
from scenectl.view.camera import Camera, look_from
from scenectl.view.labels import Label, Panel, cut, font, spots
from scenectl.view.marks import draw_mark, moves, places
from scenectl.view.moments import Moment
from scenectl.view.stage import open_stage, shot
from scenes.motion.headings import heading, rotation_about_y

if TYPE_CHECKING:
    from pyvista import Plotter

    from scenectl.view.staging import Staging

_FACING = np.deg2rad(35.0)
"""Angle between the way the person faces at first and the way to the camera: both front and side show."""
_ABOVE = np.deg2rad(9.0)
"""Elevation of the camera: the floor shows, and heights can still be compared."""
_GAP, _RADIUS = 0.12, 0.1
"""Metres between two people, and around their joints."""
_LINE = 1.35
"""Heights of letters from one line of a label to the next; one more line is left over people for its edges."""
_LOW = 0.25
"""Metres of floor in front of the feet."""
_NEAR = 1.0
"""Metres from a person's joints within which marks are drawn beside them."""
_DEEP = 1.6
"""Metres of floor from the back to the front."""
_FLOOR = (226, 223, 217)


def draw_row(picture: Staging, moments: Sequence[Moment], size: tuple[int, int], clearance: bool, height: int) -> Panel:
    """People at several moments beside each other, each with the marks of goals that apply then.

    Args:
        picture: whose people.
        moments: when.
        size: pixels.
        clearance: colour bodies by their distance to the scene.
        height: of letters, pixels.
    """
    wide = max(size[0] / len(moments) - height, 4 * height)
    told = ["\n".join(cut(line, wide, font(height)) for line in picture.told(m).split("\n")) for m in moments]
    lines = max(text.count("\n") + 1 for text in told)
    row = _Row(picture, moments, size, round((lines + 1) * _LINE * height))
    stage = open_stage(size)
    row.set_up(stage)
    for k in range(len(moments)):
        row.draw(stage, k, clearance)
    heads = np.stack([pose[pose[:, 1].argmax()] + [0.0, 0.2, 0.0] for pose in row.poses])
    labels = [Label(text, (x, y)) for text, (x, y) in zip(told, row.pixels(heads).tolist(), strict=True)]
    joints = np.concatenate(row.poses)
    return Panel(shot(stage), labels, spots(row.pixels(joints), np.full(len(joints), _RADIUS * row.scale), size))


class _Row:
    """Where people of a row are: +x goes along it, +z to the camera."""

    def __init__(self, picture: Staging, moments: Sequence[Moment], size: tuple[int, int], writing: int) -> None:
        assert picture.motion is not None
        self.picture, self.moments, self.size = picture, moments, size
        self.roots = [self._root(moment.frame) for moment in moments]
        first = heading(picture.motion)[moments[0].frame].double().cpu()
        turns = [rotation_about_y(side * _FACING - first).numpy() for side in (1, -1)]
        self.turn = max(turns, key=self._shows)
        poses = [
            (picture.joints(moment.frame) - root) @ self.turn.T
            for moment, root in zip(moments, self.roots, strict=True)
        ]
        left = np.array([pose[:, 0].min() - _RADIUS - _GAP / 2 for pose in poses])
        wide = np.array([pose[:, 0].max() + _RADIUS + _GAP / 2 for pose in poses]) - left
        tall = max(float(pose[:, 1].max()) for pose in poses) + 0.2 + _LOW
        self.scale = min(size[0] / wide.sum(), max(size[1] - writing, size[1] / 2) / tall)
        spare = (size[0] / self.scale - wide.sum()) / len(poses)
        begins = np.cumsum(wide + spare) - wide - spare / 2
        self.shifts = [np.array([begin - at, 0.0, 0.0]) for begin, at in zip(begins, left, strict=True)]
        self.poses = [pose + shift for pose, shift in zip(poses, self.shifts, strict=True)]
        high = (size[1] - writing) / self.scale - tall  # what is left over where the row is as wide as the picture
        self.target = np.array([size[0], size[1], 0.0]) / self.scale / 2 - [0.0, _LOW + max(high, 0.0) / 2, 0.0]

    def _root(self, frame: int) -> np.ndarray:
        """The place on the ground under a person, ``[3]`` m."""
        pelvis = self.picture.joints(frame)[:1]
        return np.array([pelvis[0, 0], self.picture.ground(pelvis)[0], pelvis[0, 2]])

    def _shows(self, turn: np.ndarray) -> float:
        """How far before people, as they are turned, the marks are (m, summed): what is behind them is hidden."""
        marked = [self._near(moment.frame) for moment in self.moments]
        near = [points - root for marks, root in zip(marked, self.roots, strict=True) for _, _, points in marks]
        return sum((float((points @ turn[2]).sum()) for points in near), 0.0)

    def _near(self, frame: int) -> list[tuple[Mark, bool, np.ndarray]]:
        """Marks near the person at a frame, whether their goals are met, and their points (m, world)."""
        found, picture = [], self.picture
        for goal in picture.goals:
            for mark in goal.at(frame):
                points = places(mark, picture.ground, picture.time(frame))
                away = np.linalg.norm(points[:, None] - picture.joints(frame), axis=-1).min(initial=np.inf)
                told = mark.role == "goal" or not moves(mark)
                if mark.shape in ("ball", "ring", "arrow") and told and away < _NEAR:
                    found.append((mark, goal.met, points))
        return found

    def set_up(self, stage: Plotter) -> None:
        """Camera, light and a floor."""
        from pyvista import Plane

        back = np.array([0.0, np.sin(_ABOVE), np.cos(_ABOVE)])
        look_from(stage, Camera(self.target + 20.0 * back, self.target))
        stage.camera.parallel_projection = True
        stage.camera.parallel_scale = self.size[1] / self.scale / 2
        width = 2 * self.size[0] / self.scale
        floor = Plane(center=(self.target[0], 0.0, 0.0), direction=(0.0, 1.0, 0.0), i_size=_DEEP, j_size=width)
        stage.add_mesh(floor, color=_FLOOR, lighting=False)

    def pixels(self, points: np.ndarray) -> np.ndarray:
        """Where points ``[n, 3]`` of the row are in the image, ``[n, 2]``."""
        offset = points - self.target
        up = offset[:, 1] * np.cos(_ABOVE) - offset[:, 2] * np.sin(_ABOVE)
        return np.stack([offset[:, 0], -up], axis=1) * self.scale + np.array(self.size) / 2

    def draw(self, stage: Plotter, k: int, clearance: bool) -> None:
        """The k-th person and the marks near them of goals that apply then."""
        picture, frame = self.picture, self.moments[k].frame
        matrix = np.eye(4)
        matrix[:3, :3] = self.turn
        matrix[:3, 3] = self.shifts[k] - self.turn @ self.roots[k]
        picture.draw_body(stage, frame, clearance, picture.colour(frame), f"person {k}", matrix, legend=False)
        wrists, time = picture.wrists(frame), picture.time(frame)
        picture.room.draw_in_hands(stage, time, wrists, matrix, f"person {k}")
        for mark, met, points in self._near(frame):
            draw_mark(stage, mark, points @ self.turn.T + matrix[:3, 3], met)
