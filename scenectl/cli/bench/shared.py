"""Benches of generators: one after the other, on the threads that the user asks for."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

from scenectl.cli.console import bars, err, literal
from scenectl.threads import threads

Bench = Callable[[Any, Any], Mapping[str, Any]]
"""``(generator, progress) -> {"rows", "summary"}``."""


def measured(
    bench: Bench, weights: str | Path, number: int | None, names: Sequence[str] | str | None = None
) -> Mapping[str, Any]:
    """Run a bench with each generator named.

    Args:
        bench: called with a generator and with what is told about progress.
        weights: of each generator.
        number: of CPU threads.
        names: of generators; the default one where there is none.

    Returns:
        With one generator what the bench returns; with several its rows with a column `generator`, and its summaries
        by name.
    """
    names = (names,) if isinstance(names, str) else names or ("mscot",)
    with threads(number), bars() as tell:
        found = {name: bench(loaded(name, weights), tell) for name in names}
    if len(found) == 1:
        return found.popitem()[1]
    rows = [{"generator": name, **row} for name, result in found.items() for row in result["rows"]]
    return {"summary": {name: result["summary"] for name, result in found.items()}, "rows": rows}


def loaded(name: str, weights: str | Path) -> Any:
    """A generator; whose terms its results are under is told."""
    from scenectl.generators import load_generator

    generator = load_generator(name, weights)
    err.print(literal(f"weights '{weights}': {generator.licence}"))
    return generator
