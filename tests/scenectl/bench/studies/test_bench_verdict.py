"""Limits and the verdict both ways, on walks written as formulas and on the shared recordings."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch

from scenectl.bench.studies.absurdities import ABSURDITIES
from scenectl.bench.studies.limits import MEASURED, _quantile, _says, bench_limits, played, write
from scenectl.bench.studies.recordings import on_floor, recordings
from scenectl.bench.studies.verdict import RECORDED, bench_verdict
from scenectl.measures.believability.limits import Limits
from scenectl.measures.metrics import SHALLOW, Scorer
from scenes.motion.motion import Motion
from scenes.world.scene import Scene
from tests.scenectl.small import walk
from tests.scenectl.training.folder import walks, write_folder


def test_limits_are_quantiles_of_sound_recordings(tmp_path: Path) -> None:
    result = bench_limits(walks(tmp_path / "data"))
    rows = {row["check"]: row for row in result["rows"]}
    assert list(rows) == [check.name for check in MEASURED] and result["summary"]["clips"] == 5
    for check in MEASURED:
        row = rows[check.name]
        assert row["quantile"] == pytest.approx(1 - check.share if check.least else check.share)
        assert (row["limit"] <= row["q50"]) if check.least else (row["limit"] >= row["q50"])
    assert 0.9 < rows["speed"]["q50"] < 1.3  # walks of 0.9 to 1.3 m/s
    write(result["stored"], tmp_path / "limits.json")
    limits = Limits.read(tmp_path / "limits.json")
    assert limits.values == pytest.approx({name: row["limit"] for name, row in rows.items()}, rel=1e-3)
    assert len(limits.tempo) == 29 and limits.about["sources"]


def test_many_clips_that_are_alike_do_not_outvote_others(tmp_path: Path) -> None:
    clips = {f"a{i}": (walk(60), {"split": "train", "source": "many"}) for i in range(9)}
    clips["b"] = walk(60), {"split": "train", "source": "few"}
    says = _says(recordings(write_folder(tmp_path, clips), "train"))
    assert says["few"] == pytest.approx(3 * says["many"])  # nine clips say three times as much as one
    draw = np.random.default_rng(0)
    values, counts = draw.normal(size=50), draw.integers(1, 9, size=50)
    for share in (0.002, 0.3, 0.5, 0.98, 1.0):
        expected = np.quantile(np.repeat(values, counts), share, method="inverted_cdf")
        assert _quantile(values, counts / 7, share) == expected


def test_what_lies_climbs_or_is_no_recording_is_left_out(tmp_path: Path) -> None:
    joints = walk(60)
    labels = ("walk", "get up from ground", "climb ladder", "sit on stool", "cartwheel", "crawl", "walk_slope_up")
    folder = write_folder(tmp_path, {label: (joints, {"label": label, "split": "test"}) for label in labels})
    assert [clip.id for clip in recordings(folder, "test")] == ["walk"]
    assert recordings(folder, "train") == []


def test_recordings_stand_on_the_floor(tmp_path: Path) -> None:
    for clip in recordings(walks(tmp_path), "train"):
        depths = Scorer(Scene.empty()).depths(on_floor(clip, 1.0))
        assert depths.floor.max() <= SHALLOW


def test_a_rate_is_played_along_a_spline() -> None:
    motion = Motion(walk(61).double())
    assert played(motion, 2.0).frames == 31
    assert torch.allclose(played(motion, 2.0).joints, motion.joints[::2])
    slow = played(motion, 0.5).joint("pelvis")[:, 2].diff()
    assert np.allclose(slow, 1.2 / 40, atol=1e-6)


def test_both_ways_on_written_walks(tmp_path: Path, scenectl: Callable[..., Any]) -> None:
    file = tmp_path / "verdict.json"
    said = scenectl("bench", "verdict", "--data", walks(tmp_path / "data"), "--motions", 2, "--json", file)
    assert said.status == 0 and "believable" in said.out
    result = json.loads(file.read_text())
    assert {row["made"] for row in result["rows"]} == {RECORDED, *ABSURDITIES}
    assert result["summary"]["motions"] == 2
    assert result["summary"]["5 cm into a wall"]["called"] == 1.0


def test_both_ways_on_recordings(shared: Path) -> None:
    found = bench_verdict(shared / "data" / "motions", 12)["summary"]
    assert found["believable"] >= 10 / 12
    for name in ABSURDITIES:
        assert found[name]["right"] >= 0.8, name
