"""What memory a process holds that makes one motion after the other: it ought to stay where it is."""

from __future__ import annotations

import gc
import os
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

from scenectl.bench.engine import ENGINE, Engine, Result, Row
from scenectl.measures.metrics import Scorer
from scenectl.pipeline.run import load_task_generator, run
from scenectl.tasks.task import load_task
from scenes.errors import UserError

STATM = Path("/proc/self/statm")
SECONDS = tuple(2.0 + 0.1 * (37 * step % 61) for step in range(61))
"""Lengths of motions in turn, 2 to 8 s in an order that mixes them: libraries keep what they compile for each shape."""


def bench_memory(task: str | Path, generations: int = 1000, engine: Engine = ENGINE) -> Result:
    """Run a task of one scene again and again, a sample of another seed and another length each time.

    Args:
        task: a task file; its length and number of samples are not used.
        generations: runs, at least 10.
        engine: tells progress. Rows that it keeps are of a process that is gone, so that none are kept.

    Returns:
        ``{"summary", "rows"}``: MB (10^6 bytes) resident after each tenth of the runs, and by how much it grew from
        the first tenth to the last. Raises UserError for a task that cannot be run, and where the system does not
        tell.
    """
    if not STATM.exists():
        raise UserError(f"'{STATM}' does not exist: memory is measured on Linux")
    if generations < 10:
        raise UserError(f"generations is {generations}; give 10 or more")
    rows = list(_measured(task, generations, engine))
    return {"summary": _summary(rows), "rows": rows}


def _measured(path: str | Path, generations: int, engine: Engine) -> Iterator[Row]:
    task = load_task(path)
    generator = load_task_generator(task)
    base = task.build(task.seed, spec=generator.spec)
    scorer = Scorer(base.scene, base.body)
    for number in range(generations):
        engine.progress(f"run {number + 1}", number / generations)
        made = task.model_copy(update={"seconds": SECONDS[number % len(SECONDS)]})
        seed = task.seed + number
        setup = made.build(seed, spec=generator.spec)
        run(made, 1, seed, generator=generator, setup=setup, scorer=scorer)
        if (number + 1) * 10 // generations > number * 10 // generations:
            gc.collect()
            yield {"runs": number + 1, "resident_mb": resident()}


def resident() -> float:
    """Memory of this process that is in use, MB (10^6 bytes)."""
    return int(STATM.read_text(encoding="ascii").split()[1]) * os.sysconf("SC_PAGE_SIZE") / 1e6


def _summary(rows: Sequence[Row]) -> dict[str, Any]:
    first, last = rows[0], rows[-1]
    return {"runs": last["runs"], "grew_mb": last["resident_mb"] - first["resident_mb"]} | {
        f"after_{row['runs']}_mb": row["resident_mb"] for row in rows
    }
