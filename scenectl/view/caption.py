"""Captions: what was asked for, how well each goal is met, and what the verdict says, below a picture."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING, NamedTuple

from objectives import TermReport
from scenectl.measures.believability.verdict import Verdict
from scenectl.view.labels import LONG, MET, MISSED, Colour, cut, font, letters, plain, short
from scenectl.view.stage import INK

if TYPE_CHECKING:
    from PIL.Image import Image
    from PIL.ImageFont import FreeTypeFont

_LEADING, _INDENT = 1.4, 0.8
"""From line to line, and left of all writing, in heights of letters."""
_ROWS = 2
"""Lines at most of each thing that is said."""
_APART = "   "


class Run(NamedTuple):
    """Words of one colour."""

    text: str
    colour: Colour = INK


class Caption:
    """The lines below a picture of a size (pixels), and how high they are together (pixels)."""

    def __init__(
        self, title: str, reports: Sequence[TermReport], verdict: Verdict | None, size: tuple[int, int]
    ) -> None:
        """Lay the lines out."""
        self.letters = letters(size)
        type_, width = font(self.letters), size[0] - 2 * _INDENT * self.letters
        said = [[Run(word) for word in plain(title).split(" ")], list(_judged(reports, verdict))]
        lines = [line for runs in said for line in _rows([run for run in runs if run.text], " ", width, type_)]
        goals = [
            Run(told(report, 2 * LONG), MET if report.met else MISSED)
            for report in sorted(reports, key=lambda r: r.met)
        ]
        self.lines = [*lines, *_rows(goals, _APART, width, type_)]
        self.height = round(_LEADING * self.letters * (len(self.lines) + 0.5)) if self.lines else 0

    def draw(self, image: Image) -> None:
        """Write into the lowest `height` pixels of an image."""
        from PIL import ImageDraw

        draw, type_ = ImageDraw.Draw(image), font(self.letters)
        for k, line in enumerate(self.lines):
            x, y = _INDENT * self.letters, image.size[1] - self.height + _LEADING * self.letters * (k + 0.3)
            for run in line:
                draw.text((x, y), run.text, fill=run.colour, font=type_)
                x += type_.getlength(run.text)


def told(report: TermReport, most: int = LONG) -> str:
    """A goal in a few words: its name in at most so many letters, whether it is met, and by how much."""
    name, unit, worst = short(report.name, most), report.unit, f"{round(report.worst, 3):.3g}"
    if report.when is None:
        return f"{name}: {'met' if report.met else 'missed'}, never active"
    if report.met:
        return f"{name}: met, {worst} {unit}"
    return f"{name}: missed, {worst} of {report.tolerance:g} {unit}"


def _judged(reports: Sequence[TermReport], verdict: Verdict | None) -> Iterator[Run]:
    """How many goals are met, and the verdict, word by word."""
    met = sum(report.met for report in reports)
    if reports:
        yield Run(f"met {met} of {len(reports)}", MET if met == len(reports) else MISSED)
    if verdict is None:
        return
    words = "believable" if verdict.believable else f"not believable: {plain(verdict.sentence)}"
    if reports:
        yield Run("·")
    yield from (Run(word, MET if verdict.believable else MISSED) for word in words.split(" "))


def _rows(runs: Sequence[Run], gap: str, width: float, type_: FreeTypeFont) -> list[list[Run]]:
    """Runs in at most `_ROWS` lines of at most `width` pixels with gaps between them; what is too long is cut."""
    rows: list[list[Run]] = []
    used = 0.0
    for k, run in enumerate(runs):
        full = type_.getlength(gap + run.text)
        if rows and used + full <= width:
            rows[-1].append(Run(gap + run.text, run.colour))
            used += full
        elif len(rows) < _ROWS:
            rows.append([Run(cut(run.text, width, type_), run.colour)])
            used = type_.getlength(rows[-1][0].text)
        else:
            rest = f"{gap}and {len(runs) - k} more" if gap == _APART else "…"
            while used + type_.getlength(rest) > width and rows[-1]:
                last = rows[-1].pop()
                k, used = k - 1, used - type_.getlength(last.text)
                rest = f"{gap}and {len(runs) - k} more" if gap == _APART else "…"
            rows[-1].append(Run(rest))
            break
    return rows
