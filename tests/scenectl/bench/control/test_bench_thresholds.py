"""Thresholds one at a time, and prices of steps, on a generator without weights."""

from __future__ import annotations

from dataclasses import fields
from types import ModuleType

import pytest

from scenectl.bench.control.prices import bench_prices
from scenectl.bench.control.thresholds import bench_thresholds
from scenectl.control.thresholds import THRESHOLDS, entries
from scenes.errors import UserError


def test_every_threshold_says_what_it_decides_and_where_it_comes_from() -> None:
    table = entries()
    assert [entry["name"] for entry in table] == [field.name for field in fields(THRESHOLDS)]
    for entry in table:
        assert entry["decides"] and entry["source"] and entry["value"] > 0
        assert isinstance(entry["value"], int) == (type(getattr(THRESHOLDS, entry["name"])) is int)


def test_a_changed_threshold_has_its_row_beside_the_unchanged_table(tiny: ModuleType) -> None:
    found = bench_thresholds(tiny.TinyGenerator(), ("lift", "trials"), (1.0, 0.04))
    rows = found["rows"]
    assert [(row["name"], row["value"]) for row in rows[1:]] == [
        ("lift", 0.03), ("lift", 0.0012), ("trials", 10), ("trials", 1),
    ]  # fmt: skip
    base = rows[0]
    for row in (rows[1], rows[3]):  # a factor of one changes nothing
        assert row["moved_m"] == 0.0 and row["passes"] == base["passes"] and row["met"] == base["met"]
    assert rows[4]["moved_m"] > 0.0 and rows[4]["passes"] != base["passes"]


def test_an_unknown_threshold_is_refused_in_a_sentence(tiny: ModuleType) -> None:
    with pytest.raises(UserError, match=r"unknown threshold 'lft'.*lift"):
        bench_thresholds(tiny.TinyGenerator(), ("lft",))


def test_prices_are_ratios_to_a_pass_of_every_kind_of_step(tiny: ModuleType) -> None:
    rows = bench_prices(tiny.TinyGenerator(), repeats=3)["rows"]
    assert [row["step"] for row in rows] == ["refined", "refined, by autograd", "refined, with its start", "smooth"]
    for row in rows:
        assert row["pass_ms"] > 0 and 0 < row["row_of_48"] < 20 and 0 < row["jvp"] < 50
