"""The ProgMoGen prompt file: the published one as the protocol describes it, and one sentence for a broken one."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from scenectl.bench.control.progmogen_prompts import load_progmogen
from scenes.errors import UserError


def test_published_prompts_are_as_the_protocol_says(shared: Path) -> None:
    prompts = load_progmogen(shared / "data" / "progmogen.json")
    assert (len(prompts.hsi1), len(prompts.n32), len(prompts.hoi1)) == (544, 32, 32)
    lengths = np.array([row.length for row in prompts.hsi1])
    assert lengths.min() == 36 and lengths.max() == 196 and abs(lengths.mean() - 139.6) < 0.05
    assert (lengths % 4 == 0).all() and len({row.caption for row in prompts.hsi1}) == 544
    heights = np.array([row.head_heights_m for row in prompts.hsi1])
    assert np.allclose(heights.mean(0), [1.527, 1.473, 1.500], atol=1e-3)
    assert abs(heights.min() - 0.087) < 1e-3 and abs(heights.max() - 2.470) < 1e-3
    assert prompts.n32[0].caption == "a person is jogging on the spot." and prompts.n32[0].length == 72
    assert [prompts.n32[i].length for i in (11, 12, 26, 31)] == [52, 140, 140, 196]
    assert prompts.n32[12].caption == prompts.n32[26].caption
    assert prompts.n32[0].seconds == 3.6
    assert prompts.hoi1[0].left_wrist_end_m == (1.0, 0.5, 0.2)


def test_a_folder_stands_for_the_file_in_it(shared: Path) -> None:
    assert load_progmogen(shared / "data") == load_progmogen(shared / "data" / "progmogen.json")


@pytest.mark.parametrize(
    ("content", "reason"),
    [
        ("{", "not readable JSON"),
        ("[]", r"should be a table, not \[\]"),
        (json.dumps({"hsi1": [], "n32": []}), "'hsi1' is .*at least 1"),
        (
            json.dumps({"hsi1": [{"caption": "a", "length": 40, "head_heights_m": [1, 2]}], "n32": []}),
            r"'hsi1 1\.head_heights_m'.*missing",
        ),
        (
            json.dumps({"hsi1": [{"caption": "a", "length": 400, "head_heights_m": [1, 2, 1]}]}),
            r"'hsi1 1\.length' is 400",
        ),
        (json.dumps({"n32": [{"caption": "", "length": 40}]}), r"'n32 1\.caption' is ''"),
        (json.dumps({"n32": [{"caption": "a", "length": 40}]}), "'hsi1' is missing"),
    ],
)
def test_broken_files_get_one_sentence(content: str, reason: str, tmp_path: Path) -> None:
    (tmp_path / "p.json").write_text(content)
    with pytest.raises(UserError, match=reason) as caught:
        load_progmogen(tmp_path / "p.json")
    assert "p.json" in str(caught.value) and "\n" not in str(caught.value)


def test_missing_file(tmp_path: Path) -> None:
    with pytest.raises(UserError, match="does not exist"):
        load_progmogen(tmp_path / "p.json")
