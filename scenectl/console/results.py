"""How commands show a result, and the exit status that it earns."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import typer

from scenectl.console.console import doubt, err, out, table
from scenes.errors import UserError

if TYPE_CHECKING:
    from scenectl.export.export import Exported
    from scenectl.pipeline.results import Result, Sample

UNMET = 3
"""Exit status where no sample is both met and believable."""
_TOLD = 8
"""Samples at most of which it is said why they are not both."""


def show_samples(result: Result, of_file: bool = False) -> None:
    """The samples in a table, in a line each what is wrong with them, and the best one's goals in sentences.

    They are called by their rank, which is their place in the file that is written; with `of_file`, where none is, by
    their place in the file that was read.
    """
    names = [row.index if of_file else rank for rank, row in enumerate(result.samples)]
    lines = table(
        "rank", *["sample"] * of_file, "met", "believable", "cost", "deepest (mm)", "in the floor (mm)", "skating"
    )
    for rank, row in enumerate(result.samples):
        deep, floor, skating = (
            row.metrics[key] for key in ("deepest_penetration_m", "deepest_floor_penetration_m", "skating_ratio")
        )
        lines.add_row(
            str(rank),
            *[str(row.index)] * of_file,
            _met(row),
            "yes" if row.believable else "no",
            f"{row.cost:.4g}",
            f"{1000 * float(deep or 0):.0f}",
            f"{1000 * float(floor or 0):.0f}",
            f"{float(skating or 0):.2f}",
        )
    out.print(lines)
    wrong = [(name, row) for name, row in zip(names, result.samples, strict=True) if not row.good]
    for name, row in wrong[:_TOLD]:
        out.print(f"sample {name} is {_wrong(row)}")
    if len(wrong) > _TOLD:
        out.print(f"and {len(wrong) - _TOLD} more, of which report.json tells")
    best = result.samples[0]
    if best.terms or best.verdict.exempted:
        out.print(f"the goals of sample {names[0]}:")
    for said in (*(term.sentence() for term in best.terms), *best.verdict.exempted):
        out.print("  " + said)


def _met(row: Sample) -> str:
    count = sum(term.met for term in row.terms)
    return f"{count} of {len(row.terms)}" if row.terms else "no goals"


def _wrong(row: Sample) -> str:
    """What is wrong with a sample that is not both, in a line."""
    said = [] if row.met else [f"not met: {row.diagnosis}"]
    return "; ".join(said if row.believable else [*said, f"not believable: {row.verdict.sentence}"])


def drawn(result: Result, png: Path) -> bool:
    """Draw the preview; where that fails, say why in a sentence: the motion is worth having without it."""
    from scenectl.api import draw

    try:
        draw(result, png)
    except (UserError, OSError, MemoryError) as error:
        why = str(error).removeprefix(f"cannot write '{png}': ") or "there is not enough memory"
        err.print(f"scenectl: no {png.name}, because {why}")
        return False
    return True


def leave(result: Result, allow_unmet: bool) -> None:
    """End the command: with 3 where no sample is both met and believable, unless that is allowed."""
    if not result.samples[0].good and not allow_unmet:
        err.print("scenectl: no sample is both met and believable: exit status 3, or 0 with --allow-unmet")
        raise typer.Exit(UNMET)


def show_exported(done: Exported) -> None:
    """The files of an export, and by how much joints moved where bones were not rigid."""
    per_file = len(done.animations) // len(done.files)
    for place, file in enumerate(done.files):
        held = done.animations[place * per_file : (place + 1) * per_file]
        several = f"{len(held)} motions, " if len(held) > 1 else ""
        frames = " and ".join(f"{count}" for count in sorted({animation.frames for animation in held}))
        out.print(f"wrote {file}: {several}{frames} frames at {held[0].fps:g} a second")
    if done.moved:
        out.print(f"joints moved by {1000 * done.moved:.1f} mm at most, so that bones keep their lengths")
    doubt(done.doubts)
