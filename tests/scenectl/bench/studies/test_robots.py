"""`scenectl bench robots`: a row for each motion, and what none of them exceeds."""

from __future__ import annotations

from pathlib import Path

import pytest
import trimesh

from scenectl.bench.engine import Engine
from scenectl.bench.studies.robots import Walks, bench_robots
from scenectl.retarget.robots.robot import Robot
from scenectl.retarget.robots.targets import Body
from tests.scenectl.retarget.robots.humanoids import dancing, mjcf, person, saved, walking
from tests.scenectl.tiny import TinyGenerator


def test_rows_and_summary_say_how_near_a_robot_comes(tmp_path: Path) -> None:
    robot = Robot(saved(tmp_path, mjcf(person())))
    walking(1.0).save(tmp_path / "walk.npz")
    dancing(0, 20).save(tmp_path / "dance.npz")
    files = [tmp_path / "walk.npz", tmp_path / "dance.npz"]
    result = bench_robots(robot, None, files=files, engine=Engine(file=tmp_path / "out.json"))
    rows, summary = result["rows"], result["summary"]["recorded"]
    assert [row["name"] for row in rows] == [str(path) for path in files] and summary["motions"] == 2
    assert all(row["wrist_m"] < 0.01 and row["ankle_m"] < 0.01 and row["slide_m"] < 0.02 for row in rows)
    assert summary["beyond_limits"] == 0 and all(row["speed"] <= 1 and row["beyond"] < 0 for row in rows)
    assert summary["largest_wrist_m"] == max(row["wrist_m"] for row in rows) and rows[0]["seconds"] > 0
    assert bench_robots(robot, None)["summary"] == {}


def test_walks_in_scans_are_made_at_the_size_of_the_robot_and_stay_out_of_them(tmp_path: Path) -> None:
    walls = trimesh.creation.box(bounds=[[0, 0, 0], [5, 2.6, 4]])
    walls.invert()
    walls.export(tmp_path / "room.ply")
    robot = Robot(saved(tmp_path, mjcf(person(0.8))))
    walks = Walks(TinyGenerator(), [tmp_path / "room.ply"], count=2)
    for _, (_, _, task) in walks.cases(robot):
        assert Body(robot.points, task.load_body().skeleton).legs == pytest.approx(1)
    result = bench_robots(robot, None, walks=walks, pictures=tmp_path)
    rows, summary = result["rows"], result["summary"]["walk"]
    assert [row["name"] for row in rows] == ["room 0", "room 1"] and summary["motions"] == 2
    assert summary["largest_scene_m"] == max(row["scene_m"] for row in rows) < 0.02
    assert (tmp_path / "room_0.png").is_file() and (tmp_path / "room_1.png").is_file()
    assert summary["targets_per_minute"] > 0 and summary["median_cpu_s"] > 0
