"""`scenectl edit`: spans of seconds as a user writes them."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from scenes.motion.motion import Motion
from tests.scenectl.small import walk

Run = Callable[..., Any]


@pytest.mark.parametrize(
    ("spans", "word"),
    [
        *((("--regenerate", text), "--regenerate") for text in ("1", "2-1", "a-b", "nan-inf", "7-8")),
        (("--regenerate=-1-2",), "--regenerate"),
        (("--keep", "7-8"), "--keep 7-8 goes beyond the motion"),
        ((), "either"),
        (("--regenerate", "0-1", "--keep", "1-2"), "either"),
    ],
)
def test_spans_that_are_none_are_told(spans: tuple[str, ...], word: str, scenectl: Run, tmp_path: Path) -> None:
    Motion(walk(60)).save(tmp_path / "motion.npz")
    said = scenectl("edit", tmp_path, *spans, "--prompt", "someone sits", "-o", tmp_path / "out")
    assert said.status == 2 and word in said.err and len(said.err.strip().splitlines()) == 1
    assert not (tmp_path / "out").exists()
