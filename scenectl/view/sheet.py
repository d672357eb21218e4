"""The sheet of a picture: the scene with people apart from each other, those that stay in place in a row, a caption."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from scenectl.view.camera import Camera, seen_along
from scenectl.view.caption import Caption, told
from scenectl.view.labels import COARSE, MET, MISSED, PAPER, Label, Panel, draw_labels, letters, short, spots
from scenectl.view.marks import places
from scenectl.view.moments import APART, Moment
from scenectl.view.row import draw_row
from scenectl.view.stage import INK, open_stage, shot

if TYPE_CHECKING:
    from PIL.Image import Image

    from scenectl.view.staging import Staging

_OVER, _ALONE = 0.12, 0.8
"""Share of a person that another may cover in the scene; seconds around a person that is shown within which one between
others is not missed."""
_ROW, _CROWD = 0.4, 10
"""Height of a row as a share of the sheet's, and how many people it holds."""
_NAMED = 10
"""Goals at most whose marks are labelled."""


class Extras(NamedTuple):
    """What else to show: a slice of the distances, clearances on the body, evidence of signs."""

    slice: bool = False
    clearance: bool = False
    signs: bool = False


class Plan(NamedTuple):
    """What is shown where: moments in the scene, seen by a camera in a part of a size (pixels), and those in a row."""

    shown: list[Moment]
    camera: Camera
    scene: tuple[int, int]
    beside: list[Moment]
    row: tuple[int, int]


def compose(picture: Staging, moments: Sequence[Moment], size: tuple[int, int], extras: Extras) -> Image:
    """All of a picture at some moments, of a size (pixels)."""
    from PIL import Image

    caption = Caption(picture.title, picture.reports, picture.verdict, size)
    plan = planned(picture, moments, (size[0], size[1] - caption.height))
    panels = [draw_scene(picture, plan, extras)] if plan.scene[1] else []
    if plan.beside:
        panels.append(draw_row(picture, plan.beside, plan.row, extras.clearance, letters(size)))
    sheet, top = Image.new("RGB", size, PAPER), 0
    for panel in panels:
        part = Image.fromarray(panel.image)
        draw_labels(part, panel.labels, panel.busy, letters(size))
        sheet.paste(part, (0, top))
        top += part.size[1]
    caption.draw(sheet)
    return sheet


def planned(picture: Staging, moments: Sequence[Moment], size: tuple[int, int]) -> Plan:
    """How moments are shown in a size (pixels): the scene is left away where there is none and nobody moves on."""
    width, height = size
    camera = picture.look(moments, width / height)
    shown, beside = shared_out(picture, moments, camera, size)
    if not beside:
        return Plan(shown, camera, size, beside, (width, 0))
    if picture.room.bare and picture.path is None and set(shown) <= set(beside):
        return Plan(shown, camera, (width, 0), beside, size)
    low = round(_ROW * height)
    back = (camera.position - camera.target) / np.linalg.norm(camera.position - camera.target)
    camera = seen_along(back, picture.points(moments), width / (height - low))
    return Plan(shown, camera, (width, height - low), beside, (width, low))


def shared_out(
    picture: Staging, moments: Sequence[Moment], camera: Camera, size: tuple[int, int]
) -> tuple[list[Moment], list[Moment]]:
    """The moments to show in the scene, where no person hides another, and those to show in a row instead.

    In the row are those that found no place though something is about them, they stay where they were or will be, or
    nobody is shown soon before or after; and those in the scene that stand where they do.
    """
    outlines = [_outline(picture, moment, camera, size) for moment in moments]
    shown: list[int] = []

    def first(k: int) -> tuple[int, int]:
        return moments[k].rank, -k  # of equals the later: what a motion comes to

    for k in sorted(range(len(moments)), key=first):
        if all(_shared(outlines[k], outlines[other]) <= _OVER for other in shown):
            shown.append(k)
    roots = np.array([picture.joints(moment.frame)[0, [0, 2]] for moment in moments]).reshape(-1, 2)
    times = np.array([picture.time(moment.frame) for moment in moments])
    steps = np.linalg.norm(np.diff(roots, axis=0), axis=1)
    stays = np.minimum(np.append(steps, np.inf), np.insert(steps, 0, np.inf)) < APART
    lost = [
        k
        for k, moment in enumerate(moments)
        if k not in shown and (moment.asked or stays[k] or np.abs(times[k] - times[shown]).min() > _ALONE)
    ]
    with_them = [k for k in shown if lost and np.linalg.norm(roots[k] - roots[lost], axis=1).min() < APART]
    beside = sorted(sorted([*lost, *with_them], key=first)[:_CROWD])
    return [moments[k] for k in sorted(shown)], [moments[k] for k in beside]


def _outline(picture: Staging, moment: Moment, camera: Camera, size: tuple[int, int]) -> np.ndarray:
    """Where a person is in a picture, coarse."""
    points = picture.surface(moment.frame)
    pixels, scale = camera.project(points, size)
    return spots(pixels, picture.body.radii().numpy() * scale, size)


def _shared(a: np.ndarray, b: np.ndarray) -> float:
    return float((a & b).sum()) / max(1, min(a.sum(), b.sum()))


def draw_scene(picture: Staging, plan: Plan, extras: Extras) -> Panel:
    """The scene with people at the moments shown."""
    shown, camera, size = plan.shown, plan.camera, plan.scene
    stage, frames = open_stage(size), [moment.frame for moment in shown]
    picture.set_stage(stage, camera, frames, extras.signs)
    picture.draw_moving(stage, [picture.time(frame) for frame in frames] or [0.0])
    if frames:
        picture.draw_people(stage, frames, extras.clearance)
    if extras.slice:
        picture.draw_slice(stage, picture.hip_height, picture.time(frames[-1]) if len(frames) == 1 else 0.0)
    marked = _mark_labels(picture, camera, size)
    tops = [joints[joints[:, 1].argmax()] + [0.0, 0.2, 0.0] for joints in map(picture.joints, frames)]
    heads, _ = camera.project(np.reshape(tops, (-1, 3)), size)
    labels = [Label(picture.told(moment, marked), (x, y)) for moment, (x, y) in zip(shown, heads.tolist(), strict=True)]
    busy = np.zeros((size[1] // COARSE, size[0] // COARSE), dtype=bool)
    for moment in shown:
        busy |= _outline(picture, moment, camera, size)
    for mark in (mark for mark in picture.marks if mark.shape != "line"):
        pixels, scale = camera.project(places(mark, picture.ground, picture.end), size)
        busy |= spots(pixels, mark.radius * scale, size)
    return Panel(shot(stage), [*labels, *marked.values()], busy)


def _mark_labels(picture: Staging, camera: Camera, size: tuple[int, int]) -> dict[str, Label]:
    """A label for each goal that has a mark in the picture, by the goal's name."""
    labels: dict[str, Label] = {}
    for goal in sorted(picture.goals, key=lambda goal: goal.met)[:_NAMED]:
        found = [places(mark, picture.ground, picture.end) for mark in goal.marks]
        middles = [points[len(points) // 2] for points in found if len(points)]
        pixels, _ = camera.project(np.reshape(middles, (-1, 3)), size)
        inside = pixels[((pixels >= 0) & (pixels < size)).all(axis=1)]
        if len(inside):
            colour = INK if goal.report is None else MET if goal.met else MISSED
            text = short(goal.name) if goal.report is None else told(goal.report)
            labels[goal.name] = Label(text, (float(inside[0, 0]), float(inside[0, 1])), colour)
    return labels
