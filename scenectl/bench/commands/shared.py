"""What benchmarks share: the engine that runs them, generators by name, tables of what was measured."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from scenectl.console.console import bars, err, out, show, table
from scenectl.console.options import GENERATOR
from scenectl.threads import threads
from scenes.errors import UserError

if TYPE_CHECKING:
    from scenectl.bench.engine import Engine, Result

Bench = Callable[[Any, Any], dict[str, Any]]
"""``(generator, engine) -> {"rows", "summary"}``."""


def measured(
    bench: Bench,
    weights: str | Path,
    number: int | None,
    names: Sequence[str] | str | None = None,
    json_file: Path | None = None,
    shard: str | None = None,
) -> Result:
    """Run a bench with each generator named, and keep what it finds.

    Args:
        bench: called with a generator and an engine.
        weights: of each generator.
        number: of CPU threads.
        names: of generators; the default one where there is none.
        json_file: where to keep the result, if anywhere.
        shard: "I/N", where N processes share the cases.
    """
    from scenectl.bench.engine import compared

    names = (names,) if isinstance(names, str) else names or (GENERATOR,)
    with threads(number) as used, bars() as tell:
        engine = engine_of(tell, json_file, shard, weights=_stamp(weights), threads=used)
        result = compared(engine, {name: partial(loaded, name, weights) for name in names}, bench)
        engine.write(result)
    return result


def alone(bench: Callable[[Engine], Result], json_file: Path | None, progress: Any = None) -> Result:
    """Run a bench that needs no generator, and keep what it finds."""
    with bars() as tell:
        engine = engine_of(progress or tell, json_file)
        result = bench(engine)
        engine.write(result)
    return result


def example(task: Path) -> Path:
    """A task file that a bench takes by default; raises UserError, which says where it is, where it is not here."""
    if not task.exists():
        raise UserError(f"task file '{task}' does not exist; name another, or run this in a checkout of scenectl")
    return task


def _stamp(weights: str | Path) -> list[Any]:
    """What tells weights of one name apart: rows that a bench kept are of no use once a folder was trained anew."""
    files = sorted(Path(weights).glob("*")) if Path(weights).is_dir() else []
    return [str(weights), *((file.name, file.stat().st_size, int(file.stat().st_mtime)) for file in files)]


def engine_of(tell: Any, json_file: Path | None = None, shard: str | None = None, **about: Any) -> Engine:
    """An engine that tells progress; raises UserError for a shard that is not "I/N"."""
    from scenectl.bench.engine import Engine

    try:
        i, n = map(int, (shard or "0/1").split("/"))
    except ValueError as error:
        raise UserError(f"--shard is '{shard}'; give I/N, such as 0/4 for the first of four") from error
    return Engine(tell, json_file, (i, n), about)


def shown(result: Mapping[str, Any], json_file: Path | None, columns: Sequence[str] = ()) -> None:
    """Print rows, with the generator's name where there are several, and summary; say where they were written."""
    several = result["rows"] and "generator" in result["rows"][0]
    show(result, columns=("generator", *columns) if several and columns else columns)
    wrote(json_file)


def criteria_shown(result: Mapping[str, Any]) -> None:
    """Print what is wanted of each figure beside what was measured; by generator where there are several."""
    from scenectl.bench.models.criteria import HEADS, lines

    criteria = result.get("criteria", [])
    for name, rows in criteria.items() if isinstance(criteria, dict) else [("", criteria)]:
        grid = table(*((name, *HEADS[1:]) if name else HEADS))
        for line in lines(rows):
            grid.add_row(*line)
        out.print(grid)


def wrote(path: Path | None) -> None:
    """Say where something was written, if anywhere."""
    if path is not None:
        out.print(f"wrote {path}")


def loaded(name: str, weights: str | Path) -> Any:
    """A generator; the licence of its weights is printed."""
    from scenectl.generators import load_generator

    generator = load_generator(name, weights)
    err.print(f"weights '{weights}': {generator.licence}")
    return generator
