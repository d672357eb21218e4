"""What the command line prints with: results on standard output, progress and complaints on standard error."""

from __future__ import annotations

import sys
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

from rich.console import Console
from rich.table import Table
from rich.text import Text

from scenes.errors import visible

if TYPE_CHECKING:
    from objectives.signatures import Parameter
    from scenectl.generators.base import Progress as Tell


class _Plain(Console):
    """Prints text as it is: no markup, no emoji, and control characters as `visible` writes them."""

    def __init__(self, **settings: Any) -> None:
        super().__init__(markup=False, emoji=False, highlight=False, soft_wrap=True, **settings)

    def render_str(self, text: str, **settings: Any) -> Text:
        return super().render_str(visible(text), **{**settings, "markup": False, "emoji": False})


# Tables that go into a file or a pipe are not cut off at the 80 columns that rich assumes there.
out = _Plain(width=None if sys.stdout.isatty() else 160)
err = _Plain(stderr=True)


def titled(title: str, text: str) -> Text:
    """A title in bold, and text behind it."""
    return Text.assemble((visible(title), "bold"), visible(text))


@contextmanager
def bars() -> Iterator[Tell]:
    """A progress bar on standard error for each thing that is done, gone at the end."""
    from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn

    columns = (TextColumn("{task.description:<34}", markup=False), BarColumn(bar_width=30), TimeElapsedColumn())
    with Progress(*columns, console=err, transient=True) as bar:
        current: dict[str, Any] = {}

        def tell(what: str, fraction: float) -> None:
            if what not in current:
                for done in current.values():
                    bar.update(done, completed=1.0)
                    bar.stop_task(done)
                current[what] = bar.add_task(visible(what), total=1.0)
            bar.update(current[what], completed=max(0.0, min(1.0, fraction)))

        yield tell


def say(what: str, done: float) -> None:
    """A line for each thing that is done, where what is done draws a bar of its own."""
    err.print(f"{done:4.0%} {what}")


def doubt(sentences: Iterable[str]) -> None:
    """What may be wrong with the input, a line each, on standard error: results stay as they are."""
    for sentence in sentences:
        err.print(f"scenectl: in doubt: {sentence}")


def complain(sentence: str) -> None:
    """What is wrong with the input, in a line on standard error."""
    err.print("scenectl: " + " ".join(sentence.split()))


def note(sentences: Iterable[str]) -> None:
    """What was decided about the input, a line each, on standard error."""
    for sentence in sentences:
        err.print(f"scenectl: {sentence}")


def table(*headings: str) -> Table:
    """A table without lines."""
    return Table(*headings, box=None, pad_edge=False)


def listed(parameters: Mapping[str, Parameter]) -> Table:
    """What a registered function can be told: a line for each parameter."""
    lines = table("parameter", "type", "default", "meaning")
    for parameter in parameters.values():
        default = "" if parameter.required else repr(parameter.default)
        lines.add_row(parameter.name, parameter.type, default, parameter.doc)
    return lines


def show(result: Mapping[str, Any], columns: Sequence[str] = ()) -> None:
    """Print rows and summary.

    Args:
        result: ``{"rows": [...], "summary": ...}``.
        columns: of the rows, where not all are shown.
    """
    rows = result["rows"]
    if rows:
        shown = [key for key in (columns or rows[0]) if _scalar(rows[0].get(key))]
        lines = table(*shown)
        for row in rows:
            lines.add_row(*(cell(row.get(key)) for key in shown))
        out.print(lines)
    out.print()
    _print_summary(result["summary"], "")


def cell(value: Any) -> str:
    """A value as tables and summaries print it."""
    if isinstance(value, bool):
        return "yes" if value else "no"
    return f"{value:.4g}" if isinstance(value, float) else "" if value is None else str(value)


def _print_summary(summary: Mapping[str, Any], indent: str) -> None:
    for key, value in summary.items():
        if isinstance(value, Mapping):
            out.print(f"{indent}{key}:")
            _print_summary(value, indent + "  ")
        else:
            out.print(f"{indent}{key}: {cell(value)}")


def _scalar(value: Any) -> bool:
    return value is None or isinstance(value, bool | int | float | str)
