"""`scenectl bench robots`: a row for each motion, and what none of them exceeds."""

from __future__ import annotations

from pathlib import Path

from scenectl.bench.engine import Engine
from scenectl.bench.studies.robots import bench_robots
from scenectl.retarget.robots.robot import Robot
from tests.scenectl.retarget.robots.humanoids import dancing, mjcf, person, saved, walking


def test_rows_and_summary_say_how_near_a_robot_comes(tmp_path: Path) -> None:
    robot = Robot(saved(tmp_path, mjcf(person())))
    walking(1.0).save(tmp_path / "walk.npz")
    dancing(0, 20).save(tmp_path / "dance.npz")
    files = [tmp_path / "walk.npz", tmp_path / "dance.npz"]
    result = bench_robots(robot, None, files=files, engine=Engine(file=tmp_path / "out.json"))
    rows, summary = result["rows"], result["summary"]
    assert [row["name"] for row in rows] == [str(path) for path in files] and summary["motions"] == 2
    assert all(row["wrist_m"] < 0.01 and row["ankle_m"] < 0.01 and row["slide_m"] < 0.02 for row in rows)
    assert summary["beyond_ranges"] == summary["beyond_speeds"] == 0
    assert summary["largest_wrist_m"] == max(row["wrist_m"] for row in rows) and rows[0]["seconds"] > 0
    assert bench_robots(robot, None)["summary"] == {"motions": 0}
