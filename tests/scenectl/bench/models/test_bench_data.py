"""The census of training data: it counts what is trained on, and its page shows each kind that was made."""

from __future__ import annotations

from pathlib import Path

import pytest

from scenectl.bench.models.data import SECONDS, bench_data, source_of
from tests.scenectl.training.folder import walks

RECIPE = """
extends = "compact"
[augmentation]
bend = 0
duck = 1.0
composed = 0.0
"""


def test_all_that_is_drawn_is_counted_and_what_is_made_is_drawn(tmp_path: Path) -> None:
    recipe, page = tmp_path / "small.toml", tmp_path / "page"
    recipe.write_text(RECIPE)
    result = bench_data(walks(tmp_path), recipe, page=page)
    rows = {row["kind"]: row for row in result["rows"]}
    for seconds in SECONDS[:2]:
        assert sum(row[f"share_{seconds}s"] for row in rows.values()) == pytest.approx(100, abs=0.1)
    assert rows["duck"]["found_or_made"] == 1 and result["summary"]["clips"] == sum(r["clips"] for r in rows.values())
    text = (page / "data.md").read_text()
    assert "![duck](duck.png)" in text and (page / "duck.png").is_file() and "14_28" in text


@pytest.mark.parametrize(
    ("made", "source"),
    [("16_01~duck-0", "16_01"), ("13_01~stand-up367~stand-up-0", "13_01~stand-up367"), ("composed1~a+b~m", "")],
)
def test_what_a_clip_was_made_of(made: str, source: str) -> None:
    assert source_of(made) == source
