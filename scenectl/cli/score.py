"""`scenectl score`, and how it and `scenectl run` print a result."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from scenectl.cli.clock import importing
from scenectl.console.console import bars, out, table
from scenectl.console.options import AllowCode, MotionFile, TaskFile, allow

if TYPE_CHECKING:
    from scenectl.pipeline.results import Result


def score(
    motion: MotionFile,
    task: TaskFile,
    json_file: Annotated[Path | None, typer.Option("--json", help="Write the report to this file.")] = None,
    allow_code: AllowCode = None,
) -> None:
    """Report how well finished motions meet a task."""
    with importing():
        from scenectl.pipeline.run import score as judge
        from scenectl.tasks.task import load_task
        from scenes.files import write_json
        from scenes.motion.motion import Motion

    allow(allow_code)
    loaded = load_task(task)
    joints = Motion.load(motion / "motion.npz" if motion.is_dir() else motion)
    with bars() as progress:
        result = judge(joints, loaded, progress)
    show_samples(result)
    if json_file is not None:
        write_json(result.report, json_file, allow_nan=False)


def show_samples(result: Result) -> None:
    """The samples in a table, the best one's goals in sentences."""
    lines = table("rank", "cost", "goals met", "deepest (mm)", "in the floor (mm)", "skating")
    for rank, row in enumerate(result.samples):
        met = sum(term.met for term in row.terms)
        deep, floor, skating = (
            row.metrics[key] for key in ("deepest_penetration_m", "deepest_floor_penetration_m", "skating_ratio")
        )
        lines.add_row(
            str(rank),
            f"{row.cost:.4g}",
            f"{met} of {len(row.terms)}",
            f"{1000 * float(deep or 0):.0f}",
            f"{1000 * float(floor or 0):.0f}",
            f"{float(skating or 0):.2f}",
        )
    out.print(lines)
    for term in result.samples[0].terms:
        out.print("  " + term.sentence())
    if (why := result.samples[0].diagnosis) is not None:
        out.print("  why: " + why)
