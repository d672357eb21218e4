"""What the command line prints with: results on standard output, progress and complaints on standard error."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn

if TYPE_CHECKING:
    from scenectl.generators.base import Progress as Tell

# Tables that go into a file or a pipe are not cut off at the 80 columns that rich assumes there.
out = Console(highlight=False, soft_wrap=True, width=None if sys.stdout.isatty() else 160)
err = Console(stderr=True, highlight=False, soft_wrap=True)


def literal(text: str) -> str:
    """Text in which rich shall see no markup."""
    return text.replace("[", "\\[")


@contextmanager
def bars() -> Iterator[Tell]:
    """A progress bar on standard error for each thing that is done, gone at the end."""
    columns = (TextColumn("{task.description:<34}"), BarColumn(bar_width=30), TimeElapsedColumn())
    with Progress(*columns, console=err, transient=True) as bar:
        current: dict[str, Any] = {}

        def tell(what: str, fraction: float) -> None:
            if what not in current:
                for done in current.values():
                    bar.update(done, completed=1.0)
                    bar.stop_task(done)
                current[what] = bar.add_task(what, total=1.0)
            bar.update(current[what], completed=max(0.0, min(1.0, fraction)))

        yield tell
