"""The engine: order, progress, going on after a kill, shards, and several generators."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import pytest

from scenectl.bench.engine import Engine, Row, compared
from scenes.errors import UserError
from tests.scenectl.tiny import TinyGenerator

CASES = [(f"case {number}", number) for number in range(5)]


def total(rows: Sequence[Row]) -> dict[str, Any]:
    return {"sum": sum(row["square"] for row in rows)}


class Squares:
    """Measures squares, and is killed at one of them."""

    def __init__(self, killed_at: int | None = None) -> None:
        self.killed_at, self.measured = killed_at, list[int]()

    def __call__(self, number: int) -> list[Row]:
        if number == self.killed_at:
            raise KeyboardInterrupt
        self.measured.append(number)
        return [{"number": number, "square": number**2}]


def test_rows_are_in_the_order_of_the_cases_and_summarised() -> None:
    told: list[tuple[str, float]] = []
    result = Engine(lambda what, done: told.append((what, done))).run(CASES, Squares(), total, {})
    assert [row["number"] for row in result["rows"]] == [0, 1, 2, 3, 4]
    assert result["summary"] == {"sum": 30} and "left" not in result
    assert told == [(f"case {i}", i / 5) for i in range(5)]


def test_cases_may_be_made_one_by_one() -> None:
    squares, made = Squares(), list[int]()

    def cases():  # type: ignore[no-untyped-def]
        for name, number in CASES:
            assert len(squares.measured) == number  # those before it are measured already
            made.append(number)
            yield name, number

    Engine().run(cases(), squares, total, {}, total=5)
    assert made == squares.measured == [0, 1, 2, 3, 4]


def test_what_was_killed_goes_on(tmp_path: Path) -> None:
    engine = Engine(file=tmp_path / "found.json")
    with pytest.raises(KeyboardInterrupt):
        engine.run(CASES, Squares(killed_at=3), total, {"seed": 0})
    lines = tmp_path / "found.json.rows"
    lines.write_text(lines.read_text() + '["cut sh')  # the line that the kill fell into
    rest = Squares()
    result = engine.run(CASES, rest, total, {"seed": 0})
    assert rest.measured == [3, 4] and result == Engine().run(CASES, Squares(), total, {"seed": 0})
    again = Squares()
    engine.run(CASES, again, total, {"seed": 0})
    assert again.measured == []  # also those behind the line cut short
    engine.write(result)
    assert json.loads((tmp_path / "found.json").read_text()) == result and not lines.exists()


@pytest.mark.parametrize(
    "changed",
    [({"seed": 1}, {"weights": "a"}), ({"seed": 0}, {"weights": "b"}), ({"seed": 0, "more": 1}, {"weights": "a"})],
)
def test_rows_of_other_settings_are_not_taken(tmp_path: Path, changed: tuple[dict, dict]) -> None:
    Engine(file=tmp_path / "f.json", about={"weights": "a"}).run(CASES, Squares(), total, {"seed": 0})
    settings, about = changed
    anew = Squares()
    Engine(file=tmp_path / "f.json", about=about).run(CASES, anew, total, settings)
    assert anew.measured == [0, 1, 2, 3, 4]


def test_shards_share_the_cases_and_a_last_run_summarises(tmp_path: Path) -> None:
    file, parts = tmp_path / "f.json", (Squares(), Squares())
    first = Engine(file=file, shard=(0, 2))
    result = first.run(CASES, parts[0], total, {})
    assert result["summary"] == {"cases_left": 2} and [row["number"] for row in result["rows"]] == [0, 2, 4]
    first.write(result)
    second = Engine(file=file, shard=(1, 2)).run(CASES, parts[1], total, {})
    assert (parts[0].measured, parts[1].measured) == ([0, 2, 4], [1, 3]) and second["summary"] == {"sum": 30}
    last = Squares()
    whole = Engine(file=file)
    whole.write(whole.run(CASES, last, total, {}))
    assert last.measured == [] and json.loads(file.read_text()) == second
    assert not file.with_name("f.json.rows").exists()


@pytest.mark.parametrize(("shard", "said"), [((2, 2), "shard 2 of 2"), ((-1, 2), "shard -1"), ((0, 2), "--json")])
def test_shards_that_cannot_be_are_refused(shard: tuple[int, int], said: str) -> None:
    with pytest.raises(UserError, match=said):
        Engine(shard=shard)


def test_one_generator_is_flat_and_several_are_named(tmp_path: Path) -> None:
    def bench(generator: TinyGenerator, engine: Engine) -> dict[str, Any]:
        found = engine.run(CASES[:2], Squares(), total, {})
        return {**found, "licence": generator.licence}

    alone = compared(Engine(), {"tiny": TinyGenerator}, bench)
    assert alone["summary"] == {"sum": 1} and "generator" not in alone["rows"][0]
    both = compared(Engine(file=tmp_path / "f.json"), {"a": TinyGenerator, "b": TinyGenerator}, bench)
    assert both["summary"] == {"a": {"sum": 1}, "b": {"sum": 1}} and both["licence"]["b"] == "CC0-1.0"
    assert [(row["generator"], row["number"]) for row in both["rows"]] == [("a", 0), ("a", 1), ("b", 0), ("b", 1)]
    assert len(set((tmp_path / "f.json.rows").read_text().split())) > 4  # kept by generator
