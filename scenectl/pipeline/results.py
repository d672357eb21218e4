"""What a run leaves: samples with their figures, a report, and the files that hold them."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np
from pydantic import ValidationError
from torch import Tensor

from objectives import TermReport
from scenectl.data.formats.motions import load_motion
from scenectl.measures.believability.judge import Series
from scenectl.measures.believability.verdict import Verdict
from scenectl.pipeline.tables import ReportTable
from scenectl.tasks.setup import Setup
from scenectl.tasks.task import Task
from scenes.errors import UserError
from scenes.files import MOST_BYTES, atomic_write, read_arrays, read_text, replaceable
from scenes.motion.frames import Place, shifted
from scenes.motion.motion import Motion, Pose2D
from scenes.validation import sentence


@dataclass(frozen=True)
class Sample:
    """One motion of a result.

    Attributes:
        index: which of the generator's samples it was.
        cost: of the objective.
        terms: how well each goal is met.
        metrics: see `scenectl.measures.metrics.measure`.
        verdict: whether a person would move like that, and why not.
        unrefined_cost: of the objective before refinement, or None.
        diagnosis: why goals aren't met, in a sentence (`objectives.diagnosis`); None where they are.
        start: where it begins, which differs from the setup's where that was solved for.
        pose_change: metres by which refinement moved joints as seen from the pelvis, in the mean; None without one.
        series: a number for each frame, see `scenectl.measures.believability.judge.Judge.series`.
    """

    index: int
    cost: float
    terms: list[TermReport]
    metrics: dict[str, float | str | None]
    verdict: Verdict
    unrefined_cost: float | None = None
    diagnosis: str | None = None
    start: Pose2D | None = None
    pose_change: float | None = None
    series: Series = field(default_factory=dict, repr=False)

    @property
    def met(self) -> bool:
        """Every goal is met within its tolerance."""
        return all(term.met for term in self.terms)

    @property
    def believable(self) -> bool:
        """A person would move like that: no check of the judge's found fault."""
        return self.verdict.believable

    @property
    def good(self) -> bool:
        """Met and believable."""
        return self.met and self.believable

    def moved(self, by: Place) -> Sample:
        """The same so much (m) further."""
        terms = [t if t.position is None else replace(t, position=shifted(t.position, by)) for t in self.terms]
        return replace(self, terms=terms, start=None if self.start is None else self.start.moved(by))


@dataclass(frozen=True)
class Result:
    """What a run made: samples that are met and believable first, then those that are met, then the rest.

    Attributes:
        setup: the task as it was planned, in its own frame (`Setup.origin`).
        motion: world coordinates, ``[S, T, J, 3]`` metres.
        samples: a row for each motion, in the same order, in world coordinates.
        report: everything that report.json holds.
        drawer: draws the preview of a result into a file; None where none is wanted.
        runner: makes further motions, `scenectl.pipeline.run.run`.
    """

    setup: Setup
    motion: Motion
    samples: list[Sample]
    report: dict[str, Any] = field(repr=False)
    drawer: Drawer | None = field(default=None, repr=False)
    runner: Callable[..., Result] | None = field(default=None, repr=False)

    def then(self, task: Task, **given: Any) -> Result:
        """What a task makes that goes on from the last frame of the first motion, which is its start.

        Args:
            task: of the same body.
            given: further arguments of `scenectl.pipeline.run.run`.

        Raises:
            UserError: the motion has no place to go on from, or ends on a seat, or the task cannot begin there.
        """
        if self.runner is None:
            raise UserError("this result was not made by `run`, which a task could go on with")
        return self.runner(task, after=self.motion[0], **given)

    def save(self, folder: str | Path, preview: bool = True) -> Path:
        """Write `motion.npz`, `report.json` and, where pictures can be drawn, `preview.png`.

        Each file is whole or absent, and none is ever beside another run's: an older report and preview go before the
        new motion comes. Returns the folder; raises UserError when it cannot be written, and leaves what was there.
        """
        folder = Path(folder)
        facts: dict[str, int | str] = {"seed": int(self.report["seed"]), "unit": "m"}
        maker = self.report["generator"]
        if maker is not None:  # the weights' terms follow what they make wherever the file goes
            facts["licence"] = str(maker["licence"])
        report = folder / "report.json"
        with atomic_write(report, "w") as told:  # takes its place after the motion, which is done within
            json.dump(self.report, told, indent=1, allow_nan=False)
            told.flush()
            with atomic_write(folder / "motion.npz") as made:
                self.motion.write(made, **facts)
                made.flush()
                for old in (folder / "preview.png", report):
                    replaceable(old).unlink(missing_ok=True)
        if preview and self.drawer is not None:
            self.drawer(self, folder / "preview.png")
        return folder


Drawer: TypeAlias = Callable[[Result, Path], None]


def load_result(folder: str | Path) -> tuple[Motion, dict[str, Any]]:
    """Motions ``[S, T, J, 3]`` and report of a folder that `run` wrote; raises UserError for anything else.

    Reports of format 1 have None for what they do not know: `believable`, `verdict` and `series` of samples.
    """
    folder = Path(folder)
    motion, report = load_motion(folder / "motion.npz"), _report(folder / "report.json")
    seed = read_arrays(folder / "motion.npz", "motion file", lambda data: int(data["seed"]), "run the task again")
    counts = len(motion.joints) if motion.joints.ndim == 4 else 1, len(report["samples"])
    for what, one, other in (("seed", seed, report["seed"]), ("number of samples", *counts)):
        if one != other:
            raise UserError(
                f"motion.npz and report.json in '{folder}' are of different runs ({what} {one} and {other}); run the "
                "task again"
            )
    return motion, report


def task_of(report: Mapping[str, Any]) -> Task:
    """The task that a report of `load_result` is of, which loads its scene and body."""
    return Task(**report["task"])


def _report(path: Path) -> dict[str, Any]:
    """A report as its schema has it."""
    try:
        text = read_text(path, "report", MOST_BYTES)
        report: dict[str, Any] = json.loads(text)
    except (OSError, ValueError, RecursionError) as error:
        raise UserError(f"'{path}' cannot be read ({error}); run the task again") from error
    try:
        ReportTable.model_validate_json(text)
    except ValidationError as error:
        wrong = sentence(error, report, ReportTable)
        raise UserError(
            f"'{path}' is not a report of this version of scenectl ({wrong}); run the task again"
        ) from error
    for row in report["samples"]:
        row.update({key: row.get(key) for key in ("believable", "verdict", "series")})
    if report["format"] == 1:  # its tasks state all that they avoid, and their walks go on to the end
        report["task"].setdefault("avoid", False)
        if isinstance(walk := report["task"].get("walk"), dict):
            walk.setdefault("stop", False)
    return report


def plain_json(value: Any) -> Any:
    """Plain JSON values; what is not finite becomes None, what JSON does not know becomes text."""
    if isinstance(value, Tensor):
        value = value.detach().cpu().numpy()
    if isinstance(value, np.ndarray | np.generic):
        value = value.tolist()
    if isinstance(value, dict):
        return {str(key): plain_json(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [plain_json(item) for item in value]
    if isinstance(value, float):
        return value if np.isfinite(value) else None
    return value if value is None or isinstance(value, bool | int | str) else str(value)
