"""The process: what its streams lead to, how it is interrupted, and what it says of warnings."""

from __future__ import annotations

import errno
import os
import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import pytest

PLAIN = {key: value for key, value in os.environ.items() if key not in ("PYTHONIOENCODING", "PYTHONUTF8")}
ENTRY = "from scenectl.cli.app import entry; entry()"
CALL = [sys.executable, "-c", ENTRY]


def said(*words: object, shell: str = "", **settings: Any) -> subprocess.CompletedProcess[str]:
    """A command, or one with its streams led elsewhere by a shell."""
    call = [*CALL, *map(str, words)]
    if shell:
        call = ["bash", "-c", f'set -o pipefail; "$@" {shell}', "bash", *call]
    return subprocess.run(call, capture_output=True, text=True, timeout=120, check=False, **{"env": PLAIN, **settings})


@pytest.mark.parametrize("words", [("goals",), ("--help",), ("goals", "joint_target"), ("--version",)])
def test_a_reader_that_leaves_changes_nothing(words: tuple[str, ...]) -> None:
    for shell in ("| true", "2>&1 | true"):
        done = said(*words, shell=shell)
        assert (done.returncode, done.stderr) == (0, "")


def test_a_reader_that_leaves_does_not_hide_what_is_wrong(tmp_path: Path) -> None:
    done = said("check", tmp_path / "nope.toml", shell="| true")
    assert done.returncode == 2 and "does not exist" in done.stderr


def test_closed_streams_are_no_fault(tmp_path: Path) -> None:
    for shell in (">&-", "2>&-", ">&- 2>&-", "<&- >&- 2>&-"):
        done = said("goals", shell=shell)
        assert done.returncode == 0 and done.stderr == "", shell
    out = tmp_path / "body.json"
    done = said("bake", "doorway", "--resolution", 16, "-o", out.with_suffix(".npz"), shell=">&-")
    assert done.returncode == 0 and out.with_suffix(".npz").read_bytes()[:2] == b"PK"  # no line went into it


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="needs a device that is always full")
def test_a_full_disk_behind_standard_output_is_named() -> None:
    done = said("goals", shell="> /dev/full")
    assert done.returncode == 2
    assert done.stderr == f"scenectl: cannot use 'standard output': {os.strerror(errno.ENOSPC)}\n"
    assert said("goals", shell="2> /dev/full").returncode == 0


def test_streams_that_lack_a_character_show_its_escape(tmp_path: Path) -> None:
    name = "caf\u00e9 \u4eba.toml"
    (tmp_path / name).write_text('prompt = "x"\nseconds = 2.0\n')
    done = said("check", tmp_path / name, env={**PLAIN, "PYTHONIOENCODING": "ascii"})
    assert done.returncode == 0 and "caf\\xe9 \\u4eba.toml: fine" in done.stdout
    done = said("check", tmp_path / f"no {name}", env={**PLAIN, "PYTHONIOENCODING": "ascii"})
    assert done.returncode == 2 and "caf\\xe9" in done.stderr and len(done.stderr.splitlines()) == 1


def interrupted(after: float, *words: object) -> tuple[int, str]:
    """Exit status and complaint of a command that gets Ctrl-C so many seconds after its first line."""
    # As a terminal starts it: a shell that starts something behind its back lets it ignore interrupts.
    code = (
        "import os, signal; signal.signal(signal.SIGINT, signal.default_int_handler); "
        "from scenectl.cli import app; main = app.main; "
        "app.main = lambda: (os.write(2, b'begun\\n'), main()); app.entry()"  # a buffer could be written twice
    )
    process = subprocess.Popen(
        [sys.executable, "-c", code, *map(str, words)], stderr=subprocess.PIPE, stdout=subprocess.DEVNULL, text=True
    )
    assert process.stderr is not None
    assert process.stderr.readline() == "begun\n"
    time.sleep(after)
    process.send_signal(signal.SIGINT)
    return process.wait(60), process.stderr.read()


@pytest.mark.parametrize("after", [0.0, 0.1, 0.3, 0.7, 1.5])
def test_an_interrupt_is_one_line_whenever_it_comes(after: float, tmp_path: Path) -> None:
    (tmp_path / "task.toml").write_text('prompt = "x"\nseconds = 9.0\nsamples = 200\n')
    status, text = interrupted(after, "run", tmp_path / "task.toml", "-o", tmp_path / "out")
    assert status == 130 and text.split("\n")[-2] == "scenectl: interrupted"
    assert "Traceback" not in text and "Error" not in text and len(text.split()) <= 8
    assert not list(tmp_path.rglob("*.tmp"))


BARE = "try:\n  raise_()\nexcept: pass"
CALLBACK = "import weakref\nclass C:\n  pass\nc = C()\nr = weakref.ref(c, lambda _: raise_())\ndel c"


@pytest.mark.parametrize("how", [BARE, CALLBACK])
def test_an_interrupt_that_a_library_would_swallow_ends_the_process(how: str, tmp_path: Path) -> None:
    (tmp_path / "swallows.py").write_text(
        f"import os, signal\nraise_ = lambda: os.kill(os.getpid(), signal.SIGINT)\n{how}"
    )
    code = (  # what is started behind a shell's back ignores interrupts
        "import signal, sys; signal.signal(signal.SIGINT, signal.default_int_handler); "
        f"from scenectl.cli import interrupts; interrupts.watch(); sys.path[:0] = [{str(tmp_path)!r}]; "
    )
    done = subprocess.run(
        [sys.executable, "-c", code + "import swallows; print('went on')"], capture_output=True, text=True, check=False
    )
    assert (done.returncode, done.stdout, done.stderr) == (130, "", "scenectl: interrupted\n")


def test_where_interrupts_are_ignored_they_stay_so() -> None:
    code = (
        "import os, signal; signal.signal(signal.SIGINT, signal.SIG_IGN); from scenectl.cli import interrupts; "
        "interrupts.watch(); os.kill(os.getpid(), signal.SIGINT); print('goes on')"
    )
    assert (
        subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout == "goes on\n"
    )


def test_a_cache_that_cannot_be_is_one_sentence() -> None:
    done = said("bake", "doorway", "--resolution", 16, env={**PLAIN, "SCENECTL_CACHE": "~nouser/x"})
    assert done.returncode == 2 and done.stderr == (
        "scenectl: SCENECTL_CACHE is '~nouser/x': there is no such user; name a folder\n"
    )
    done = said("bake", "doorway", "--resolution", 16, env={**PLAIN, "SCENECTL_CACHE": "/dev/null/x"})
    lines = [line for line in done.stderr.splitlines() if "in doubt" not in line]
    assert done.returncode == 0 and len(lines) == 1
    assert lines[0].startswith("scenectl: the bake could not be cached: cannot write '/dev/null/x/bakes/")


def test_warnings_of_libraries_are_for_their_authors() -> None:
    code = (
        "import warnings; from scenectl.console import streams; streams.prepare();"
        "warnings.warn('overflow', RuntimeWarning); warnings.warn('old', DeprecationWarning);"
        "from scenes.errors import Remark; warnings.warn('slow [/b]', Remark)"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stderr == "scenectl: slow [/b]\n"
    done = subprocess.run([sys.executable, "-Walways", "-c", code], capture_output=True, text=True, check=True)
    assert "overflow" in done.stderr
