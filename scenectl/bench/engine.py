"""What runs every bench: cases are measured one after the other, and what their rows have in common is summarised.

A bench is three functions: one yields cases, one measures a case as rows, one summarises all rows. `Engine.run` calls
them, tells how far it is, keeps the rows of every case as soon as they are there, and goes on from those after a kill.
`compared` runs one bench with several generators.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, TypeAlias, TypeVar

from scenectl.generators.base import Generator, Progress, silent
from scenectl.version import __version__
from scenes.errors import UserError
from scenes.files import atomic_write, sweep, writing

Row: TypeAlias = dict[str, Any]
Result: TypeAlias = dict[str, Any]
"""``{"summary": ..., "rows": [...]}``, ready for JSON; and "left", the number of cases that other shards measure."""

Case = TypeVar("Case")


@dataclass(frozen=True)
class Engine:
    """How benches are run, whatever they measure.

    Attributes:
        progress: called with a case's name and the fraction done.
        file: JSON of the result. Rows are kept in ``FILE.rows`` beside it, a line for each case, until all are there;
            a bench that was killed goes on from them. None keeps nothing.
        shard: ``(i, n)``: of n processes that share the cases and `file` this one measures every n-th, from the i-th
            on (from 0). A run without shards after them finds all rows measured, and summarises.
        about: what rows depend on besides the settings of their bench, such as weights.
    """

    progress: Progress = silent
    file: Path | None = None
    shard: tuple[int, int] = (0, 1)
    about: Mapping[str, Any] = field(default_factory=dict)

    def __post_init__(self) -> None:
        if not 0 <= self.shard[0] < self.shard[1]:
            raise UserError(f"shard {self.shard[0]} of {self.shard[1]}: count shards from 0")
        if self.shard[1] > 1 and self.file is None:
            raise UserError("shards share the rows that are kept beside a JSON file; name one with --json")

    def run(
        self,
        cases: Iterable[tuple[str, Case]],
        measure: Callable[[Case], Sequence[Row]],
        summarise: Callable[[Sequence[Row]], Mapping[str, Any]],
        settings: Mapping[str, Any],
        total: int | None = None,
    ) -> Result:
        """Measure all cases, or this shard's.

        Args:
            cases: each with a name that is told.
            measure: rows of a case, ready for JSON.
            summarise: the summary of all rows, which are in the order of the cases.
            settings: what decides the cases and their rows: rows that are kept are taken again only where these are
                the same.
            total: number of cases, where they are made one by one; by default they are all made first.
        """
        if self.file is not None:
            sweep(self.file.parent)
        if total is None:
            cases = list(cases)
            total = len(cases)
        keys, known = list[str](), self._kept()
        for number, (name, case) in enumerate(cases):
            keys.append(_digest(number, name, settings, self.about))
            if keys[-1] not in known and number % self.shard[1] == self.shard[0]:
                self.progress(name, number / total)
                known[keys[-1]] = list(measure(case))
                self._keep(keys[-1], known[keys[-1]])
        known = self._kept() | known  # what other shards have measured meanwhile
        rows = [row for key in keys for row in known.get(key, ())]
        if left := sum(key not in known for key in keys):
            return {"summary": {"cases_left": left}, "rows": rows, "left": left}
        return {"summary": dict(summarise(rows)), "rows": rows}

    def write(self, result: Result) -> None:
        """Write the JSON file, whole or not at all, and `close`."""
        if self.file is not None:
            with atomic_write(self.file, "w") as file:
                json.dump(result, file, indent=1)
        self.close()

    def close(self) -> None:
        """Remove the rows beside the file, unless shards share them."""
        if self.file is not None and self.shard == (0, 1):
            self._rows.unlink(missing_ok=True)

    @property
    def whole(self) -> Engine:
        """The same without shards, for a bench within a case of another."""
        return replace(self, shard=(0, 1))

    @property
    def _rows(self) -> Path:
        assert self.file is not None
        return self.file.with_name(f"{self.file.name}.rows")

    def _kept(self) -> dict[str, list[Row]]:
        """Rows of the cases that were measured before, by digest; a line that a kill cut short counts as none."""
        if self.file is None or not self._rows.is_file():
            return {}
        found = {}
        for line in self._rows.read_text(encoding="utf-8").splitlines():
            try:
                key, rows = json.loads(line)
            except ValueError:
                continue
            found[key] = rows
        return found

    def _keep(self, key: str, rows: list[Row]) -> None:
        if self.file is not None:
            with writing(self._rows):
                self._rows.parent.mkdir(parents=True, exist_ok=True)
                with self._rows.open("a", encoding="utf-8") as file:
                    file.write("\n" + json.dumps([key, rows]) + "\n")  # its own line, also behind one cut short


ENGINE = Engine()
"""Measures everything, silently, and keeps nothing."""


def _digest(*parts: object) -> str:
    text = json.dumps([__version__, *parts], sort_keys=True, default=str)
    return hashlib.sha256(text.encode()).hexdigest()


def compared(
    engine: Engine,
    generators: Mapping[str, Callable[[], Generator]],
    bench: Callable[[Generator, Engine], Result],
) -> Result:
    """Run a bench with every generator.

    Args:
        engine: that runs it.
        generators: by name, loaded when their turn comes.
        bench: runs with one of them.

    Returns:
        With one generator the bench's result; with several its rows with a column `generator`, and all else by name.
    """
    found = {
        name: bench(load(), replace(engine, about={**engine.about, "generator": name}))
        for name, load in generators.items()
    }
    if len(found) == 1:
        return found.popitem()[1]
    rows = [{"generator": name, **row} for name, result in found.items() for row in result["rows"]]
    others = dict.fromkeys(key for result in found.values() for key in result if key != "rows")
    return {
        **{key: {name: result[key] for name, result in found.items() if key in result} for key in others},
        "rows": rows,
    }
