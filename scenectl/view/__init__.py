"""Pictures of scenes and results, and a window to turn them around. pyvista is loaded only when one is drawn."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from scenectl.view.moments import Shown
from scenectl.view.picture import Picture
from scenectl.view.window import open_window
from scenes.body.body import DEFAULT_BODY
from scenes.motion.frames import origin_near
from scenes.motion.motion import Motion
from scenes.world.scene import Scene

if TYPE_CHECKING:
    from scenectl.pipeline.results import Result
    from scenectl.tasks.setup import Setup

__all__ = ["Picture", "draw_result", "draw_scene", "of_folder", "of_motion", "of_result", "of_scene", "open_window"]


def of_scene(scene: Scene) -> Picture:
    """A scene alone."""
    return Picture(scene if scene.middle is None else scene.seen_from(origin_near(scene.middle)))


def of_result(result: Result, sample: int = 0) -> Picture:
    """One motion of a result in its scene; 0 is the best."""
    setup, row = result.setup, result.report["samples"][sample]
    return _judged(of_setup(setup, result.motion[sample]), row)


def of_setup(setup: Setup, motion: Motion) -> Picture:
    """One motion ``[T, J, 3]``, in the world, of a task that is built."""
    seen = motion.seen_from(setup.origin)
    acts = () if setup.script is None else setup.script.stretches
    return Picture(
        setup.scene_of(seen), seen, setup.path, setup.objective, str(setup.prompts), setup.body,
        acts=[Shown(f"{one.entry.number} {one.entry.name}", one.begin, one.end) for one in acts],
    )  # fmt: skip


def of_motion(motion: Motion, title: str = "") -> Picture:
    """One motion ``[T, J, 3]`` on an empty floor, at the height of its lowest foot."""
    motion = motion.seen_from(origin_near(motion.joint("pelvis")[0].tolist()))
    floor = float(motion.joints[motion.valid][..., 1].min()) - DEFAULT_BODY.sole_offset
    return Picture(Scene.empty(floor), motion, title=title)


def of_folder(folder: str | Path, sample: int = 0) -> Picture:
    """One motion of a folder that `scenectl run` wrote; raises UserError for another folder or a missing sample."""
    from objectives import Objective
    from scenectl.data.formats.motions import one_of
    from scenectl.pipeline.results import load_result, task_of
    from scenectl.tasks.held import with_held
    from scenectl.tasks.setup import start_of
    from scenectl.tasks.walk import walk_terms

    motion, report = load_result(folder)
    one = one_of(motion, sample, folder)
    task = task_of(report)
    planned, scene = report.get("walk"), task.load_scene()
    body = task.load_body()
    origin = task.origin(scene, start_of(one, body))
    if task.actions:  # planned again from where it began, which takes no generator
        return _judged(of_setup(task.build(start=start_of(one, body), scene=scene), one), report["samples"][sample])
    task, one, scene = task.seen_from(origin), one.seen_from(origin), scene.seen_from(origin)
    path = None if planned is None else np.array(planned["path"]) - origin
    seconds, walk = float(report["seconds"]), task.walk
    terms = () if walk is None or path is None else walk_terms(walk, path, seconds, motion.fps, task.terms, body)
    goals = Objective((*terms, *task.terms, *task.avoided))
    scene = with_held(scene, goals.counted, one)
    return _judged(Picture(scene, one, path, goals, str(task.prompts), body), report["samples"][sample])


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
