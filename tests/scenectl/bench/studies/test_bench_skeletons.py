"""Hips and collars of recorded people: told as they stand, and nothing moved where they stand as ours do."""

from __future__ import annotations

from pathlib import Path

import pytest

from scenectl.bench.studies.skeletons import bench_skeletons
from tests.scenectl.training.folder import walks


def test_people_on_our_bones_are_not_moved(tmp_path: Path) -> None:
    result = bench_skeletons(walks(tmp_path))
    assert result["summary"]["our_hip_deg"] == pytest.approx(55.1, abs=0.1)
    assert result["summary"]["our_collar_deg"] == pytest.approx(30.0)
    assert sum(row["clips"] for row in result["rows"]) == result["summary"]["clips"] > 0
    for row in result["rows"]:
        assert row["hip_deg"] == pytest.approx(55.1, abs=0.5) and row["collar_deg"] == pytest.approx(30.0, abs=0.5)
        assert row["hip_within_clip_deg"] < 0.5 and row["limb_ends_moved_m"] < 1e-3
