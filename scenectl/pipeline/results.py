"""What a run leaves: samples with their figures, a report, and the files that hold them."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np
from torch import Tensor

from objectives import TermReport
from scenectl.data.formats.motions import load_motion
from scenectl.tasks.setup import Setup
from scenes.errors import UserError
from scenes.files import write_json
from scenes.motion.frames import Place, shifted
from scenes.motion.motion import Motion, Pose2D

FORMAT = 1
"""Version of report.json."""


@dataclass(frozen=True)
class Sample:
    """One motion of a result.

    Attributes:
        index: which of the generator's samples it was.
        cost: of the objective.
        terms: how well each goal is met.
        metrics: see `scenectl.measures.metrics.measure`.
        unrefined_cost: of the objective before refinement, or None.
        diagnosis: why goals aren't met, in a sentence (`objectives.diagnosis`); None where they are.
        start: where it begins, which differs from the setup's where that was solved for.
        pose_change: metres by which refinement moved joints as seen from the pelvis, in the mean; None without one.
    """

    index: int
    cost: float
    terms: list[TermReport]
    metrics: dict[str, float | str | None]
    unrefined_cost: float | None = None
    diagnosis: str | None = None
    start: Pose2D | None = None
    pose_change: float | None = None

    @property
    def met(self) -> bool:
        """Every goal is met within its tolerance."""
        return all(term.met for term in self.terms)

    def moved(self, by: Place) -> Sample:
        """The same so much (m) further."""
        terms = [t if t.position is None else replace(t, position=shifted(t.position, by)) for t in self.terms]
        return replace(self, terms=terms, start=None if self.start is None else self.start.moved(by))


@dataclass(frozen=True)
class Result:
    """What a run made, the best sample first.

    Attributes:
        setup: the task as it was planned, in its own frame (`Setup.origin`).
        motion: world coordinates, ``[S, T, J, 3]`` metres.
        samples: a row for each motion, in the same order, in world coordinates.
        report: everything that report.json holds.
        drawer: draws the preview of a result into a file; None where none is wanted.
    """

    setup: Setup
    motion: Motion
    samples: list[Sample]
    report: dict[str, Any] = field(repr=False)
    drawer: Drawer | None = field(default=None, repr=False)

    def save(self, folder: str | Path, preview: bool = True) -> Path:
        """Write `motion.npz`, `report.json` and, where pictures can be drawn, `preview.png`.

        Each file is whole or absent. Returns the folder; raises UserError when it cannot be written.
        """
        folder = Path(folder)
        facts: dict[str, int | str] = {"seed": int(self.report["seed"]), "unit": "m"}
        maker = self.report["generator"]
        if maker is not None:  # the weights' terms follow what they make wherever the file goes
            facts["licence"] = str(maker["licence"])
        self.motion.save(folder / "motion.npz", **facts)
        write_json(self.report, folder / "report.json", allow_nan=False)
        if preview and self.drawer is not None:
            self.drawer(self, folder / "preview.png")
        return folder


Drawer: TypeAlias = Callable[[Result, Path], None]


def load_result(folder: str | Path) -> tuple[Motion, dict[str, Any]]:
    """Motions ``[S, T, J, 3]`` and report of a folder that `run` wrote; raises UserError for anything else."""
    folder = Path(folder)
    motion = load_motion(folder / "motion.npz")
    try:
        report = json.loads((folder / "report.json").read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise UserError(f"'{folder / 'report.json'}' cannot be read ({error}); run the task again") from error
    if not isinstance(report, dict) or report.get("format") != FORMAT or not isinstance(report.get("task"), dict):
        raise UserError(f"'{folder / 'report.json'}' is not a report of this version of scenectl; run the task again")
    return motion, report


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
