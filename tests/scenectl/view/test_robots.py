"""Pictures of robots: their shapes are drawn where MuJoCo has them, and files are whole."""

from __future__ import annotations

from pathlib import Path

import mujoco
import numpy as np
import pytest
import torch
from PIL import Image

from scenectl.retarget.robots.robot import Robot
from scenectl.retarget.robots.trajectory import Trajectory
from scenectl.view.robots import SMALL, Replay, lowest
from scenectl.view.stage import SIZE
from scenes.motion.motion import Motion
from scenes.world.scene import Scene

HUMANOID = Path(__file__).parents[1] / "retarget" / "robots" / "humanoid.xml"


@pytest.fixture(scope="module")
def replay() -> Replay:
    robot = Robot(HUMANOID)
    qpos = np.tile(robot.model.qpos0, (11, 1))
    qpos[:, 0] = np.linspace(0, 1.5, 11)
    return Replay(Trajectory(robot, qpos, 20.0, Motion(torch.zeros(11, 22, 3)), ()), Scene.empty())


def test_bodies_are_where_mujoco_has_them_with_y_up(replay: Replay) -> None:
    robot, frame = replay.trajectory.robot, 7
    data = mujoco.MjData(robot.model)
    data.qpos[:] = replay.trajectory.qpos[frame]
    mujoco.mj_kinematics(robot.model, data)
    foot = robot.model.body("left_foot").id
    x, y, z = data.xpos[foot]
    np.testing.assert_allclose(replay._pose(frame, foot)[:3, 3], [x, z, -y], atol=1e-12)
    assert lowest(replay.trajectory) == pytest.approx(0.0, abs=1e-9)


def test_pictures_show_the_robot_and_animations_all_frames(replay: Replay, tmp_path: Path) -> None:
    replay.draw(tmp_path / "robot.png")
    with Image.open(tmp_path / "robot.png") as image:
        assert image.size == SIZE and np.asarray(image).std() > 5
    replay.animate(tmp_path / "robot.gif")
    with Image.open(tmp_path / "robot.gif") as image:
        assert image.size == SMALL and image.n_frames == 11 and image.info["duration"] == 50
