"""`scenectl retarget`: prints who moves as what, and how near the robot comes; writes what it says."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch

from scenectl.retarget.robots.robot import Robot
from scenes.motion.motion import Motion
from tests.scenectl.retarget.robots.humanoids import dancing, mjcf, person, renamed, saved

Run = Callable[..., Any]


@pytest.fixture
def motion(tmp_path: Path) -> Path:
    dancing(0, 12).save(tmp_path / "motion.npz")
    return tmp_path / "motion.npz"


def test_it_prints_the_mapping_and_writes(scenectl: Run, motion: Path, tmp_path: Path) -> None:
    robot = saved(tmp_path, mjcf(person()))
    said = scenectl("retarget", motion, "--robot", robot, "-o", tmp_path / "a.csv", "--fps", 40)
    assert said.status == 0, said.err
    lines = [line.split() for line in said.out.splitlines()]
    assert ["left_hip", "left_hip_yaw_link"] in lines and ["spine3", "torso_link"] in lines
    assert "0 of 25 speeds stated by the file, 9.42 rad/s assumed" in said.out
    assert f"body = {{ height = {Robot(robot).stature:.2f} }} are of its size" in said.out
    assert "23 frames at 40 a second" in said.out and "wrote" in said.out
    assert len((tmp_path / "a.csv").read_text().splitlines()) == 24


def test_a_mapping_overrules_and_geometry_is_doubted(scenectl: Run, motion: Path, tmp_path: Path) -> None:
    robot = saved(tmp_path, mjcf(renamed(person())))
    (tmp_path / "map.toml").write_text('left_wrist = "part13_link"\n')
    said = scenectl("retarget", motion, "--robot", robot, "--joints", tmp_path / "map.toml")
    assert said.status == 0 and "geometry" in said.err
    assert ["left_wrist", "part13_link"] in [line.split() for line in said.out.splitlines()]


def test_samples_are_chosen(scenectl: Run, tmp_path: Path) -> None:
    robot = saved(tmp_path, mjcf(person()))
    Motion(torch.stack([dancing(seed, 6).joints for seed in (0, 1)])).save(tmp_path / "two.npz")
    made = []
    for sample in (0, 1):
        said = scenectl(
            "retarget", tmp_path / "two.npz", "--robot", robot, "-o", tmp_path / "a.npz", "--sample", sample
        )
        assert said.status == 0, said.err
        made.append(np.load(tmp_path / "a.npz")["qpos"])
    assert not np.allclose(*made, atol=0.01)
    said = scenectl("retarget", tmp_path / "two.npz", "--robot", robot, "--sample", 2)
    assert said.status == 2 and "holds 2 motions" in said.err
    said = scenectl("retarget", tmp_path / "two.npz", "--robot", robot, "-o", tmp_path / "b.npz", "--all")
    assert said.status == 0, said.err
    for sample in (0, 1):
        np.testing.assert_array_equal(np.load(tmp_path / f"b_{sample}.npz")["qpos"], made[sample])


def test_torques_are_those_stated_and_a_scene_is_stayed_out_of(scenectl: Run, motion: Path, tmp_path: Path) -> None:
    robot = saved(tmp_path, mjcf(person()))
    (tmp_path / "torques.toml").write_text("left_knee_joint = 0.5\n")
    say = ("--robot", robot, "--torques", tmp_path / "torques.toml", "--report", tmp_path / "report.json")
    said = scenectl("retarget", motion, "pillars", *say)
    assert said.status == 0, said.err
    told = json.loads((tmp_path / "report.json").read_text())
    used = {joint["name"]: joint["torque_used"] for joint in told["joints"]}
    knee = next(joint for joint in told["joints"] if joint["name"] == "left_knee_joint")
    assert used.pop("left_knee_joint") == pytest.approx(knee["torque"] / 0.5) and not any(used.values())
    assert told["scene"] is not None and not told["within_limits"]


@pytest.mark.parametrize(
    ("options", "told"),
    [
        (("-o", "a.txt"), "ends with '.txt'"),
        (("-o", "a.csv", "--layout", "gmr"), "no layout 'gmr'"),
        (("--fps", "0"), "frames a second"),
        (("--sample", "1"), "holds one motion"),
        (("--joints", "map.toml"), 'write lines such as left_knee = "LeftLeg"'),
        (("--torques", "knees.toml"), "no joint of 'small.xml'"),
        (("--torques", "none.toml"), "torque file"),
        (("--all", "--sample", "0"), "exclude each other"),
        (("--scene",), "no result whose report tells of a scene"),
        (("room.glb", "--no-scene"), "--no-scene leaves out 'room.glb'"),
        (("room.glb",), "room.glb"),
        (("--robot", "none.xml"), "robot file"),
    ],
)
def test_bad_input_is_one_sentence(
    scenectl: Run, motion: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, options: tuple[str, ...], told: str
) -> None:
    monkeypatch.chdir(tmp_path)
    saved(tmp_path, mjcf(person()))
    (tmp_path / "map.toml").write_text("left_wrist = 3\n")
    (tmp_path / "knees.toml").write_text("knees = 3\n")
    said = scenectl("retarget", motion, "--robot", "small.xml", *options)
    assert said.status == 2 and told in said.err and "Traceback" not in said.err
    assert not [*tmp_path.glob("a.*")]
