"""Speeds of feet that stand and swing are told apart."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import torch

from scenectl.bench.studies.plants import EDGES, bench_plants
from scenectl.retarget.plants import STILL, plants
from scenes.motion.motion import Motion
from tests.scenectl.retarget.walk import walk


def test_the_valley_of_recorded_walks_holds_the_limit(shared: Path) -> None:
    result = bench_plants(shared / "data" / "motions")
    rows = result["rows"]
    assert len(rows) == len(EDGES) - 1
    near = next(row for row in rows if row["from_m_s"] <= STILL < row["to_m_s"])
    peaks = [max(row["balls_percent"] for row in rows if low(row)) for low in (
        lambda row: row["to_m_s"] < 0.1, lambda row: row["from_m_s"] > 1.0)]  # fmt: skip
    assert near["balls_percent"] < 0.5 * min(peaks)


def test_a_foot_that_stands_is_found_where_it_stands() -> None:
    motion = Motion(torch.from_numpy(walk(3.0).joints))
    for plant in plants(motion):
        path = motion.joint(plant.joint)[plant.begin : plant.end].numpy()
        assert np.linalg.norm(path - plant.place, axis=-1).max() < 0.03
    assert {plant.joint for plant in plants(motion)} == {"left_ankle", "right_ankle", "left_foot", "right_foot"}
