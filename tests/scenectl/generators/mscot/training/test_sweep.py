"""Sweeps: every variant trains apart, what is done is not done again, and the table holds what was measured."""

from __future__ import annotations

import json
from functools import partial
from pathlib import Path

import pytest

from scenectl.generators.mscot.training.stages import TRAINING, MSCoTRecipe
from scenectl.training import sweep as module
from scenectl.training.recipe import Variant, load_recipe
from scenectl.training.sweep import shortened, write_table
from scenes.errors import UserError
from tests.scenectl.generators.mscot.training.test_train import TINY
from tests.scenectl.training.folder import walks

train_sweep = partial(module.train_sweep, plan=TRAINING)
SWEEP = """
[[sweep]]
name = "plain"
[[sweep]]
name = "own-codes"
set = { "model.tokenizer.shared_codebook" = false }
"""


def test_variants_are_trained_measured_and_kept(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    data, config = walks(tmp_path / "data"), tmp_path / "sweep.toml"
    config.write_text(TINY + SWEEP)
    said: list[str] = []
    rows = train_sweep(data, config, tmp_path / "out", 6, tell=lambda what, done: said.append(what))
    assert said == ["plain", "own-codes"] == [row["variant"] for row in rows]
    assert all(row["iterations"] == 6 and 0 < row["codes_used"] <= 1 and row["error_all_m"] > 0 for row in rows)
    assert all(row["iterations_per_second"] > 0 and row["frames_per_second"] > 0 for row in rows)
    assert rows[0]["parameters_m"] == rows[1]["parameters_m"]  # codes are no parameters: they follow averages
    kept = json.loads((tmp_path / "out" / "sweep.json").read_text())
    assert kept["rows"] == rows
    table = (tmp_path / "out" / "sweep.md").read_text().splitlines()
    assert [line.split(" | ")[0] for line in table[4:]] == ["| plain", "| own-codes"]

    def no_training(*args: object, **kwargs: object) -> None:
        raise AssertionError("trained again")

    monkeypatch.setattr(module.Run, "train", no_training)
    assert train_sweep(data, config, tmp_path / "out", 6) == rows
    with pytest.raises(AssertionError):  # another length is another model
        train_sweep(data, config, tmp_path / "out", 7)


def test_a_recipe_without_variants_says_so(tmp_path: Path) -> None:
    with pytest.raises(UserError, match="--config sweep"):
        train_sweep(tmp_path, "compact", tmp_path / "out", 10)


def test_the_bundled_sweep_changes_one_thing_at_a_time() -> None:
    recipe = load_recipe("sweep", MSCoTRecipe)
    plain = recipe.model_dump(exclude={"sweep"})
    seen = set()
    for variant in recipe.sweep:
        changed = recipe.varied(variant.set).model_dump(exclude={"sweep"})
        assert (changed == plain) is (variant.name == "compact") and len(variant.set) <= 1
        seen.add(variant.name)
    assert len(seen) == len(recipe.sweep)


def test_shortened_recipes_still_quantise(tmp_path: Path) -> None:
    for iterations in (4, 100, 5000):
        recipe = shortened(TRAINING, load_recipe("compact", MSCoTRecipe), iterations)
        for part in (recipe.tokenizer, recipe.refiner, recipe.transformer):
            assert part.loop.iterations == iterations and part.loop.warmup <= max(1, iterations // 10)
        assert recipe.tokenizer.continuous <= iterations // 4


def test_tables_leave_gaps_where_rows_say_nothing(tmp_path: Path) -> None:
    write_table([{"a": 1.23456, "b": "x"}, {"a": 2, "c": None, "d": {"e": 1}}], tmp_path / "t", "T")
    assert (tmp_path / "t.md").read_text().splitlines() == [
        "# T", "", "| a | b | c |", "|---|---|---|", "| 1.235 | x |  |", "| 2 |  |  |",
    ]  # fmt: skip


def test_names_of_variants_are_names_of_folders() -> None:
    with pytest.raises(ValueError, match="pattern"):
        Variant(name="../elsewhere")
