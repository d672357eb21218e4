"""Python processes that benches start: they run the code of this one, and nothing from the working directory."""

from __future__ import annotations

import os
import sys
from collections.abc import Mapping
from pathlib import Path

_ROOT = str(Path(__file__).resolve().parents[2])


def python(*words: str) -> list[str]:
    """The command that starts one; without -P, a file called numpy.py in the working directory would be numpy."""
    return [sys.executable, "-P", *words]


def environment(given: Mapping[str, str] = os.environ) -> dict[str, str]:
    """Its environment: this one's, in which the packages are found where this process has them, installed or not."""
    paths = [
        *filter(None, given.get("PYTHONPATH", "").split(os.pathsep)),
        _ROOT,
    ]  # an empty one is the working directory
    return {**given, "PYTHONPATH": os.pathsep.join(paths), "PYTHONSAFEPATH": "1"}
