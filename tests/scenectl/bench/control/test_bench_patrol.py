"""A patrol: legs begin where others end, and rows say what became of each."""

from __future__ import annotations

import pytest

from scenectl.bench.control.patrol import bench_patrol
from scenectl.generators.mscot.sampling import MSCoT
from scenes.errors import UserError
from tests.scenectl.small import bundle


def test_legs_go_on_until_the_time_is_up(monkeypatch: pytest.MonkeyPatch) -> None:
    found = bench_patrol(MSCoT(bundle()), "pillars", minutes=0.1, samples=1)
    rows, summary = found["rows"], found["summary"]
    assert len(rows) >= 2 and sum(row["seconds"] for row in rows) == summary["seconds"] > 0.0
    made = [row for row in rows if "refused" not in row]
    assert "gap_m" not in made[0] and len(made) == summary["legs"]
    assert summary["worst_missed_m"] == max(row["missed_m"] for row in made)
    assert 0 <= summary["reached_rate"] <= 1 and all(row["resident_mb"] > 0 for row in made)


def test_a_scene_without_room_is_said() -> None:
    with pytest.raises(UserError):
        bench_patrol(MSCoT(bundle()), "nowhere.glb", minutes=0.1)
