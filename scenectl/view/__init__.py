"""Pictures of scenes and results, and a window to turn them around. pyvista is loaded only when one is drawn."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from scenectl.view.picture import Picture
from scenectl.view.window import open_window
from scenes.motion.frames import origin_near
from scenes.world.scene import Scene

if TYPE_CHECKING:
    from scenectl.pipeline.results import Result

__all__ = ["Picture", "draw_result", "draw_scene", "of_folder", "of_result", "of_scene", "open_window"]


def of_scene(scene: Scene) -> Picture:
    """A scene alone."""
    return Picture(scene if scene.middle is None else scene.seen_from(origin_near(scene.middle)))


def of_result(result: Result, sample: int = 0) -> Picture:
    """One motion of a result in its scene; 0 is the best."""
    setup, row = result.setup, result.report["samples"][sample]
    motion = result.motion[sample].seen_from(setup.origin)
    return _judged(Picture(setup.scene, motion, setup.path, setup.objective, setup.task.prompt, setup.body), row)


def of_folder(folder: str | Path, sample: int = 0) -> Picture:
    """One motion of a folder that `scenectl run` wrote; raises UserError for another folder or a missing sample."""
    from objectives import Objective
    from scenectl.pipeline.results import load_result
    from scenectl.tasks.setup import start_of
    from scenectl.tasks.task import Task
    from scenes.errors import UserError

    motion, report = load_result(folder)
    count = motion.joints.shape[0] if motion.joints.ndim == 4 else 1
    if sample >= count:
        raise UserError(f"'{folder}' holds {count} motions; --sample goes from 0 to {count - 1}")
    one = motion[sample] if motion.joints.ndim == 4 else motion
    task = Task(**report["task"])
    walk, scene = report.get("walk"), task.load_scene()
    origin = task.origin(scene, start_of(one, task.load_body()))
    task, one, scene = task.seen_from(origin), one.seen_from(origin), scene.seen_from(origin)
    path = None if walk is None else np.array(walk["path"]) - origin
    terms = () if task.walk is None or path is None else task.walk.terms(path, float(report["seconds"]), motion.fps)
    goals = Objective((*terms, *task.terms))
    return _judged(Picture(scene, one, path, goals, task.prompt, task.load_body()), report["samples"][sample])


def _judged(picture: Picture, row: Mapping[str, Any]) -> Picture:
    """A picture with what a row of a report says of its motion; reports of before the verdict have none."""
    from objectives import TermReport
    from scenectl.measures.believability.verdict import Finding, Verdict

    said = row.get("verdict")
    verdict = None if said is None else Verdict(tuple(Finding(**finding) for finding in said["findings"]))
    reports = [TermReport.from_dict(term) for term in row["terms"]]
    return replace(picture, reports=reports, verdict=verdict)


def draw_result(result: Result, png: str | Path) -> None:
    """The best motion of a result as a PNG file."""
    of_result(result).draw(png)


def draw_scene(scene: Scene, png: str | Path, show_slice: bool = False, show_signs: bool = False) -> None:
    """A scene as a PNG file."""
    of_scene(scene).draw(png, show_slice=show_slice, show_signs=show_signs)
