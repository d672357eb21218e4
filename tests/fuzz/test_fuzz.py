"""Files that are broken in every way we know are read or refused in a sentence; the fuzzer sees what goes wrong."""

from __future__ import annotations

import logging
import math
import sys
import time
import tomllib
import warnings
from collections.abc import Callable
from pathlib import Path
from random import Random
from typing import Any

import pytest
from hypothesis import given, settings, strategies as st

from scenes.errors import UserError
from tests.fuzz import campaign, mutations, targets


def test_two_thousand_broken_files_are_read_or_refused_in_a_sentence(tmp_path: Path) -> None:
    found = campaign.campaign(range(2000), workers=2, keep=tmp_path)
    assert not found, "python -m tests.fuzz --seed …, of:\n" + "\n".join(map(str, found))


def raises(error: BaseException) -> Callable[[Path], object]:
    def read(path: Path) -> None:
        raise error

    return read


READS: dict[str, tuple[Callable[[Path], object], str]] = {
    "success": (lambda path: None, ""),
    "a sentence": (raises(UserError("file 'x' is broken; mend it")), ""),
    "a passage": (raises(UserError("2 validation errors for Scene\nx\n  Input should be a number")), "sentence"),
    "an echo": (raises(UserError("file 'x' is not " + "9" * 5000)), "sentence"),
    "a traceback": (lambda path: 1 / 0, "ZeroDivisionError"),
    "an exit": (raises(SystemExit(0)), "SystemExit"),
    "no memory": (raises(MemoryError()), "memory"),
    "a warning": (lambda path: warnings.warn("overflow", RuntimeWarning, stacklevel=1), "noise"),
    "a log": (lambda path: logging.getLogger("trimesh").error("Traceback"), "noise"),
    "a print": (lambda path: print("Traceback", file=sys.stderr), "noise"),
    "no end": (lambda path: time.sleep(60), "hang"),
}  # fmt: skip


@pytest.mark.parametrize("kind", READS)
def test_the_fuzzer_tells_a_sentence_from_everything_else(
    kind: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    read, fault = READS[kind]
    target = targets.Target(kind, lambda rng, folder: folder, read)
    monkeypatch.setattr(targets, "chosen", lambda seed: (target, Random(seed)))
    monkeypatch.setattr(campaign, "SECONDS", 1)
    assert campaign.attempt(0, tmp_path)[:2] == (kind, fault)


def test_a_process_that_dies_is_a_finding_and_the_campaign_goes_on(monkeypatch: pytest.MonkeyPatch) -> None:
    script = """
import json, os, sys
for seed in SEEDS:
    print(json.dumps({"begun": seed}), flush=True)
    if seed == 2:
        os.abort()
    print(json.dumps({"done": seed, "target": "x", "fault": "noise" if seed == 3 else "", "where": ""}), flush=True)
"""
    start = campaign.started
    monkeypatch.setattr(campaign, "started", lambda code: start(script.replace("SEEDS", code.partition("; work")[2])))
    found = campaign.watched(range(5))
    assert [(f.seed, f.fault) for f in found] == [(2, "crash"), (3, "noise")]


@pytest.mark.parametrize("target", targets.TARGETS, ids=lambda target: target.name)
def test_a_seed_decides_its_input(target: targets.Target, tmp_path: Path) -> None:
    def tree(name: str) -> dict[str, bytes]:
        (tmp_path / name).mkdir()
        target.write(Random(7), tmp_path / name)
        return {path.name: path.read_bytes() for path in (tmp_path / name).iterdir() if path.is_file()}

    assert tree("a") == tree("b")


NUMBERS = st.one_of(st.booleans(), st.integers(), st.floats(), st.text(st.characters(codec="utf-8")))
TABLES = st.recursive(NUMBERS, lambda inner: st.lists(inner) | st.dictionaries(st.text(), inner), max_leaves=20)


@settings(max_examples=30)
@given(table=st.dictionaries(st.text(st.characters(codec="utf-8")), TABLES))
def test_tables_are_written_as_toml_that_reads_back(table: dict[str, Any]) -> None:
    def same(a: Any, b: Any) -> bool:
        if isinstance(a, float) and math.isnan(a):
            return isinstance(b, float) and math.isnan(b)
        if isinstance(a, dict):
            return a.keys() == b.keys() and all(same(a[key], b[key]) for key in a)
        if isinstance(a, list):
            return len(a) == len(b) and all(map(same, a, b))
        return type(a) is type(b) and a == b

    assert same(table, tomllib.loads(mutations.toml(table)))
