"""Robots that do not stand in their files."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from scenectl.retarget.robots.robot import Robot
from tests.scenectl.retarget.robots.humanoids import mjcf, person, renamed, saved, walking

HALF = np.sqrt(0.5)


@pytest.mark.parametrize("links", [person(), renamed(person())], ids=["named", "nameless"])
@pytest.mark.parametrize(
    "quat",
    [(HALF, 0, -HALF, 0), (HALF, 0, HALF, 0), (0, 1, 0, 0), (HALF, HALF, 0, 0)],
    ids=["back", "face", "head", "side"],
)
def test_whatever_a_robot_lies_on_it_is_stood_up(
    links: list, quat: tuple[float, float, float, float], tmp_path: Path
) -> None:
    stands = Robot(saved(tmp_path, mjcf(links)))
    lies = Robot(saved(tmp_path, mjcf(links, quat=" ".join(map(str, quat))), "lies.xml"))
    assert lies.joints == stands.joints and "does not stand in its file" in lies.doubts[-1]
    assert not any("stand" in doubt for doubt in stands.doubts)
    for name, place in stands.points.at.items():
        assert np.allclose(lies.points.at[name], place, atol=1e-9), name
    assert lies.rest.xpos[lies.model.body(lies.joints["left_ankle"]).id][2] < lies.rest.xpos[1][2] - 0.5


def test_one_that_lies_walks_as_one_that_stands(tmp_path: Path) -> None:
    stands = Robot(saved(tmp_path, mjcf(person())))
    lies = Robot(saved(tmp_path, mjcf(person(), quat=f"{HALF} 0 {-HALF} 0"), "lies.xml"))
    motion = walking(0.5)
    assert np.allclose(lies.retarget(motion).qpos, stands.retarget(motion).qpos, atol=1e-3)


def test_a_robot_that_stands_askew_is_left_so(tmp_path: Path) -> None:
    robot = Robot(saved(tmp_path, mjcf(person(), quat="0.98 0.1 0.15 0.05")))
    assert not robot.doubts and np.allclose(
        robot.rest.qpos[4:7] / robot.rest.qpos[3], [0.1 / 0.98, 0.15 / 0.98, 0.05 / 0.98]
    )


def test_feet_that_point_down_at_rest_stand_on_their_soles(tmp_path: Path) -> None:
    bent = 0.6
    text, sine, cosine = mjcf(person()), np.sin(bent / 2), np.cos(bent / 2)
    for side in ("left", "right"):
        name = f'<body name="{side}_ankle_pitch_link"'
        start = text.index(name)
        text = text[:start] + text[start:].replace(" >", f' quat="{cosine} 0 {sine} 0">', 1)
    level, robot = Robot(saved(tmp_path, mjcf(person()))), Robot(saved(tmp_path, text, "pointed.xml"))
    assert np.allclose(level.points.flats["left"], np.eye(3))
    for name in ("left_foot", "right_foot", "left_ankle"):
        assert np.allclose(robot.points.at[name], level.points.at[name], atol=1e-3), name
    assert robot.points.legs == pytest.approx(level.points.legs, abs=1e-3)
    trajectory = robot.retarget(walking(0.6))
    assert trajectory.figures().slide < 0.01 and max(off for off, _ in trajectory.figures().off.values()) < 0.03
