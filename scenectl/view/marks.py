"""Drawing the marks of goals: balls, rings, lines, capsules and arrows, whatever the goal."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np

from objectives import Mark
from scenectl.view.shapes import arrow, capsules
from scenectl.view.stage import ROUND
from scenes.mesh.colours import OBSTACLE

if TYPE_CHECKING:
    from pyvista import Plotter

Ground = Callable[[np.ndarray], np.ndarray]
"""Heights (m) of the ground at points ``[P, 3]``, of which x and z count."""

GOAL, WAY = (200, 50, 43), (47, 125, 107)
REACHED = (46, 150, 72)
"""Of what is wanted and met, in place of `GOAL`."""
LIFT = 0.02
"""Metres by which what lies on the floor is raised, so that it shows."""
_COLOURS = {"goal": GOAL, "way": WAY, "obstacle": OBSTACLE}
_LINE, _DOT, _LEAST = 0.015, 0.03, 0.05
"""Radii (m) of lines and of the dot in a ring, and the least of a ring: seen from across a room."""


def draw_marks(stage: Plotter, marks: Sequence[Mark], ground: Ground, met: bool = False) -> None:
    """Draw those marks of a goal, `met` or not, that stand still; `ground` tells the height of what states none."""
    for mark in (mark for mark in marks if not moves(mark)):
        draw_mark(stage, mark, places(mark, ground), met)


def draw_moving_marks(
    stage: Plotter, marks: Sequence[Mark], ground: Ground, times: Mapping[float, bool], met: bool, name: str
) -> None:
    """Draw those marks of a goal, `met` or not, that move in place of where they were.

    They are drawn at those of some times (s) at which the goal applies, pale at first and solid at last; `name` tells
    the goal's marks from those of others.
    """
    for k, mark in enumerate(marks):
        for i, (time, share) in enumerate(zip(times, fading(len(times)), strict=True)) if moves(mark) else ():
            if times[time]:
                draw_mark(stage, mark, places(mark, ground, time), met, share, f"{name}, mark {k} {i}")
            else:
                stage.remove_actor(f"{name}, mark {k} {i}")


def moves(mark: Mark) -> bool:
    """It is not at one place all the time."""
    return mark.times is not None and bool((mark.points != mark.points[:1]).any())


def fading(count: int) -> list[float]:
    """Opacities of one thing at several times, the last one solid."""
    return [0.15 + 0.85 * share**2 for share in shares(count)]


def shares(count: int) -> list[float]:
    """From 0 for the first of several to 1 for the last; 1 for a single one."""
    return np.linspace(1.0, 0.0, count)[::-1].tolist()


def places(mark: Mark, ground: Ground, time: float = 0.0) -> np.ndarray:
    """Points of a mark at a time (s), ``[P, 3]`` m; those without a height a little over the ground."""
    now = mark.points if mark.times is None else mark.points[(mark.times - time).abs().argmin()]
    points: np.ndarray = now.detach().cpu().double().numpy().copy()
    points[..., 1] = np.where(np.isnan(points[..., 1]), ground(points) + LIFT, points[..., 1])
    return points


def draw_line(stage: Plotter, points: np.ndarray, colour: tuple[int, int, int], radius: float) -> None:
    """A tube of a radius (m) along a polyline ``[P, 3]``; nothing where it has no length."""
    from pyvista import lines_from_points

    kept = points[np.r_[True, np.linalg.norm(np.diff(points, axis=0), axis=1) > 1e-4]]
    if len(kept) > 1:
        stage.add_mesh(lines_from_points(kept).tube(radius=radius, n_sides=12), color=colour, ambient=0.4, **ROUND)


def draw_mark(
    stage: Plotter, mark: Mark, points: np.ndarray, met: bool = False, share: float = 1.0, name: str | None = None
) -> None:
    """Draw one mark with its points at ``[P, 3]`` m; `share` of its opacity."""
    from pyvista import Disc, merge

    colour, radius = REACHED if met and mark.role == "goal" else _COLOURS[mark.role], max(mark.radius, _DOT)
    if not np.isfinite(points).all():
        return
    if mark.shape == "line":
        draw_line(stage, points, colour, mark.radius or _LINE)
    elif mark.shape == "arrow":
        stage.add_mesh(arrow(*points), color=colour, opacity=share, ambient=0.4, name=name, **ROUND)
    elif mark.shape == "ring":
        wide = max(mark.radius, _LEAST)
        flat = [
            Disc(center=point, inner=inner, outer=outer, normal=(0.0, 1.0, 0.0), c_res=48)
            for point in points
            for inner, outer in ((0.8 * wide, wide + _DOT), (0.0, _DOT))  # a ring and a dot in it
        ]
        stage.add_mesh(merge(flat), color=colour, lighting=False, name=name)
    else:
        a, b = (points, points) if mark.shape == "ball" else (points[:1], points[1:2])
        hull = capsules(a, b, np.full((len(a), 2), radius))
        opacity = share * (0.85 if mark.role == "goal" and mark.shape == "ball" else 0.5)
        stage.add_mesh(hull, color=colour, opacity=opacity, name=name, **ROUND)
