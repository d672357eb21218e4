"""What threads cost while a motion is generated: one or many, spinning or asleep, on a quiet machine and a busy one."""

from __future__ import annotations

import json
import os
import selectors
import statistics
import subprocess
import sys
import time
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from scenectl.bench.engine import ENGINE, Engine, Result, Row
from scenectl.bench.process import environment, python
from scenectl.bench.scenes.query import machine
from scenectl.generators.base import Progress
from scenectl.tasks.task import load_task
from scenes.errors import UserError

SETTLE = 0.5
"""Seconds in which busy processes get going before anything is timed."""
LOADING = 120.0
"""Seconds within which a process must have loaded its generator."""
SETTINGS: dict[str, tuple[int | None, str | None]] = {
    "one thread": (1, None),
    "all threads, as torch comes": (None, None),
    "all threads, asleep while they wait": (None, "PASSIVE"),
}
"""Threads (None: as many as torch takes) and OMP_WAIT_POLICY of each row."""


def bench_threads(
    task: str | Path,
    samples: int | None = None,
    repeats: int = 5,
    limit: float | int = 60.0,
    settings: Sequence[str] = tuple(SETTINGS),
    engine: Engine = ENGINE,
) -> Result:
    """Generate the same motions with each setting in turn, alone and beside a busy process on every core.

    Each setting has a process of its own, in which the generator is loaded once.

    Args:
        task: a task file.
        samples: motions, instead of the task's own.
        repeats: of each; the median counts.
        limit: seconds after which a generation is given up; no more of its kind are tried.
        settings: of `SETTINGS`, the first of which the others' quiet seconds are divided by.
        engine: tells progress, keeps rows and goes on from them.

    Returns:
        ``{"summary", "rows"}``, a row for each setting: median seconds to generate and refine, quiet and busy, and
        their ratio. Raises UserError for a task that cannot be run.
    """
    load_task(task)  # what is wrong with it is told here
    return engine.run(
        [("threads", settings)],
        lambda names: _measured(task, samples, repeats, limit, names, engine.progress),
        lambda rows: {**machine(), "limit_s": limit, **_summary(rows)},
        {"bench": "threads", "task": task, "samples": samples, "repeats": repeats, "limit": limit, "names": settings},
    )


def _measured(
    task: str | Path, samples: int | None, repeats: int, limit: float | int, settings: Sequence[str], progress: Progress
) -> list[Row]:
    """A row for each setting; they take turns."""
    cores = len(os.sched_getaffinity(0))
    quiet, busy = "on a quiet machine", f"beside {cores} busy processes"
    with ExitStack() as stack:
        workers = {name: stack.enter_context(_worker(task, samples, *SETTINGS[name])) for name in settings}
        for name, worker in workers.items():
            progress(f"loading for {name}", 0.0)
            worker.generate(LOADING)  # the first, which also fills caches, does not count
        alone = _rounds(workers, repeats, limit, lambda done: progress(quiet, done))
        with _busy(cores):
            beside = _rounds(workers, repeats, limit, lambda done: progress(busy, done))
        return [
            {
                "setting": name,
                "threads": worker.threads,
                "quiet_s": _median(alone[name]),
                "busy_s": _median(beside[name]),
                "busy_over_quiet": _ratio(beside[name], alone[name]),
                "quiet_over_first": _ratio(alone[name], alone[settings[0]]),
                "given_up": worker.given_up,
            }
            for name, worker in workers.items()
        ]


@dataclass
class _Worker:
    """A process that generates when it is told to; `given_up` once it has taken longer than its limit."""

    process: subprocess.Popen[str]
    threads: int = 0
    given_up: bool = False
    selector: selectors.DefaultSelector = field(default_factory=selectors.DefaultSelector)

    def generate(self, limit: float | int) -> float | None:
        """Seconds of one generation; the limit where it was given up, None where it had been before."""
        assert self.process.stdin is not None and self.process.stdout is not None
        if self.given_up:
            return None
        self.process.stdin.write("go\n")
        self.process.stdin.flush()
        if not self.selector.select(limit):
            self.given_up = True
            self.process.kill()
            return float(limit)
        line = self.process.stdout.readline()
        if not line.startswith("{"):
            self.process.wait()
            complaint = self.process.stderr.read() if self.process.stderr is not None else ""
            raise UserError(f"the generation failed: {(complaint.strip().splitlines() or ['killed'])[-1]}")
        said = json.loads(line)
        self.threads = said["threads"]
        return float(said["seconds"])


@contextmanager
def _worker(task: str | Path, samples: int | None, threads: int | None, wait: str | None) -> Iterator[_Worker]:
    """A process for one setting; it ends with the block."""
    plain = {key: value for key, value in environment().items() if not key.startswith(("OMP_", "GOMP_", "MKL_"))}
    code = "from scenectl.bench.studies.threads import work; work()"
    process = subprocess.Popen(
        python("-c", code, str(task), json.dumps(samples), json.dumps(threads)),
        env=plain if wait is None else {**plain, "OMP_WAIT_POLICY": wait},
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    worker = _Worker(process)
    worker.selector.register(process.stdout, selectors.EVENT_READ)  # type: ignore[arg-type]
    try:
        yield worker
    finally:
        process.kill()
        process.wait()
        worker.selector.close()


def work() -> None:
    """What each process does: load once, then generate at every line of standard input and answer with the seconds."""
    import torch

    from scenectl.pipeline.run import load_task_generator, run
    from scenectl.threads import threads

    task, samples, number = load_task(sys.argv[1]), json.loads(sys.argv[2]), json.loads(sys.argv[3])
    setup, generator = task.build(), load_task_generator(task)
    with threads(number or torch.get_num_threads()) as used:
        for _ in sys.stdin:
            result = run(task, samples, generator=generator, setup=setup)
            print(json.dumps({"seconds": result.report["timing"]["generate_s"], "threads": used}), flush=True)


@contextmanager
def _busy(count: int) -> Iterator[None]:
    """So many processes that only compute."""
    children = [subprocess.Popen(python("-S", "-c", "while True: pass")) for _ in range(count)]
    time.sleep(SETTLE)
    try:
        yield
    finally:
        for child in children:
            child.kill()
            child.wait()


def _rounds(workers: dict[str, _Worker], repeats: int, limit: float | int, tell: Any) -> dict[str, list[float]]:
    """Seconds of every worker, in turn."""
    times: dict[str, list[float]] = {name: [] for name in workers}
    for done in range(repeats):
        tell(done / repeats)
        for name, worker in workers.items():
            if (seconds := worker.generate(limit)) is not None:
                times[name].append(seconds)
    return times


def _median(times: list[float]) -> float | None:
    return statistics.median(times) if times else None


def _ratio(times: list[float], others: list[float]) -> float | None:
    return statistics.median(times) / statistics.median(others) if times and others else None


def _summary(rows: Sequence[Row]) -> dict[str, Any]:
    return {row["setting"]: {key: row[key] for key in ("quiet_s", "busy_s", "busy_over_quiet")} for row in rows}
