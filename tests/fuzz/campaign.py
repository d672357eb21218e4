"""Campaigns: inputs by seed, read in processes that are limited and watched, and what went wrong with them."""

from __future__ import annotations

import io
import json
import logging
import os
import resource
import shutil
import signal
import subprocess
import sys
import tempfile
import traceback
import warnings
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, redirect_stderr
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[2]
SECONDS = 20
"""An input that is read for longer hangs."""
GIGABYTES = 3.0
"""Memory that no input may need, torch and all included."""
LONGEST = 1200
"""Letters of a sentence: values in it are cut at 80, and names of files are as long as they are."""


@dataclass(frozen=True)
class Finding:
    """An input that was answered neither with success nor with one sentence.

    Attributes:
        seed: decides the input; ``python -m tests.fuzz --seed SEED`` reads it again.
        target: its kind.
        fault: "crash", "hang", "memory", "noise", "sentence", or the exception's name.
        where: the line of our code that it came from, or what was said.
        folder: a copy of the input.
    """

    seed: int
    target: str
    fault: str
    where: str
    folder: str = ""


class Hang(BaseException):
    """Raised by the alarm, past everything that catches exceptions."""


@contextmanager
def alarm(seconds: int) -> Iterator[None]:
    def ring(*_: Any) -> None:
        raise Hang

    before = signal.signal(signal.SIGALRM, ring)
    signal.alarm(seconds)
    try:
        yield
    finally:
        signal.alarm(0)
        signal.signal(signal.SIGALRM, before)


def attempt(seed: int, folder: Path) -> tuple[str, str, str]:
    """Write the input of a seed into a folder and read it: kind of file, fault ("" for none) and where."""
    from scenes.errors import UserError
    from tests.fuzz.targets import chosen

    target, rng = chosen(seed)
    path = target.write(rng, folder)
    said, log = io.StringIO(), logging.StreamHandler(io.StringIO())
    logging.getLogger().addHandler(log)
    try:
        with warnings.catch_warnings(record=True) as heard, redirect_stderr(said), alarm(SECONDS):
            warnings.simplefilter("always")
            target.read(path)
    except UserError as error:
        text = " ".join(str(error).split())  # as the command line prints it
        if "validation error" in text or "Traceback" in text or not 10 < len(text) < LONGEST:
            return target.name, "sentence", text[:300]
    except Hang as error:
        return target.name, "hang", _line(error)
    except MemoryError as error:
        return target.name, "memory", _line(error)
    except BaseException as error:
        return target.name, type(error).__name__, f"{_line(error)}: {error}"[:300]
    finally:
        logging.getLogger().removeHandler(log)
    noise = [
        str(w.message) for w in heard if not issubclass(w.category, DeprecationWarning | PendingDeprecationWarning)
    ]
    noise += [said.getvalue(), log.stream.getvalue()]
    if loud := [text for text in noise if text.strip()]:
        return target.name, "noise", loud[0].strip().splitlines()[-1][:300]
    return target.name, "", ""


def _line(error: BaseException) -> str:
    """The innermost line of our own code."""
    frames = [
        f for f in traceback.extract_tb(error.__traceback__) if str(ROOT) in f.filename and "/fuzz/" not in f.filename
    ]
    frames = frames or traceback.extract_tb(error.__traceback__)[-1:]
    return f"{frames[-1].filename.removeprefix(f'{ROOT}/')}:{frames[-1].lineno}"


def work(seeds: Sequence[int]) -> None:
    """What a process does: one line of JSON before each input and one after it."""
    import torch

    torch.set_num_threads(1)
    resource.setrlimit(resource.RLIMIT_DATA, (int(2 * GIGABYTES * 2**30),) * 2)
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    out = os.fdopen(os.dup(1), "w")
    os.dup2(2, 1)
    for seed in seeds:
        print(json.dumps({"begun": seed}), file=out, flush=True)
        with tempfile.TemporaryDirectory() as folder:
            target, fault, where = attempt(seed, Path(folder))
        memory = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 2**20
        if not fault and memory > GIGABYTES:
            fault, where = "memory", f"{memory:.1f} GB"
        print(json.dumps({"done": seed, "target": target, "fault": fault, "where": where}), file=out, flush=True)
        if memory > GIGABYTES:
            return  # what it holds would be counted against all that follow


def campaign(seeds: range, workers: int = 2, keep: Path | None = None, tell: bool = False) -> list[Finding]:
    """Read the inputs of all seeds in several processes; what went wrong, in order of the seeds.

    Args:
        seeds: decide the inputs.
        workers: processes.
        keep: folder for copies of inputs that went wrong, each in one named after its seed.
        tell: print findings as they come.
    """
    from concurrent.futures import ThreadPoolExecutor

    shares = [range(seeds.start + k, seeds.stop, workers) for k in range(workers)]
    with ThreadPoolExecutor(workers) as pool:
        found = [finding for part in pool.map(lambda share: watched(share, tell), shares) for finding in part]
    return [_kept(finding, keep) for finding in sorted(found, key=lambda f: f.seed)]


def watched(seeds: range, tell: bool = False) -> list[Finding]:
    """Findings among some seeds, in one process after another: each goes on where the one before it ended."""
    found: list[Finding] = []
    at = seeds.start
    while at < seeds.stop:
        left = range(at, seeds.stop, seeds.step)
        process = started(f"from tests.fuzz.campaign import work; work({left!r})")
        begun, done = at, at - seeds.step
        for line in _lines(process):
            told = json.loads(line)
            begun = told.get("begun", begun)
            if "done" in told:
                done = told["done"]
                if told["fault"]:
                    found.append(Finding(done, told["target"], told["fault"], told["where"]))
                    if tell:
                        print(json.dumps(asdict(found[-1])), flush=True)
        status = process.wait()
        at = done + seeds.step
        if begun > done:  # it ended within an input
            fault = "hang" if status == -signal.SIGKILL else "crash"
            found.append(Finding(begun, "?", fault, f"exit status {status}"))
            if tell:
                print(json.dumps(asdict(found[-1])), flush=True)
            at = begun + seeds.step
    return found


def started(code: str) -> subprocess.Popen[str]:
    """A process that runs some code and tells of it on its standard output."""
    quiet = {"stdout": subprocess.PIPE, "stderr": subprocess.DEVNULL, "text": True}
    return subprocess.Popen([sys.executable, "-c", code], cwd=ROOT, **quiet)  # type: ignore[call-overload]


def _lines(process: subprocess.Popen[str]) -> Iterator[str]:
    """What a process writes, until it ends or writes nothing for three times the longest that an input may take."""
    import selectors

    assert process.stdout is not None
    with selectors.DefaultSelector() as ready:
        ready.register(process.stdout, selectors.EVENT_READ)
        while True:
            if not ready.select(timeout=3 * SECONDS):
                process.kill()
                return
            if not (line := process.stdout.readline()):
                return
            yield line


def _kept(finding: Finding, keep: Path | None) -> Finding:
    """The finding with a copy of its input in a folder named after its seed."""
    if keep is None:
        return finding
    from tests.fuzz.targets import chosen

    folder = keep / str(finding.seed)
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir(parents=True)
    target, rng = chosen(finding.seed)
    target.write(rng, folder)
    whole = Finding(finding.seed, target.name, finding.fault, finding.where, str(folder))
    (folder / "finding.json").write_text(json.dumps(asdict(whole), indent=1))
    return whole
